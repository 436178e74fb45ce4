/* Functions of ctc_law.h around the object code of the law.
 *
 * The generated numbers are in ctc_law_data.h. */
#include "ctc_law.h"

#include <fenv.h>
#include <float.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "ctc_law_data.h"

#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "Compile without -ffast-math. With it NaN and infinite states are not detected."
#endif

_Static_assert(sizeof(double) == 8 && sizeof(void *) == 8, "The processor must have 64 bits.");

/* Compiled function that makes the law follow changed gains. NULL if it cannot. */
static code *const gains_function = GAINS_FUNCTION;

#define COUNT(x) (sizeof(x) / sizeof *(x))

/* One turn [rad]. */
static const double turn = 6.283185307179586;
/* Number of turns above which a double has no digits left for a part of a turn. */
static const double max_turns = 4503599627370496.0;
static const int continuous[CTC_JOINTS] = CTC_CONTINUOUS;

/* Rows of ctc_law.last: measured and desired motion of the last step. */
enum { LAST_Q, LAST_DQ, LAST_Q_D, LAST_DQ_D };

static int is_ready(const ctc_law *law) { return law != NULL && law->self == law; }

/* Store an address in a word of the memory. */
static void point(ctc_law *law, uint32_t at, uintptr_t address) {
  const uint64_t word = address;
  memcpy(law->memory + at, &word, sizeof word);
}

/* Restore the memory at the start, from word `from` on. */
static void begin(ctc_law *law, size_t from) {
  memcpy(law->memory + from, content + from, sizeof content - from * sizeof *content);
  for (size_t i = 0; i < COUNT(pointers); i++) {
    point(law, pointers[i].at, (uintptr_t)(law->memory + pointers[i].to));
  }
  for (size_t i = 0; i < COUNT(calls); i++) {
    point(law, calls[i].at, (uintptr_t)calls[i].function);
  }
  for (int i = 0; i < CTC_JOINTS; i++) {
    law->smallest_error[i] = INFINITY;
  }
  law->stopped = CTC_OK;
  law->begun = 0;
}

int ctc_init(ctc_law *law) {
  if (law == NULL) {
    return CTC_WRONG_ARGUMENT;
  }
  law->self = law;
  begin(law, 0);
  return CTC_OK;
}

int ctc_reset(ctc_law *law) {
  if (!is_ready(law)) {
    return CTC_NOT_INITIALIZED;
  }
  begin(law, MEMORIES);
  return CTC_OK;
}

/* Call compiled code in the default floating-point environment. */
static int run(code *function, const ctc_law *law, size_t addresses) {
  int64_t result;
  void *error;
  fenv_t environment;
  fegetenv(&environment);
  fesetenv(FE_DFL_ENV);
  int failed = function(&result, &error, (int64_t)(uintptr_t)(law->memory + addresses));
  fesetenv(&environment);
  return failed;
}

int ctc_check_gains(const double *kp, const double *kv, const double *ka) {
  const double *const gains[] = {kp, kv, ka};
  if (!kp || !kv || !ka) {
    return CTC_WRONG_ARGUMENT;
  }
  for (int k = 0; k < 3; k++) {
    for (int i = 0; i < CTC_JOINTS; i++) {
      if (!(gains[k][i] >= bounds[k][0] && gains[k][i] <= bounds[k][1])) { /* NaN as well. */
        return CTC_WRONG_GAIN;
      }
    }
  }
  return gains_function ? CTC_OK : CTC_FIXED_GAINS;
}

int ctc_set_gains(ctc_law *law, const double *kp, const double *kv, const double *ka) {
  int error = is_ready(law) ? ctc_check_gains(kp, kv, ka) : CTC_NOT_INITIALIZED;
  if (error != CTC_OK) {
    return error;
  }
  for (int i = 0; i < CTC_JOINTS; i++) {
    law->memory[KP + i * (CTC_JOINTS + 1)] = kp[i];
    law->memory[KV + i * (CTC_JOINTS + 1)] = kv[i];
    law->memory[KA + i] = ka[i];
  }
  run(gains_function, law, GAIN_ADDRESSES);
  return CTC_OK;
}

