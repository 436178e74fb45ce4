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
Rest: a joint that stands where the reference stands gets a constant torque.

A joint that sticks shows nothing of the perturbation, so that an estimate, and its slope even
more, drifts until the joint breaks loose, slips and sticks again: without end where friction at
rest exceeds that of sliding. So a joint is held once::

    s t >= W²,     s >= 2 / ω,     W = 6 / ω + Ka / R                                      (SS1)
    M_ii Kp_ii |q_d - q̂| <= 2 Ka                                                          (SS2)

s is the time for which the measured position has been within δ = 1e-4 rad (or m), t that for
which dq_d and ddq_d are 0; W is what observer and drives need to free a joint. While it is held,
q̂, P̂ and the deviation of the reference stay as they are, dq̂ and Ṗ̂ are 0. It is released when
the measured position leaves ±δ or the reference moves; t then begins again.

Its torque is constant, but for what the model says of other joints that move. A joint that
sticks then goes on sticking until its load has changed by what static friction has in reserve.
Where every stop takes s₁ >= 2 / ω, with errors within (SS2), slips end by t = W² / s₁, at most
W² ω / 2. What is left is the error at that stop.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.control.feasible_reference import Desired, Deviation, stands
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
    #: 2 Ka / Kp_ii [kg·m²·rad], shape (n,).
    reach: Array

    def placed_at(self, rest: Rest, q: Array) -> Rest:
        """Return the rest after a measured position, shape (n,) [rad]."""
        moved = np.abs(q - rest.place) > TOLERANCE
        return Rest(np.where(moved, q, rest.place),
                    np.where(moved, 0.0, rest.joint + self.period),
                    np.where(moved & (rest.held != 0.0), 0.0, rest.reference),
                    np.where(moved, 0.0, rest.held))

    def judged(self, rest: Rest, at: Desired, q: Array, inertia: Array) -> Rest:
        """
        Return the rest with the joints that (SS1) holds; arrays of shape (n,).

        Parameters
        ----------
        rest : Rest
            After `placed_at`.
        at : Desired
            Point of the reference at the arrival of the torque.
        q : array, shape (n,)
            q̂ there [rad].
        inertia : array, shape (n,)
            M_ii [kg·m²].

        """
        still = stands(at)
        t = np.where(still, rest.reference + self.period, 0.0)
        near = inertia * np.abs(at.q - q) <= self.reach
        long = (rest.joint >= self.shortest) & (rest.joint * t >= self.patience * self.patience)
        held = still & ((rest.held != 0.0) | (near & long))
        return Rest(rest.place, rest.joint, t, np.where(held, 1.0, 0.0))


@function
def corrected(before: Rest, after: Rest, at: Observed, to: Observed, q: Array) -> Observed:
    """
    Return what a measured position makes of an observed state.

    Parameters
    ----------
    before, after : Rest
        Without and with this position.
    at, to : Observed
        The state, and what the observer makes of it.
    q : array, shape (n,)
        The position [rad], from which a joint that is released is observed.

    """
    to = kept(after, at, to)
    released = (before.held != 0.0) & (after.held == 0.0)
    if not some(released):
        return to
    return Observed(np.where(released, q, to.q), np.where(released, 0.0, to.dq), to.torque,
                    np.where(released, at.perturbation, to.perturbation),
                    np.where(released, 0.0, to.slope))


@function
def kept(rest: Rest, before: Observed, after: Observed) -> Observed:
    """Return `after` with joints that are held as they are in `before`, at rest."""
    if not some(rest.held):
        return after
    held = rest.held != 0.0
    return Observed(np.where(held, before.q, after.q), np.where(held, 0.0, after.dq),
                    after.torque, np.where(held, before.perturbation, after.perturbation),
                    np.where(held, 0.0, after.slope))


@function
def waiting(rest: Rest, before: Deviation, after: Deviation) -> Deviation:
    """Return `after` with the deviation of joints that are held as it is in `before`."""
    if not some(rest.held):
        return after
    held = rest.held != 0.0
    return Deviation(np.where(held, before.x, after.x), np.where(held, before.dx, after.dx))


def standstill(bandwidth: float, bound: Array, kp: Array, rate: Array, period: float
               ) -> Standstill:
    """
    Return what holds joints.

    Parameters
    ----------
    bandwidth : float
        ω [rad/s].
    bound, kp, rate : array, shape (n,)
        Ka [N·m], diagonal of Kp [1/s²], and R, inf for none [N·m/s].
    period : float
        h [s].

    """
    one = np.ones_like(bound)
    return Standstill(period * one, _PATIENCE / bandwidth + bound / rate,
                      _SHORTEST / bandwidth * one, 2.0 * bound / kp)


def moving(zero: Array) -> Rest:
    """Return that no joint rests yet, for zeros of shape (n,)."""
    return Rest(zero, zero, zero, zero)
