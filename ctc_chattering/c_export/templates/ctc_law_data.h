/* Numbers of a law for ctc_law.c. */
typedef int code(int64_t *result, void **error, int64_t addresses);

/* Positions in the memory [words]. STRAINED and CYCLING are 0 for a law without them. */
#define STEP_ADDRESSES @STEP_ADDRESSES@
#define GAIN_ADDRESSES @GAIN_ADDRESSES@
#define MEMORIES @MEMORIES@
#define MEASURED @MEASURED@
#define REFERENCE @REFERENCE@
#define TERMS @TERMS@
#define MASS_MATRIX @MASS_MATRIX@
#define KP @KP_POSITION@
#define KV @KV_POSITION@
#define KA @KA_POSITION@
#define STRAINED @STRAINED@
#define CYCLING @CYCLING@

/* 1 for a law that trips when its error grows without error_limit. */
#define WATCHED @WATCHED@
/* Largest growth of an error [rad]. */
#define MAX_ERROR_GROWTH @GROWTH@
/* Longest strong oscillation, and longest limit cycle [s]. */
#define MAX_STRAINED_S @MAX_STRAINED_S@
#define MAX_CYCLING_S @MAX_CYCLING_S@
/* Largest change of a position beyond its velocities [rad or m]. */
#define POSITION_MARGIN @MARGIN@
/* Largest acceleration that explains a change of velocity [rad/s^2 or m/s^2]. */
#define LARGEST_ACCELERATION @ACCELERATION@
#define GAINS_FUNCTION @GAINS_FUNCTION@

@FUNCTIONS@
/* Least and largest kp, kv and ka. */
static const double bounds[3][2] = {@BOUNDS@};
static const double error_limit[CTC_JOINTS] = {@ERROR_LIMIT@};
/* Words of the memory that hold the address of another word. */
static const struct { uint32_t at, to; } pointers[] = {
@POINTERS@};
/* Words of the memory that hold the address of a function. */
static const struct { uint32_t at; code *function; } calls[] = {@CALLS@};
/* Memory at the start. */
static const uint64_t content[] = {
@CONTENT@};
