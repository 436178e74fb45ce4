"""The closed loop sample by sample, compiled."""

from __future__ import annotations

from math import isfinite
from typing import Any

from ctc_chattering.batch import control_step, plant
from ctc_chattering.batch.compiler import compiled
from ctc_chattering.batch.control_step import Controller
from ctc_chattering.batch.plant import CompiledPlant
from ctc_chattering.numerics.linear_algebra import Array

#: How a run ends, and the sample: at its end, without a finite torque, with a position error
#: beyond its limit (and its joint), with a state that is not finite.
FINISHED, NO_TORQUE, BEYOND, DIVERGED = range(4)


@compiled
def run(p: CompiledPlant, c: Controller, given: Any, table: Array, truth: bool, out: Array
        ) -> tuple[int, int, int, int]:
    """
    Run the closed loop from the first sample to the last.

    Parameters
    ----------
    p, c
        Plant and controller.
    given : array of records, shape (N,)
        Of `PlantInput`, their torque to be filled.
    table : array, shape (N + delay, 3, n)
        q_d, dq_d and ddq_d at each sample.
    truth : bool
        Record the true state in place of the measured one.
    out : array, shape (N, 5, n)
        Rows to be filled with k, q, dq, tau, v of each sample that is not lost.

    Returns
    -------
    tuple of int
        How the run ended, at which sample, with which joint, and the number of rows.

    """
    s, n, rows = p.state, len(c.now.q), 0
    for k in range(p.parameters.last + 1):
        tau = given[k].tau
        if s.lost_in_a_row:
            for i in range(n):
                tau[i] = given[k - 1].tau[i]
        else:
            control_step.step(c, k, s.shown__q, s.shown__dq, table, tau)
            total = 0.0
            for i in range(n):
                out[rows, 0, i] = k
                out[rows, 1, i], out[rows, 2, i] = s.shown__q[i], s.shown__dq[i]
                if truth:
                    out[rows, 1, i], out[rows, 2, i] = s.motion__q[i], s.motion__dq[i]
                out[rows, 3, i], out[rows, 4, i] = tau[i], c.now.v[i]
                total += tau[i] + c.now.v[i]
            if not isfinite(total):
                return NO_TORQUE, k, 0, rows
            for i in range(n):
                if not abs(c.now.e[i]) <= c.c.error_limit[i]:
                    return BEYOND, k, i, rows
            rows += 1
        if k < p.parameters.last:
            plant.step(p, given[k])
            total = 0.0
            for i in range(n):
                total += s.motion__q[i] + s.motion__dq[i]
            if not isfinite(total):
                return DIVERGED, k, 0, rows
    return FINISHED, p.parameters.last, 0, rows
