/* Answer time of an exported law at 1 kHz beside an empty loop, in turns of 10 ms.
 *
 * Answer time: from the instant at which the thread was to wake until the torque is there; of the
 * empty loop, until it is awake. Prints, in us: p50, p99.9 and maximum of the empty loop, the same
 * of the law, p50 and maximum of the step alone; then page faults and bytes allocated meanwhile.
 */
#define _GNU_SOURCE
#include <malloc.h>
#include <math.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <time.h>

#include "ctc_law.h"

enum { EMPTY, ANSWER, STEP, KINDS };

static int64_t now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return 1000000000LL * t.tv_sec + t.tv_nsec;
}

static int ascending(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

int main(int count, char **arguments) {
  const int seconds = atoi(arguments[1]), samples = 1000 * seconds;
  const struct sched_param priority = {.sched_priority = 50};
  static ctc_law law;
  double *took[KINDS], tau[CTC_JOINTS] = {0};
  int taken[KINDS] = {0};
  for (int kind = 0; kind < KINDS; kind++) {
    took[kind] = calloc(samples, sizeof(double));
  }
  if (count > 2 && sched_setscheduler(0, SCHED_FIFO, &priority) != 0) {
    perror("SCHED_FIFO");
    return 1;
  }
  mlockall(MCL_CURRENT | MCL_FUTURE);
  ctc_init(&law);
  struct rusage before, after;
  const int64_t start = now() + 10000000;
  size_t allocated = 0;
  for (int k = -1000; k < samples; k++) { /* The first second is not counted. */
    const int64_t due = start + (k + 1000) * 1000000LL;
    const struct timespec t = {due / 1000000000, due % 1000000000};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
    const int64_t awake = now();
    const int empty = k >= 0 && k / 10 % 2 == 0;
    if (!empty) {
      double rows[5][CTC_POINTS * CTC_JOINTS];
      for (int i = 0; i < CTC_POINTS * CTC_JOINTS; i++) {
        const double x = 1e-3 * k + i;
        rows[2][i] = 0.3 * sin(x);
        rows[3][i] = 0.3 * cos(x);
        rows[4][i] = -0.3 * sin(x);
        rows[0][i] = rows[2][i] + 1e-3 * cos(20.0 * x);
        rows[1][i] = rows[3][i];
      }
      const int64_t begin = now();
      const int error = ctc_step(&law, rows[0], rows[1], rows[2], rows[3], rows[4], tau);
      const int64_t end = now();
      if (error != CTC_OK) {
        fprintf(stderr, "%s\n", ctc_message(error));
        return 1;
      }
      if (k >= 0) {
        took[ANSWER][taken[ANSWER]++] = 1e-3 * (end - due);
        took[STEP][taken[STEP]++] = 1e-3 * (end - begin);
      }
    } else {
      took[EMPTY][taken[EMPTY]++] = 1e-3 * (awake - due);
    }
    if (k == -1) {
      allocated = mallinfo2().uordblks + mallinfo2().hblkhd;
      getrusage(RUSAGE_SELF, &before);
    }
  }
  getrusage(RUSAGE_SELF, &after);
  allocated = mallinfo2().uordblks + mallinfo2().hblkhd - allocated;
  for (int kind = 0; kind < KINDS; kind++) {
    const double *x = took[kind];
    qsort(took[kind], taken[kind], sizeof(double), ascending);
    printf("%.1f %.1f %.1f ", x[taken[kind] / 2], x[taken[kind] * 999 / 1000], x[taken[kind] - 1]);
  }
  printf("%ld %zu\n", after.ru_minflt + after.ru_majflt - before.ru_minflt - before.ru_majflt,
         allocated);
  return 0;
}
