# Copyright 2026 The ctc_chattering maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
A reference that drives can follow where friction changes its sign.

The law `observer_feedback` shifts its reference by the deviation x that this module computes. At a
reversal the torque of a joint has to change by 2 K̂. A drive with the rate limit R takes 2 T for
that, T = K̂ / R. So the feedforward of friction F is a ramp that begins before the reversal::

    F = K̂ φ((dq_d + 0.67 T ddq_d) / (|ddq_d| T))                                          (FR1)
    φ(s) = s for |s| <= 1 + β, from there back to sgn s at |s| = 1 + 2 β                   (FR2)

dq_d / |ddq_d| is the time to the reversal, so no point of the reference ahead is needed. With the
overshoot β = 0.35 the first moment of φ - sgn is 0, and the ramp leaves no position error behind::

    (1 + β)³ / 3 - (1 + β)² / 2 + β² / 2 + 2 β³ / 3 = 0

During the ramp the joint cannot be on the reference q_d. A feedback that insists on it makes the
joint stick until the torque has changed by 2 K̂. So the feedback gets q_d + x. The ramp moves the
joint by x, which then returns to 0::

    ddx = (F - f) / M_ii - 2 w dx - w² x,     f ∈ K̂ Sgn(dq_d + dx)⁺, implicit              (FR3)
    w = min(0.6 √Kp_ii, ½ / h, 0.55 / T, (J / |x|)^⅓, (J / |dx|)^½),     J = ½ R / M_ii    (FR4)

Where the reference stands, F - f is left out, or x would stick, and nothing would bring it back.
J is half of the jerk that the drive can give the joint. x begins at the distance of the robot from
q_d, so the start is smooth from anywhere. Where the torque falls short by more than 10 ms R, dx
takes over the shortfall beyond that, which keeps the loop from winding up::

    dx -= M⁻¹ (shortfall) / (Kv_ii + T_a Kp_ii)                                            (FR5)

T_a is the lag of the drive. The torque of (OF4) changes with dx by about the divisor, in the
metric of M. With a smaller divisor (FR5) would overshoot.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import every, function, record, solve, some, Truths
from ctc_chattering.control.sample import Desired
from ctc_chattering.numerics.box_qp import clip
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Overshoot β of (FR2).
OVERSHOOT = 0.35
#: Keeps a quotient finite.
_TINY = 1e-12


@record
class Deviation(NamedTuple):
    """x and dx of (FR3) [rad, rad/s]."""

    x: Array
    dx: Array


@record
class FeasibleReference(NamedTuple):
    """
    Shifts a reference by the deviation that drives need.

    Attributes
    ----------
    period : float
        h [s].
    rate : ndarray, shape (n,)
        R, inf for none [N·m/s].
    fastest : ndarray, shape (n,)
        Largest w [1/s].
    relief : ndarray, shape (n,)
        Kv_ii + T_a Kp_ii [1/s].

    """

    period: float
    rate: Array
    fastest: Array
    relief: Array

    def slow_down(self, factor: float) -> FeasibleReference:
        """Return a copy with a factor on w."""
        return self._replace(fastest=factor * self.fastest)

    def feed_forward(self, point: Desired, level: Array, ahead: float = 0.0) -> Array:
        """Return F of (FR1) [N·m], `ahead` of a point [s]."""
        T = np.maximum(level / self.rate, 1e-6)  # A shorter ramp is a step.
        lead = 0.67 * T + ahead
        dq = point.dq + lead * point.ddq
        half_width = np.maximum(np.abs(point.ddq) * T, _TINY)
        return level * ramp(dq / half_width)

    def advance(self, point: Desired, deviation: Deviation, recovery: Array, inertia: Array,
                level: Array) -> Deviation:
        """
        Return the deviation a period later, by (FR3).

        Parameters
        ----------
        point, deviation : Desired, Deviation
            The point, and its deviation.
        recovery : array, shape (n,)
            Of `compute_recovery` [rad/s²].
        inertia : array, shape (n,)
            M_ii [kg·m²].
        level : array, shape (n,)
            K̂ [N·m].

        """
        h = self.period
        F = self.feed_forward(point, level, 0.5 * h)
        dq = point.dq + deviation.dx
        holding = inertia * (dq / h + point.ddq + recovery) + F
        f = clip(holding, -level, level)
        pushed = np.where(reference_stands(point), 0.0, (F - f) / inertia)
        ddx = pushed + recovery
        mean_dx = deviation.dx + 0.5 * h * ddx
        return Deviation(deviation.x + h * mean_dx, deviation.dx + h * ddx)

    def relieve(self, deviation: Deviation, shortfall: Array, mass: Array) -> Deviation:
        """Return the deviation after (FR5), for a shortfall [N·m]."""
        slack = 10e-3 * self.rate
        excess = shortfall - clip(shortfall, -slack, slack)
        if not some(excess):
            return deviation
        relief = solve(mass, excess) / self.relief
        return deviation._replace(dx=deviation.dx - relief)

    def compute_recovery(self, deviation: Deviation, inertia: Array, level: Array) -> Array:
        """Return -2 w dx - w² x of (FR3)."""
        x = deviation.x
        dx = deviation.dx
        jerk = 0.5 * self.rate / inertia
        of_ramp = 0.55 * self.rate / np.maximum(level, _TINY)
        of_x = np.cbrt(jerk / np.maximum(np.abs(x), _TINY))
        of_dx = np.sqrt(jerk / np.maximum(np.abs(dx), _TINY))
        w = np.minimum(np.minimum(self.fastest, of_ramp), np.minimum(of_x, of_dx))
        return -w * (2.0 * dx + w * x)


@function
def design_reference(kp: Array, kv: Array, rate: Array, lag: Array, period: float
                     ) -> FeasibleReference:
    """
    Return the feasible reference for gains and drives.

    Parameters
    ----------
    kp, kv : array, shape (n,)
        Diagonals of Kp [1/s²] and Kv [1/s].
    rate, lag : array, shape (n,)
        R, inf for none [N·m/s], and T_a [s].
    period : float
        h [s].

    """
    fastest = np.minimum(0.6 * np.sqrt(kp), 0.5 / period)
    return FeasibleReference(period, rate, fastest, kv + lag * kp)


@function
def next_point(point: Desired, step: Array, h: float) -> Desired:
    """
    Return the point a period h [s] later.

    Meanwhile ddq_d changes by `step` [rad/s²].
    """
    mean_dq = point.dq + h * (0.5 * point.ddq + step / 6.0)
    mean_ddq = point.ddq + 0.5 * step
    return Desired(
        point.q + h * mean_dq,
        point.dq + h * mean_ddq,
        point.ddq + step)


@function
def reference_stands(point: Desired) -> Truths:
    """Return the joints whose reference stands, shape (n,)."""
    return (np.abs(point.dq) <= 1e-9) & (np.abs(point.ddq) <= 1e-9)  # Up to rounding.


@function
def ramp(s: Array) -> Array:
    """Return φ of (FR2)."""
    size = np.abs(s)
    top = 1.0 + OVERSHOOT
    if every(size >= 1.0 + 2.0 * OVERSHOOT):
        return np.sign(s)
    way_back = np.maximum(2.0 * top - size, 1.0)
    phi: Array = np.sign(s) * np.where(size <= top, size, way_back)
    return phi