/* Copy rows to every `stride`-th row from `to` on. Return 1 if all numbers are finite. */
static int take(double *to, int stride, const double *from, int rows) {
  int finite = 1;
  for (int k = 0; k < rows; k++) {
    for (int i = 0; i < CTC_JOINTS; i++) {
      to[(k * stride) * CTC_JOINTS + i] = from[k * CTC_JOINTS + i];
      finite &= isfinite(from[k * CTC_JOINTS + i]) != 0;
    }
  }
  return finite;
}

/* Return an angle plus whole turns, nearest to the angle predicted from the last step. */
static double following(double angle, double velocity, double before, double velocity_before,
                        double elapsed) {
  const double target = before + 0.5 * elapsed * (velocity_before + velocity);
  const double turns = (target - angle) / turn;
  return fabs(turns) < max_turns ? angle + turn * rint(turns) : angle;
}

/* Add whole turns to positions of endless joints, so that they continue the last step.
 *
 * The first measured position is the one nearest to the reference. */
static void unwrap(const ctc_law *law, double elapsed, double *measured, double *points) {
  for (int i = 0; i < CTC_JOINTS; i++) {
    double *q_d = points + i, *q = measured + i;
    if (!continuous[i]) {
      continue;
    }
    if (law->begun) {
      *q_d = following(*q_d, q_d[CTC_JOINTS], law->last[LAST_Q_D][i], law->last[LAST_DQ_D][i],
                       elapsed);
      *q = following(*q, q[CTC_JOINTS], law->last[LAST_Q][i], law->last[LAST_DQ][i], elapsed);
    } else {
      *q = following(*q, 0.0, *q_d, 0.0, 0.0);
    }
    for (int k = 1; k < CTC_POINTS; k++) { /* Points during the delay. */
      double *next = q_d + 3 * CTC_JOINTS;
      *next = following(*next, next[CTC_JOINTS], *q_d, q_d[CTC_JOINTS], CTC_PERIOD);
      q_d = next;
    }
  }
}

/* Return 1 if a position is further from the last one than its velocities explain. */
static int jumps(const ctc_law *law, double elapsed, const double *measured) {
  for (int i = 0; i < CTC_JOINTS && law->begun; i++) {
    const double before = law->last[LAST_DQ][i], change = fabs(measured[CTC_JOINTS + i] - before);
    const double speed = fabs(before) + fmin(change, LARGEST_ACCELERATION * elapsed);
    if (fabs(measured[i] - law->last[LAST_Q][i]) > elapsed * speed + POSITION_MARGIN) {
      return 1;
    }
  }
  return 0;
}

/* Unwrap the measured and desired motion, and return CTC_JUMP for a jump. */
static int follow(ctc_law *law, double elapsed) {
  double *measured = law->memory + MEASURED, *points = law->memory + REFERENCE;
  fenv_t environment;
  fegetenv(&environment);
  fesetenv(FE_DFL_ENV);
  unwrap(law, elapsed, measured, points);
  const int jumped = jumps(law, elapsed, measured);
  fesetenv(&environment);
  memcpy(law->last[LAST_Q], measured, 2 * sizeof law->last[0]);
  memcpy(law->last[LAST_Q_D], points, 2 * sizeof law->last[0]);
  law->begun = 1;
  return jumped ? CTC_JUMP : CTC_OK;
}

