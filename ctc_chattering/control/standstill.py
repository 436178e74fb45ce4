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
Standstill, at which the estimate P̂ of a joint is held.

The law `observer_feedback` asks at every sample which joints stand where their reference stands.
A joint that sticks shows nothing of the
perturbation. So an estimate, and its slope even more, drifts until the joint breaks loose, slips
and sticks again: without end where friction at rest exceeds that of sliding. Therefore P̂ is held,
with the slope 0, once::

    s t >= W²,     s >= 2 / ω,     W = 6 / ω + Ka / R                                      (SS1)
    K̂ s² >= 4 δ M_ii                                                                       (SS2)

s is the time for which the measured position has been within δ = 1e-4 rad (or m). t is the time
for which dq_d and ddq_d are 0. W is the time that observer and drives need to free a joint. A
constant torque beyond 4 δ M_ii / s² moves a joint by 2 δ within s. By (SS2) the learned friction
K̂ can hold the torque that acts, and a joint without friction is never held. P̂ is estimated again
when the measured position leaves ±δ or the reference moves. Then t begins again. Position and
velocity are observed all the time, so that nothing jumps. A joint that does move under a held P̂
is under the feedback of a stable loop.

A joint that sticks under a constant torque goes on sticking until its load has changed by what
static friction has in reserve. Where every stop takes s₁ >= 2 / ω, slips end by t = W² / s₁, at
most W² ω / 2. The error at that stop remains.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import function, record, some
from ctc_chattering.control.feasible_reference import reference_stands
from ctc_chattering.control.observer import Observed
from ctc_chattering.control.sample import Desired
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: δ [rad]. With more noise of the position no joint is held.
TOLERANCE_RAD = 1e-4
#: Part of W that the observer needs, in 1 / ω.
OBSERVER_PERIODS = 6.0


@record
class Standstill(NamedTuple):
    """
    Standstill of every joint, each of shape (n,).

    Attributes
    ----------
    position : ndarray
        Measured position at which the joint came to stand [rad].
    joint_time, reference_time : ndarray
        s and t of (SS1) [s].
    held : ndarray
        Truth of: its P̂ is held.

    """

    position: Array
    joint_time: Array
    reference_time: Array
    held: Array


@record
class StandstillDetector(NamedTuple):
    """
    Decides at which joints P̂ is held.

    Attributes
    ----------
    period, bandwidth : float
        h [s] and ω [rad/s].
    patience : ndarray, shape (n,)
        W [s].

    """

    period: float
    bandwidth: float
    patience: Array

    def track_position(self, last: Standstill, q: Array) -> Standstill:
        """Return the standstill after a measured position [rad]."""
        moved = np.abs(q - last.position) > TOLERANCE_RAD
        breaks_loose = moved & (last.held != 0.0)
        return Standstill(
            position=np.where(moved, q, last.position),
            joint_time=np.where(moved, 0.0, last.joint_time + self.period),
            reference_time=np.where(breaks_loose, 0.0, last.reference_time),
            held=np.where(moved, 0.0, last.held))

    def detect_standstill(self, last: Standstill, point: Desired, inertia: Array, level: Array
                          ) -> Standstill:
        """
        Return the standstill by (SS1) and (SS2).

        Parameters
        ----------
        last : Standstill
            After `track_position`.
        point : Desired
            Point of the reference at the arrival of the torque.
        inertia : array, shape (n,)
            M_ii [kg·m²].
        level : array, shape (n,)
            K̂ [N·m].

        """
        still = reference_stands(point)
        s = last.joint_time
        t = np.where(still, last.reference_time + self.period, 0.0)
        is_observed = s >= 2.0 / self.bandwidth
        is_patient = s * t >= self.patience * self.patience
        sticks = level * s * s >= 4.0 * TOLERANCE_RAD * inertia
        held = np.where(still & is_observed & is_patient & sticks, 1.0, 0.0)
        return last._replace(reference_time=t, held=held)


@function
def hold_standing(standstill: Standstill, before: Observed, corrected: Observed) -> Observed:
    """Return `corrected` with P̂ of held joints as `before`."""
    if not some(standstill.held):
        return corrected
    held = standstill.held != 0.0
    return corrected._replace(
        perturbation=np.where(held, before.perturbation, corrected.perturbation),
        slope=np.where(held, 0.0, corrected.slope))


@function
def design_detector(bandwidth: float, bound: Array, rate: Array, period: float
                    ) -> StandstillDetector:
    """
    Return the detector for an observer and drives.

    Parameters
    ----------
    bandwidth : float
        ω [rad/s].
    bound, rate : array, shape (n,)
        Ka [N·m], and R, inf for none [N·m/s].
    period : float
        h [s].

    """
    patience = OBSERVER_PERIODS / bandwidth + bound / rate
    return StandstillDetector(period, bandwidth, patience)
