"""
The simulated robot over one control period: network, drives, friction, motion, sensors.

As `simulation/simulated_robot.py` and `simulation/plant.py` have it, for rigid joints.
"""

from __future__ import annotations

from math import isfinite

from ctc_chattering.batch import drives
from ctc_chattering.batch.compiler import compiled, inlined
from ctc_chattering.batch.integrator import integrate, Plant, set_modes
from ctc_chattering.batch.sensors import quantised
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Most samples in a row that are lost.
_MOST_LOST = 2


@inlined
def receive(p: Plant, tau: Array, lateness: np.random.Generator) -> None:
    """Set what is commanded to the drives over the period that a torque `tau` begins."""
    c, s = p.c, p.s
    late = c.late_samples > 0.0 and lateness.random() < c.late_samples
    place = s.k % c.delay if c.delay else 0
    for i in range(len(tau)):
        now = s.received[i] if late else tau[i]
        s.received[i] = tau[i]
        if c.delay:
            s.coming[place, i], now = now, s.coming[place, i]
        now = quantised(now, c.resolution[i])
        s.command[i] = min(max(now, -c.saturation[i]), c.saturation[i])


@inlined
def set_friction(p: Plant) -> None:
    """Set friction at rest for this period, and take its asymmetric part from the command."""
    c, s = p.c, p.s
    for i in range(len(s.q)):
        acting = s.applied[i] if c.ideal else s.mean[i]
        coulomb = c.coulomb[i] + c.load[i] * abs(acting)
        s.breakaway[i] = coulomb + c.stribeck[i]
        s.command[i] -= c.asymmetry[i] * coulomb


@compiled
def step(p: Plant, tau: Array, loss: np.random.Generator, lateness: np.random.Generator) -> bool:
    """
    Receive the torque `tau`, shape (n,) [N·m], and go on by one control period.

    Return False if the motion leaves the range of floating-point numbers.
    """
    c, s = p.c, p.s
    t = float(s.k * c.period_ns) / 1e9
    n = len(s.q)
    receive(p, tau, lateness)
    for i in range(n):
        s.applied[i] = s.command[i]
    if not c.ideal:
        drives.command(s.command, c.lag, c.rate, c.period, s.gap, s.torque, s.mean)
        for i in range(n):
            s.applied[i] = s.torque[i]
    set_friction(p)
    resting = not s.decided or c.loaded or s.sticking
    for i in range(n):
        resting |= s.dq[i] == 0.0
    if resting:
        set_modes(p, t)
    h = c.period / c.substeps
    for i in range(c.substeps):
        integrate(p, t + i * h, h)
    total = 0.0
    for i in range(n):
        total += s.q[i] + s.dq[i]
    s.k += 1
    lost = c.sample_loss > 0.0 and loss.random() < c.sample_loss
    s.lost = lost and s.lost_in_a_row < _MOST_LOST and s.k != c.last
    s.lost_in_a_row = s.lost_in_a_row + 1 if s.lost else 0
    return isfinite(total)
