"""The closed loop sample by sample, compiled."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

from ctc_chattering.batch import control_step, plant
from ctc_chattering.batch.compiler import compiled
from ctc_chattering.batch.control_step import ControlRecords, E, TAU, V
from ctc_chattering.batch.integrator import Plant
from ctc_chattering.batch.sensors import measure, SensorSettings, SensorState
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: How a run ends, and the sample: at its end, without a finite torque, with a position error
#: beyond its limit (and its joint), with a state that is not finite.
FINISHED, NO_TORQUE, BEYOND, DIVERGED = range(4)


class Sources(NamedTuple):
    """Random numbers of noise, of lost and of late samples."""

    noise: np.random.Generator
    loss: np.random.Generator
    lateness: np.random.Generator


@compiled
def run(p: Plant, c: ControlRecords, sensor: SensorSettings, seen: SensorState,
        sources: Sources, error_limit: Array, table: Array, truth: bool, out: Array
        ) -> tuple[int, int, int, int]:
    """
    Run the closed loop from the first sample to the last.

    Parameters
    ----------
    p, c, sensor, seen, sources
        Plant, controller, sensors with the first measurement, and random numbers.
    error_limit : array, shape (n,)
        Largest position error [rad]; inf for any.
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
    n, rows = len(p.s.q), 0
    tau, e, v = c.out[TAU], c.out[E], c.out[V]
    for k in range(p.c.last + 1):
        if not p.s.lost:
            for i in range(n):
                c.measured[0, i], c.measured[1, i] = seen.q[i], seen.dq[i]
            control_step.step(c, table[k:])
            total = 0.0
            for i in range(n):
                out[rows, 0, i] = k
                out[rows, 1, i], out[rows, 2, i] = seen.q[i], seen.dq[i]
                if truth:
                    out[rows, 1, i], out[rows, 2, i] = p.s.q[i], p.s.dq[i]
                out[rows, 3, i], out[rows, 4, i] = tau[i], v[i]
                total += tau[i] + v[i]
            if not isfinite(total):
                return NO_TORQUE, k, 0, rows
            for i in range(n):
                if not abs(e[i]) <= error_limit[i]:
                    return BEYOND, k, i, rows
            rows += 1
        if k < p.c.last:
            if not plant.step(p, tau, sources.loss, sources.lateness):
                return DIVERGED, k, 0, rows
            measure(p.s.q, p.s.dq, sensor, seen, sources.noise)
    return FINISHED, p.c.last, 0, rows
