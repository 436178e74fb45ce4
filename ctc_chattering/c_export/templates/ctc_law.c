/* The law of ctc_law.h around its object code; its numbers are in ctc_law_data.h. */
#include "ctc_law.h"

#include <fenv.h>
#include <float.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "ctc_law_data.h"

#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "compile without -ffast-math: NaN and infinite states would not be found"
#endif

_Static_assert(sizeof(double) == 8 && sizeof(void *) == 8, "a processor of 64 bits");

/* Has the law follow gains that have changed; NULL if it cannot. */
static code *const gains_function = GAINS_FUNCTION;

#define COUNT(x) (sizeof(x) / sizeof *(x))

/* A turn [rad]; turns beyond which an angle has no digits left for its part. */
static const double turn = 6.283185307179586, most_turns = 4503599627370496.0;
static const int continuous[CTC_JOINTS] = CTC_CONTINUOUS;

/* Rows of ctc_law.last: what was measured and desired a step ago. */
enum { LAST_Q, LAST_DQ, LAST_Q_D, LAST_DQ_D };

static int is_ready(const ctc_law *law) { return law != NULL && law->self == law; }

/* Have a word of the memory hold an address. */
static void point(ctc_law *law, uint32_t at, uintptr_t address) {
  const uint64_t word = address;
  memcpy(law->memory + at, &word, sizeof word);
}

/* Have the memory be as at the start, from a word on. */
static void begin(ctc_law *law, size_t from) {
  memcpy(law->memory + from, content + from, sizeof content - from * sizeof *content);
  for (size_t i = 0; i < COUNT(pointers); i++) {
    point(law, pointers[i].at, (uintptr_t)(law->memory + pointers[i].to));
  }
  for (size_t i = 0; i < COUNT(calls); i++) {
    point(law, calls[i].at, (uintptr_t)calls[i].function);
  }
  for (int i = 0; i < CTC_JOINTS; i++) {
    law->least[i] = INFINITY;
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

/* Call compiled code in the floating-point environment for which it is made. */
static int run(code *function, const ctc_law *law, size_t places) {
  int64_t result;
  void *error;
  fenv_t environment;
  fegetenv(&environment);
  fesetenv(FE_DFL_ENV);
  int failed = function(&result, &error, (int64_t)(uintptr_t)(law->memory + places));
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
      if (!(gains[k][i] >= bounds[k][0] && gains[k][i] <= bounds[k][1])) { /* So is NaN. */
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
  run(gains_function, law, GAIN_PLACES);
  return CTC_OK;
}

/* Copy rows to every `stride`-th row from `to` on; return whether all numbers are finite. */
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

/* Return the representative of an angle modulo 2 pi that is nearest to where one before leads. */
static double following(double angle, double velocity, double before, double velocity_before,
                        double elapsed) {
  const double target = before + 0.5 * elapsed * (velocity_before + velocity);
  const double turns = (target - angle) / turn;
  return fabs(turns) < most_turns ? angle + turn * rint(turns) : angle;
}

/* Have positions of endless joints follow those of the last step, the first one the reference. */
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
    for (int k = 1; k < CTC_POINTS; k++) { /* Of the delay. */
      double *next = q_d + 3 * CTC_JOINTS;
      *next = following(*next, next[CTC_JOINTS], *q_d, q_d[CTC_JOINTS], CTC_PERIOD);
      q_d = next;
    }
  }
}

/* Return whether a position is further from that of the last step than its velocities explain. */
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

/* Take what is measured and desired with the turns that belong to it; return why not. */
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

/* Return why the torque that was computed must not be sent; CTC_OK if it may be. */
static int trip(ctc_law *law) {
  const double *made = ctc_terms(law), *e = made + CTC_E * CTC_JOINTS;
  int watched = WATCHED;
  for (int i = 0; i < 8 * CTC_JOINTS; i++) { /* Also what the limits have made finite. */
    if (!isfinite(made[i])) {
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
    law->least[i] = fmin(law->least[i], fabs(e[i]));
    if (watched && fabs(e[i]) - law->least[i] > LARGEST_GROWTH) {
      return CTC_ERROR_GROWTH;
    }
  }
  if (STRAINED &&
      (law->memory[STRAINED] >= PATIENCE || law->memory[CYCLING] >= LONGEST_CYCLE)) {
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
      law->stopped = run(ctc_control, law, PLACES) ? CTC_OVERFLOW : trip(law);
    }
  }
  for (int i = 0; i < CTC_JOINTS; i++) {
    tau[i] = law->stopped == CTC_OK ? ctc_terms(law)[CTC_TAU * CTC_JOINTS + i] : 0.0;
  }
  return law->stopped;
}

const double *ctc_terms(const ctc_law *law) { return law->memory + MADE; }

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
      "no error", "the law is not initialized", "a wrong argument",
      "a state or reference is not finite", "no finite torque", "a position error exceeded error_limit",
      "a position error has grown too much", "the feedback oscillated",
      "a gain is not finite or out of range", "the gains of this law are fixed",
      "a position jumped further than its velocity explains"};
  return error >= 0 && (size_t)error < COUNT(messages) ? messages[error] : "unknown error";
}
