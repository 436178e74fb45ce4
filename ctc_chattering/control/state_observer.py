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
An observer of position, velocity and perturbation that is driven by position and torque.

Its model has the drives (`drive_model`), so that it knows the torque that acts, and Coulomb's
friction f of the level K̂, implicit as in docs/theory.md. Over a period::

    f ∈ K̂ Sgn(dq⁺),   a = M⁻¹ (τ - C dq - G - f - P̂),   dq⁺ = dq + h a,   P̂⁺ = P̂ + h Ṗ̂   (SO1)

and q⁺ likewise, each with its own mean of τ and P̂ over the period. The measured position
corrects this; the velocity is not measured. With ε = q - q̂ and θ = exp(-ω h)::

    q̂  += (1 - θ⁴) ε
    dq̂ += (1 - θ)² (11 + 14 θ + 11 θ²) ε / (6 h)
    P̂  -= M 2 (1 - θ)³ (1 + θ) ε / h²
    Ṗ̂  -= M (1 - θ)⁴ ε / h³                                                           (SO2)

which puts the four poles of the error at θ: the cubic fading-memory filter (Morrison 1969).
The slope Ṗ̂ leaves of a perturbation of the frequency w, for w « ω, 6 (w / ω)²; without it there
would be 3 w / ω. P̂ is within ±Ka in the metric of M⁻¹; at a bound, Ṗ̂ does not lead out.
"""

from __future__ import annotations

from math import exp
from typing import NamedTuple

from ctc_chattering.control.drive_model import DriveModel
from ctc_chattering.numerics.box_qp import nearest, nearest_and_rest
from ctc_chattering.numerics.compilable import dot, record, solve, some
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class Observed(NamedTuple):
    """A state of robot and drives; arrays of shape (n,)."""

    #: Position [rad] and velocity [rad/s].
    q: Array
    dq: Array
    #: Torque of the drives [N·m].
    torque: Array
    #: P̂ [N·m] and its slope [N·m/s].
    perturbation: Array
    slope: Array


@record
class StateObserver(NamedTuple):
    """Estimates the state, sample by sample; made by `state_observer`."""

    #: Between command and torque.
    drives: DriveModel
    #: Ka [N·m], shape (n,).
    bound: Array
    #: Gains of (SO2), those of P̂ and its slope without M; of shape (n,), because a product with
    #: a float takes twice as long.
    position: Array
    velocity: Array
    force: Array
    jerk: Array
    #: h, h / 2 and h / 6 [s], shape (n,).
    period: Array
    half: Array
    sixth: Array

    def slowed(self, part: float) -> StateObserver:
        """Return the observer with a part of the bandwidth of P̂, and of its bound."""
        return StateObserver(
            self.drives, np.sqrt(part) * self.bound, self.position, self.velocity,
            part * self.force, part * part * self.jerk, self.period, self.half, self.sixth)

    def predict(self, at: Observed, mass: Array, bias: Array, level: Array, command: Array
                ) -> Observed:
        """
        Return the state a period later, by (SO1).

        Parameters
        ----------
        at : Observed
            The state now.
        mass, bias : array, shape (n, n) and (n,)
            M [kg·m²] and C dq + G [N·m] there.
        level : array, shape (n,)
            K̂ [N·m].
        command : array, shape (n,)
            Torque commanded for the period [N·m].

        """
        h, half, drive = self.period, self.half, self.drives.response(at.torque, command)
        mean = drive.mean - (bias + at.perturbation + half * at.slope)
        _, rest = nearest_and_rest(mass, dot(mass, at.dq) / h + mean, level)
        dq = h * rest
        other = drive.weighted - drive.mean + self.sixth * at.slope
        q = at.q + half * (at.dq + dq)
        if some(other):
            q = q + half * h * solve(mass, other)
        return Observed(q, dq, drive.end, at.perturbation + h * at.slope, at.slope)

    def correct(self, at: Observed, mass: Array, q: Array) -> Observed:
        """Return the state with what the measured position `q`, (n,) [rad], says, by (SO2)."""
        error = q - at.q
        load = dot(mass, error)
        P, slope = at.perturbation - self.force * load, at.slope - self.jerk * load
        bounded = nearest(mass, P, self.bound)
        at_bound = np.abs(bounded) >= self.bound
        if some(at_bound):
            slope = np.where(at_bound & (slope * bounded > 0.0), 0.0, slope)
        return Observed(at.q + self.position * error, at.dq + self.velocity * error, at.torque,
                        bounded, slope)


def state_observer(drives: DriveModel, bandwidth: float, bound: Array) -> StateObserver:
    """
    Return an observer.

    Parameters
    ----------
    drives : DriveModel
        Between command and torque, with the period h.
    bandwidth : float
        ω [rad/s].
    bound : array, shape (n,)
        Ka [N·m].

    """
    h, pole = drives.period, exp(-bandwidth * drives.period)
    rest = 1.0 - pole
    return StateObserver(drives, bound, *(np.full(len(bound), x) for x in (
        1.0 - pole ** 4, rest ** 2 * (11.0 + 14.0 * pole + 11.0 * pole ** 2) / (6.0 * h),
        2.0 * rest ** 3 * (1.0 + pole) / h ** 2, rest ** 4 / h ** 3, h, h / 2.0, h / 6.0)))
