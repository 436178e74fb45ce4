/* Compute the torques of states from standard input.
 *
 * Each step reads the doubles q, dq, q_d, dq_d and ddq_d, and writes tau to standard output. After
 * an error the law is reset, and the torque of that step is 0. */
#include <stdio.h>

#include "ctc_law.h"

int main(void) {
  static ctc_law law;
  static double state[2 * CTC_JOINTS], points[3][CTC_POINTS * CTC_JOINTS];
  double tau[CTC_JOINTS];
  if (ctc_init(&law) != CTC_OK) {
    return 1;
  }
  while (fread(state, sizeof state, 1, stdin) == 1 && fread(points, sizeof points, 1, stdin) == 1) {
    int error = ctc_step(&law, state, state + CTC_JOINTS, points[0], points[1], points[2], tau);
    if (error != CTC_OK) {
      fprintf(stderr, "%s\n", ctc_message(error));
      ctc_reset(&law);
    }
    fwrite(tau, sizeof tau, 1, stdout);
  }
  return 0;
}
