/* A control law of ctc_chattering for one robot, written by `ctc export-c`.
 *
 * The law is @LAW@ for @JOINTS@ joints with a period of @PERIOD@ s. A step allocates no memory and
 * takes no lock. It calls only sin, cos and similar functions of the C library. It raises no
 * floating-point exception and keeps the floating-point environment of its caller. Vectors are
 * arrays of CTC_JOINTS doubles in the order of CTC_JOINT_NAMES. Their units are rad, rad/s, rad/s^2
 * and N*m, or m and N for a prismatic joint.
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
/* 1 for a joint that turns endlessly. Whole turns of its position do not count. */
#define CTC_CONTINUOUS {@CONTINUOUS@}
/* Sample period [s]. */
#define CTC_PERIOD @PERIOD@
/* Sample period [ns]. */
#define CTC_PERIOD_NS @PERIOD_NS@
/* Known delay of the torque [samples]. */
#define CTC_DELAY @DELAY@
/* Number of reference points of a step: its sample, and the samples of the delay. */
#define CTC_POINTS (CTC_DELAY + 1)
/* Gains after ctc_init: kp [1/s^2], kv [1/s] and ka [N*m, or N], shape (CTC_JOINTS,). */
#define CTC_KP {@KP@}
#define CTC_KV {@KV@}
#define CTC_KA {@KA@}

/* Error codes that functions return. */
enum {
  CTC_OK = 0,
  CTC_NOT_INITIALIZED = 1, /* ctc_init was not called, or the law was copied */
  CTC_WRONG_ARGUMENT = 2,  /* an argument is a null pointer */
  CTC_NOT_FINITE = 3,      /* a state or reference is NaN or infinite */
  CTC_OVERFLOW = 4,        /* the law has no finite torque for this state */
  CTC_ERROR_LIMIT = 5,     /* |e| of a joint exceeded error_limit */
  CTC_ERROR_GROWTH = 6,    /* observer_feedback without error_limit: |e| has grown by @GROWTH@ rad */
  CTC_OSCILLATION = 7,     /* observer_feedback: the feedback oscillated strongly for @MAX_STRAINED_S@ s,
                              or had a limit cycle for @MAX_CYCLING_S@ s */
  CTC_WRONG_GAIN = 8,      /* a gain is not finite or out of range */
  CTC_FIXED_GAINS = 9,     /* other numbers of this law depend on its gains; export it again */
  CTC_JUMP = 10            /* a position changed by @MARGIN@ rad (or m) more than its velocities
                              explain: an encoder was reset, or a joint turns endlessly and is not
                              in CTC_CONTINUOUS */
};

/* Rows of ctc_terms, each of shape (CTC_JOINTS,).
 *
 * They are the torque, the errors q_d - q and dq_d - dq, the filtered error v, and the parts of the
 * torque, which is nominal - compensation - robust - saturation error. */
enum {
  CTC_TAU, CTC_E, CTC_DE, CTC_V, CTC_NOMINAL, CTC_COMPENSATION, CTC_ROBUST, CTC_SATURATION_ERROR
};

/* A law with all its memory.
 *
 * Its address must not change after ctc_init. Only one thread may use it at a time. */
typedef struct ctc_law {
  const struct ctc_law *self;
  int32_t stopped; /* error that stops the torque until ctc_reset, or CTC_OK */
  int32_t begun;   /* 1 after the first step */
  double last[4][CTC_JOINTS];
  double smallest_error[CTC_JOINTS];
  double memory[@WORDS@];
} ctc_law;

/* Initialize the law with the gains of the export. */
int ctc_init(ctc_law *law);

/* Restart the law with its present gains.
 *
 * Estimates and filter are 0, and no torque is in transit. */
int ctc_reset(ctc_law *law);

/* Use other gains from the next step on.
 *
 * Filter, integrals and estimates keep their values.
 * kp: position gains [1/s^2], kv: velocity gains [1/s], both @LEAST@ to @LARGEST@;
 * ka: chattering gains, or bounds of the estimate [N*m, or N], 0 to @LARGEST@. Each has shape
 * (CTC_JOINTS,). An error leaves the gains unchanged.
 */
int ctc_set_gains(ctc_law *law, const double *kp, const double *kv, const double *ka);

/* Return the error code of ctc_set_gains without a law. Any thread may call it. */
int ctc_check_gains(const double *kp, const double *kv, const double *ka);

/* Compute the torque of the next period.
 *
 * q, dq: measured position and velocity, shape (CTC_JOINTS,). Whole turns are
 * added to the position of an endless joint, so that it continues the last one. The first position
 * is the one nearest to the desired position.
 * q_d, dq_d, ddq_d: desired motion, shape (CTC_POINTS, CTC_JOINTS). Row k is k periods from now.
 * tau: torque to hold until the next step, shape (CTC_JOINTS,).
 *
 * After an error tau is 0, and all further steps return this error, until ctc_reset.
 */
int ctc_step(ctc_law *law, const double *q, const double *dq, const double *q_d,
             const double *dq_d, const double *ddq_d, double *tau);

/* Compute the torque as ctc_step, with the time elapsed since the last step [s].
 *
 * The check for jumps uses this time. The law itself advances by one period. */
int ctc_step_after(ctc_law *law, double elapsed, const double *q, const double *dq,
                   const double *q_d, const double *dq_d, const double *ddq_d, double *tau);

/* Return the terms of the last step, shape (8, CTC_JOINTS). They are 0 before the first step. */
const double *ctc_terms(const ctc_law *law);

/* Return V = v^T M v / 2 of the last step [J], with M at the measured or estimated q. */
double ctc_lyapunov(const ctc_law *law);

/* Return a message for an error code. */
const char *ctc_message(int error);

#ifdef __cplusplus
}
#endif
#endif