/* Return the reason not to send the computed torque, or CTC_OK. */
static int trip(ctc_law *law) {
  const double *terms = ctc_terms(law), *e = terms + CTC_E * CTC_JOINTS;
  int watched = WATCHED;
  for (int i = 0; i < 8 * CTC_JOINTS; i++) { /* The limits may hide an infinite term. */
    if (!isfinite(terms[i])) {
      return CTC_OVERFLOW;
    }
  }
  for (int i = 0; i < CTC_JOINTS; i++) {
    watched &= error_limit[i] > DBL_MAX;
  }
  for (int i = 0; i < CTC_JOINTS; i++) {
    if (!(fabs(e[i]) <= error_limit[i])) {
      return CTC_ERROR_LIMIT;
    }
    law->smallest_error[i] = fmin(law->smallest_error[i], fabs(e[i]));
    if (watched && fabs(e[i]) - law->smallest_error[i] > MAX_ERROR_GROWTH) {
      return CTC_ERROR_GROWTH;
    }
  }
  if (STRAINED &&
      (law->memory[STRAINED] >= MAX_STRAINED_S || law->memory[CYCLING] >= MAX_CYCLING_S)) {
    return CTC_OSCILLATION;
  }
  return CTC_OK;
}

int ctc_step(ctc_law *law, const double *q, const double *dq, const double *q_d,
             const double *dq_d, const double *ddq_d, double *tau) {
  return ctc_step_after(law, CTC_PERIOD, q, dq, q_d, dq_d, ddq_d, tau);
}

int ctc_step_after(ctc_law *law, double elapsed, const double *q, const double *dq,
                   const double *q_d, const double *dq_d, const double *ddq_d, double *tau) {
  if (tau == NULL) {
    return CTC_WRONG_ARGUMENT;
  }
  if (!is_ready(law) || !q || !dq || !q_d || !dq_d || !ddq_d) {
    memset(tau, 0, CTC_JOINTS * sizeof *tau);
    return is_ready(law) ? CTC_WRONG_ARGUMENT : CTC_NOT_INITIALIZED;
  }
  if (law->stopped == CTC_OK) {
    double *measured = law->memory + MEASURED, *points = law->memory + REFERENCE;
    int finite = take(measured, 1, q, 1) & take(measured + CTC_JOINTS, 1, dq, 1) &
                 take(points, 3, q_d, CTC_POINTS) & take(points + CTC_JOINTS, 3, dq_d, CTC_POINTS) &
                 take(points + 2 * CTC_JOINTS, 3, ddq_d, CTC_POINTS);
    law->stopped = finite && isfinite(elapsed) ? follow(law, elapsed) : CTC_NOT_FINITE;
    if (law->stopped == CTC_OK) {
      law->stopped = run(ctc_control, law, STEP_ADDRESSES) ? CTC_OVERFLOW : trip(law);
    }
  }
  for (int i = 0; i < CTC_JOINTS; i++) {
    tau[i] = law->stopped == CTC_OK ? ctc_terms(law)[CTC_TAU * CTC_JOINTS + i] : 0.0;
  }
  return law->stopped;
}

const double *ctc_terms(const ctc_law *law) { return law->memory + TERMS; }

double ctc_lyapunov(const ctc_law *law) {
  const double *v = ctc_terms(law) + CTC_V * CTC_JOINTS;
  const double *mass = law->memory + MASS_MATRIX;
  double twice = 0.0;
  for (int i = 0; i < CTC_JOINTS; i++) {
    for (int j = 0; j < CTC_JOINTS; j++) {
      twice += v[i] * mass[i * CTC_JOINTS + j] * v[j];
    }
  }
  return 0.5 * twice;
}

const char *ctc_message(int error) {
  static const char *const messages[] = {
      "there is no error",
      "the law is not initialized; call ctc_init at its present address",
      "an argument is a null pointer",
      "a state or reference is not finite",
      "the law has no finite torque for this state",
      "a position error exceeded error_limit",
      "a position error has grown too much; set error_limit to allow more",
      "the feedback oscillated",
      "a gain is not finite or out of range",
      "the gains of this law are fixed; export it again with other gains",
      "a position jumped further than its velocity explains; check its encoder"};
  return error >= 0 && (size_t)error < COUNT(messages) ? messages[error] : "the error is unknown";
}
