/* A control law of ctc_chattering for one robot, by `ctc export-c`.
 *
 * Law @LAW@, @JOINTS@ joints, every @PERIOD@ s. A step allocates nothing, takes no lock, calls
 * nothing but sin, cos and the like of the C library, raises no floating-point exception, and
 * leaves the floating-point environment of its caller alone. Vectors are arrays of CTC_JOINTS
 * doubles in the order of CTC_JOINT_NAMES, in rad, rad/s, rad/s^2 and N*m (m and N of a prismatic
 * joint).
 */
#ifndef CTC_LAW_H
#define CTC_LAW_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define CTC_LAW "@LAW@"
#define CTC_JOINTS @JOINTS@
#define CTC_JOINT_NAMES {@JOINT_NAMES@}
/* Which joints turn endlessly: of their positions only the part beyond whole turns counts. */
#define CTC_CONTINUOUS {@CONTINUOUS@}
/* Sample period [s], the same as in nanoseconds, and the known delay of the torque in samples. */
#define CTC_PERIOD @PERIOD@
#define CTC_PERIOD_NS @PERIOD_NS@
#define CTC_DELAY @DELAY@
/* Points of the reference that a step takes: of its sample, and of those of the delay. */
#define CTC_POINTS (CTC_DELAY + 1)
/* Gains in force after ctc_init: kp [1/s^2], kv [1/s] and ka [N*m, or N], shape (CTC_JOINTS,). */
#define CTC_KP {@KP@}
#define CTC_KV {@KV@}
#define CTC_KA {@KA@}

/* What functions return. */
enum {
  CTC_OK = 0,
  CTC_NOT_INITIALIZED = 1, /* no ctc_init, or the law was copied to another address */
  CTC_WRONG_ARGUMENT = 2,  /* a null pointer */
  CTC_NOT_FINITE = 3,      /* a state or reference that is NaN or infinite */
  CTC_OVERFLOW = 4,        /* no finite torque for this state */
  CTC_ERROR_LIMIT = 5,     /* |e| of a joint beyond error_limit */
  CTC_ERROR_GROWTH = 6,    /* observer_feedback without error_limit: |e| has grown by @GROWTH@ rad */
  CTC_OSCILLATION = 7,     /* observer_feedback: the feedback oscillated strongly for @PATIENCE@ s, or
                              had a limit cycle for @CYCLE@ s */
  CTC_WRONG_GAIN = 8,      /* a gain that is not finite, or out of range */
  CTC_FIXED_GAINS = 9,     /* other numbers of this law depend on its gains: export it again */
  CTC_JUMP = 10            /* a position further from that of the last step than @MARGIN@ rad (or
                              m) beyond what its velocities explain: an encoder set anew, or a
                              joint that turns endlessly and is not in CTC_CONTINUOUS */
};

/* Rows of ctc_terms, each of shape (CTC_JOINTS,): torque, errors q_d - q and dq_d - dq, filtered
 * error v, and the parts of the torque: nominal - compensation - robust - saturation error. */
enum {
  CTC_TAU, CTC_E, CTC_DE, CTC_V, CTC_NOMINAL, CTC_COMPENSATION, CTC_ROBUST, CTC_SATURATION_ERROR
};

/* A law with all its memory. Its address must not change after ctc_init. One thread at a time. */
typedef struct ctc_law {
  const struct ctc_law *self;
  int32_t stopped; /* why no torque is sent until ctc_reset; CTC_OK if it is */
  int32_t begun;   /* whether there was a step */
  double last[4][CTC_JOINTS];
  double least[CTC_JOINTS];
  double memory[@WORDS@];
} ctc_law;

/* Begin, with the gains of the export. */
int ctc_init(ctc_law *law);

/* Begin again with the gains in force: nothing estimated, no torque in transit, filter at 0. */
int ctc_reset(ctc_law *law);

/* Use other gains from the next step on; filter, integrals and estimates go on.
 *
 * kp: position gains [1/s^2], kv: velocity gains [1/s], both @LEAST@ to @LARGEST@;
 * ka: chattering gains, or bounds of the estimate [N*m, or N], 0 to @LARGEST@. Each has shape
 * (CTC_JOINTS,). On any error nothing is changed.
 */
int ctc_set_gains(ctc_law *law, const double *kp, const double *kv, const double *ka);

/* Return what ctc_set_gains would, without a law: in any thread. */
int ctc_check_gains(const double *kp, const double *kv, const double *ka);

/* Go on by one period.
 *
 * q, dq: measured position and velocity, shape (CTC_JOINTS,). The position of an endless joint
 * stands for that nearest to where the last one leads; the first one, nearest to the desired one.
 * q_d, dq_d, ddq_d: desired motion, shape (CTC_POINTS, CTC_JOINTS): row k of k periods from now.
 * tau: torque to hold until the next step, shape (CTC_JOINTS,).
 *
 * On any error tau is 0, and so it is from then on, with the same error, until ctc_reset.
 */
int ctc_step(ctc_law *law, const double *q, const double *dq, const double *q_d,
             const double *dq_d, const double *ddq_d, double *tau);

/* The same where another time than a period has elapsed since the last step [s]: it says how far
 * joints can have moved meanwhile. The law goes on by one period all the same. */
int ctc_step_after(ctc_law *law, double elapsed, const double *q, const double *dq,
                   const double *q_d, const double *dq_d, const double *ddq_d, double *tau);

/* What the last step computed, shape (8, CTC_JOINTS); 0 before the first. */
const double *ctc_terms(const ctc_law *law);

/* V = v^T M v / 2 of the last step [J]; M at q, or where the law has estimated it. */
double ctc_lyapunov(const ctc_law *law);

/* What an error means, in a few words. */
const char *ctc_message(int error);

#ifdef __cplusplus
}
#endif
#endif
