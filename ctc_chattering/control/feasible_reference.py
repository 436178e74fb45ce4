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
A reference that drives with a limited rate can follow, where friction changes its sign.

At a reversal the torque of a joint has to change by 2 K̂, for which a drive with the rate limit R
takes 2 T, T = K̂ / R. The feedforward of friction F is a ramp that begins before the reversal::

    F = K̂ φ((dq_d + 0.67 T ddq_d) / (|ddq_d| T))                                          (FR1)
    φ(s) = s for |s| <= 1 + β, from there back to sgn s at |s| = 1 + 2 β                   (FR2)

dq_d / |ddq_d| is the time to the reversal, so no point of the reference ahead is needed. With the
overshoot β = 0.35 the first moment of φ - sgn is 0::

    (1 + β)³ / 3 - (1 + β)² / 2 + β² / 2 + 2 β³ / 3 = 0

so that the ramp leaves no position error behind. During the ramp the joint cannot be on the
reference q_d. A feedback that insists on it makes the joint stick until the torque has changed by
2 K̂. So the feedback gets q_d + x; x is what the ramp does to the joint, and returns to 0::

    ddx = (F - f) / M_ii - 2 w dx - w² x,     f ∈ K̂ Sgn(dq_d + dx)⁺, implicit              (FR3)
    w = min(0.6 √Kp_ii, ½ / h, 0.55 / T, (J / |x|)^⅓, (J / |dx|)^½),     J = ½ R / M_ii    (FR4)

Where the reference stands, F - f is left out, or x would stick, and nothing would bring it back.
J is half of the jerk that the drive can give the joint. x begins at the distance of the robot from
q_d: the start is smooth from anywhere. Where the drives give less than what is asked for by more
than 10 ms R, the rest is taken from dx, which keeps the loop from winding up::

    dx -= M⁻¹ (rest) / (Kv_ii + T_a Kp_ii)                                                 (FR5)

T_a is the lag of the drive. What (OF4) asks for changes with dx by about the divisor, in the
metric of M; with less of it (FR5) would overshoot.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import every, function, record, solve, some, Truths
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: β of (FR2); the lead of (FR1), in T; of (FR4), the factors of √Kp, 1 / T, R / M_ii and 1 / h.
OVERSHOOT, _LEAD = 0.35, 0.67
_RETURN, _RAMP_RETURN, _PART, _STEP = 0.6, 0.55, 0.5, 0.5
#: How far the drives may be behind before (FR5) acts [s].
_BEHIND = 10e-3
#: Up to this velocity [rad/s] and acceleration [rad/s²] the reference stands.
_STANDS = 1e-9
#: The shortest ramp [s], and what keeps a quotient finite.
_LEAST, _TINY = 1e-6, 1e-12


@record
class Desired(NamedTuple):
    """A point of the reference; arrays of shape (n,) [rad, rad/s, rad/s²]."""

    q: Array
    dq: Array
    ddq: Array


@record
class Deviation(NamedTuple):
    """x and dx of the module; arrays of shape (n,) [rad, rad/s]."""

    x: Array
    dx: Array


