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
Rest: at a joint that stands where the reference stands, the perturbation is kept.

A joint that sticks shows nothing of the perturbation, so that an estimate, and its slope even
more, drifts until the joint breaks loose, slips and sticks again: without end where friction at
rest exceeds that of sliding. So P̂ is kept, with the slope 0, once::

    s t >= W²,     s >= 2 / ω,     W = 6 / ω + Ka / R                                      (SS1)
    K̂ s² >= 4 δ M_ii                                                                       (SS2)

s is the time for which the measured position has been within δ = 1e-4 rad (or m), t that for
which dq_d and ddq_d are 0; W is what observer and drives need to free a joint. A constant torque
beyond 4 δ M_ii / s² moves a joint by 2 δ within s: by (SS2) the learned friction K̂ can hold the
one that acts, and a joint without friction is never held. P̂ is estimated again when the measured
position leaves ±δ or the reference moves; t then begins again. Position and velocity are observed
all the time, so that nothing jumps, and a joint that does move under a kept P̂ is under the
feedback of a stable loop.

A joint that sticks under a constant torque goes on sticking until its load has changed by what
static friction has in reserve. Where every stop takes s₁ >= 2 / ω, slips end by t = W² / s₁, at
most W² ω / 2. What is left is the error at that stop.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.control.feasible_reference import Desired, stands
from ctc_chattering.control.state_observer import Observed
from ctc_chattering.numerics.compilable import function, record, some
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: δ [rad]; with more noise of the position no joint is held.
TOLERANCE = 1e-4
#: W, and the shortest stop, in 1 / ω.
_PATIENCE, _SHORTEST = 6.0, 2.0


@record
class Rest(NamedTuple):
    """How each joint rests; arrays of shape (n,)."""

    #: The measured position at which the joint came to stand [rad].
    place: Array
    #: s and t of (SS1) [s].
    joint: Array
    reference: Array
    #: Whether it is held, 1.0 or 0.0.
    held: Array


@record
class Standstill(NamedTuple):
    """Decides which joints are held; made by `standstill`."""

    #: h, W and the shortest stop [s], shape (n,).
    period: Array
    patience: Array
    shortest: Array

    def placed_at(self, rest: Rest, q: Array) -> Rest:
        """Return the rest after a measured position, shape (n,) [rad]."""
        moved = np.abs(q - rest.place) > TOLERANCE
        return Rest(np.where(moved, q, rest.place),
                    np.where(moved, 0.0, rest.joint + self.period),
                    np.where(moved & (rest.held != 0.0), 0.0, rest.reference),
                    np.where(moved, 0.0, rest.held))

    def judged(self, rest: Rest, at: Desired, inertia: Array, level: Array) -> Rest:
        """
        Return the rest with the joints that (SS1) and (SS2) hold; arrays of shape (n,).

        Parameters
        ----------
        rest : Rest
            After `placed_at`.
        at : Desired
            Point of the reference at the arrival of the torque.
        inertia : array, shape (n,)
            M_ii [kg·m²].
        level : array, shape (n,)
            K̂ [N·m].

        """
        still, s = stands(at), rest.joint
        t = np.where(still, rest.reference + self.period, 0.0)
        long = (s >= self.shortest) & (s * t >= self.patience * self.patience)
        sticks = level * s * s >= 4.0 * TOLERANCE * inertia
        return Rest(rest.place, s, t, np.where(still & long & sticks, 1.0, 0.0))


@function
def kept(rest: Rest, before: Observed, after: Observed) -> Observed:
    """Return `after` with the perturbation of joints that are held as it is in `before`."""
    if not some(rest.held):
        return after
    held = rest.held != 0.0
    return Observed(after.q, after.dq, after.torque,
                    np.where(held, before.perturbation, after.perturbation),
                    np.where(held, 0.0, after.slope))


def standstill(bandwidth: float, bound: Array, rate: Array, period: float) -> Standstill:
    """
    Return what holds joints.

    Parameters
    ----------
    bandwidth : float
        ω [rad/s].
    bound, rate : array, shape (n,)
        Ka [N·m], and R, inf for none [N·m/s].
    period : float
        h [s].

    """
    one = np.ones_like(bound)
    return Standstill(period * one, _PATIENCE / bandwidth + bound / rate,
                      _SHORTEST / bandwidth * one)


def moving(zero: Array) -> Rest:
    """Return that no joint rests yet, for zeros of shape (n,)."""
    return Rest(zero, zero, zero, zero)