@record
class FeasibleReference(NamedTuple):
    """Adds to a reference the deviation that the drives need; made by `feasible_reference`."""

    #: h [s].
    period: float
    #: R, inf for none [N·m/s]; fastest return [1/s]; Kv_ii + T_a Kp_ii [1/s]. Shape (n,).
    rate: Array
    fastest: Array
    relief: Array
    #: Whether any drive has a limit of the rate, 1.0 or 0.0.
    limited: float

    def slowed(self, part: float) -> FeasibleReference:
        """Return what a deviation returns with a part of the fastest w by."""
        return self._replace(fastest=part * self.fastest)

    def feedforward(self, at: Desired, level: Array, ahead: float = 0.0) -> Array:
        """Return F of (FR1), shape (n,) [N·m], at `ahead` [s] after the point `at`."""
        T = np.maximum(level / self.rate, _LEAST)
        dq = at.dq + (_LEAD * T + ahead) * at.ddq
        return level * ramp(dq / np.maximum(np.abs(at.ddq) * T, _TINY))

    def shifted(self, at: Desired, by: Deviation, back: Array) -> Desired:
        """Return `at` with the deviation and `returning`; without the ramp's acceleration."""
        return Desired(at.q + by.x, at.dq + by.dx, at.ddq + back)

    def following(self, at: Desired, by: Deviation, back: Array, inertia: Array, level: Array
                  ) -> Deviation:
        """
        Return the deviation a period after the point `at`, by (FR3).

        Parameters
        ----------
        at, by : Desired, Deviation
            The point, and its deviation.
        back : array, shape (n,)
            `returning` [rad/s²].
        inertia : array, shape (n,)
            M_ii [kg·m²].
        level : array, shape (n,)
            K̂ [N·m].

        """
        h = self.period
        F = self.feedforward(at, level, 0.5 * h)
        holding = inertia * ((at.dq + by.dx) / h + at.ddq + back) + F
        f = np.minimum(np.maximum(holding, -level), level)
        ddx = np.where(stands(at), 0.0, (F - f) / inertia) + back
        return Deviation(by.x + h * (by.dx + 0.5 * h * ddx), by.dx + h * ddx)

    def relieved(self, by: Deviation, missing: Array, mass: Array) -> Deviation:
        """Return the deviation after (FR5), for a torque that falls short by `missing` [N·m]."""
        if self.limited == 0.0:
            return by
        slack = _BEHIND * self.rate
        rest = missing - np.minimum(np.maximum(missing, -slack), slack)
        if not some(rest):
            return by
        return by._replace(dx=by.dx - solve(mass, rest) / self.relief)

    def returning(self, by: Deviation, inertia: Array, level: Array) -> Array:
        """Return -2 w dx - w² x of (FR3), shape (n,) [rad/s²]."""
        if self.limited == 0.0:
            return -self.fastest * (by.dx + by.dx + self.fastest * by.x)
        jerk = _PART * self.rate / inertia
        w = np.minimum(
            np.minimum(self.fastest, _RAMP_RETURN * self.rate / np.maximum(level, _TINY)),
            np.minimum(np.cbrt(jerk / np.maximum(np.abs(by.x), _TINY)),
                       np.sqrt(jerk / np.maximum(np.abs(by.dx), _TINY))))
        return -w * (2.0 * by.dx + w * by.x)


def feasible_reference(kp: Array, kv: Array, rate: Array, lag: Array, period: float
                       ) -> FeasibleReference:
    """
    Return what shifts a reference.

    Parameters
    ----------
    kp, kv : array, shape (n,)
        Diagonals of Kp [1/s²] and Kv [1/s].
    rate : array, shape (n,)
        R [N·m/s]; inf for none.
    lag : array, shape (n,)
        T_a [s].
    period : float
        h [s].

    """
    fastest = np.minimum(_RETURN * np.sqrt(kp), _STEP / period)
    return FeasibleReference(period, rate, fastest, kv + lag * kp,
                             float(np.isfinite(rate).any()))


@function
def next_point(at: Desired, step: Array, h: float) -> Desired:
    """Return the point a period h [s] after `at`, ddq_d changing by `step` [rad/s²] until then."""
    return Desired(at.q + h * (at.dq + h * (0.5 * at.ddq + step / 6.0)),
                   at.dq + h * (at.ddq + 0.5 * step), at.ddq + step)


@function
def stands(at: Desired) -> Truths:
    """Return of which joints the reference stands, shape (n,)."""
    return (np.abs(at.dq) <= _STANDS) & (np.abs(at.ddq) <= _STANDS)


@function
def ramp(s: Array) -> Array:
    """Return φ of (FR2)."""
    size, top = np.abs(s), 1.0 + OVERSHOOT
    if every(size >= 1.0 + 2.0 * OVERSHOOT):
        return np.sign(s)
    phi: Array = np.sign(s) * np.where(size <= top, size, np.maximum(2.0 * top - size, 1.0))
    return phi
