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
Observer of position, velocity and perturbation.

The laws `observer_feedback` and `extended_state_observer` use it, with the parameters of
`ControllerConfig`. Measured position and sent torque drive it. Its model has the drives
(`dynamics/drive_response.py`), so that it knows the torque that acts. It also has Coulomb's
friction f of the level K̂, implicit as in docs/theory.md. Over a period::

    f ∈ K̂ Sgn(dq⁺),   a = M⁻¹ (τ - C dq - G - f - P̂),   dq⁺ = dq + h a,   P̂⁺ = P̂ + h Ṗ̂   (SO1)

and q⁺ likewise, each with its own mean of τ and P̂ over the period. The measured position
corrects this. The velocity is not measured. With ε = q - q̂ and θ = exp(-ω h)::

    q̂  += (1 - θ⁴) ε
    dq̂ += (1 - θ)² (11 + 14 θ + 11 θ²) ε / (6 h)
    P̂  -= M 2 (1 - θ)³ (1 + θ) ε / h²
    Ṗ̂  -= M (1 - θ)⁴ ε / h³                                                           (SO2)

This puts the four poles of the error at θ: the cubic fading-memory filter (Morrison 1969).
Of a perturbation of the frequency w « ω, the slope Ṗ̂ leaves 6 (w / ω)². P̂ is within ±Ka in the
metric of M⁻¹. At a bound, Ṗ̂ does not lead out.

Without the slope the observer has three poles, by the quadratic filter of the same book::

    q̂  += (1 - θ³) ε
    dq̂ += 3 (1 - θ)² (1 + θ) ε / (2 h)
    P̂  -= M (1 - θ)³ ε / h²,     Ṗ̂ = 0                                                  (SO3)

It leaves 3 w / ω of the same perturbation, and tolerates a larger error of the inertia. With
M̂ = c M under computed torque with the double pole p, without lag and delay and for h → 0, the
characteristic polynomial of a joint is::

    (s + p)² (s + ω)³ + (c - 1) ω ((ω² + 6 p ω + 3 p²) s² + p ω (2 ω + 3 p) s + p² ω²)    (SO4)

It is stable for 0.20 < c < 4.7 with ω = 4 p.
"""

from __future__ import annotations

from math import exp
from typing import NamedTuple

from ctc_chattering.compiled.compilable import dot, function, record, solve, some
from ctc_chattering.dynamics.drive_response import DriveModel
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.box_qp import nearest, nearest_and_motion
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class Observed(NamedTuple):
    """
    Observed state of robot and drives.

    Attributes
    ----------
    q, dq : ndarray
        Position [rad] and velocity [rad/s].
    torque : ndarray
        Torque of the drives [N·m].
    perturbation, slope : ndarray
        P̂ [N·m] and Ṗ̂ [N·m/s].

    """

    q: Array
    dq: Array
    torque: Array
    perturbation: Array
    slope: Array


@record
class ModelTerms(NamedTuple):
    """Dynamics in a state of robot and drives."""

    state: Observed
    #: M [kg·m²], shape (n, n).
    M: Array
    #: C dq + G [N·m], shape (n,).
    bias: Array


@function
def evaluate_model(model: Model, state: Observed) -> ModelTerms:
    """Return the dynamics in a state."""
    M, C, G = model.evaluate(state.q, state.dq)
    return ModelTerms(state, M, dot(C, state.dq) + G)


@record
class StateObserver(NamedTuple):
    """
    Observer of the state, sample by sample.

    Attributes
    ----------
    drives : DriveModel
        Between command and torque.
    bound : ndarray, shape (n,)
        Ka [N·m].
    position, velocity, force, jerk : float
        Gains of (SO2), without M.

    """

    drives: DriveModel
    bound: Array
    position: float
    velocity: float
    force: float
    jerk: float

    def slow_down(self, factor: float) -> StateObserver:
        """
        Return a copy with a factor on its bandwidth.

        The bandwidth is that of P̂. The root of the factor multiplies the bound.
        """
        return self._replace(bound=np.sqrt(factor) * self.bound, force=factor * self.force,
                             jerk=factor * factor * self.jerk)

    def predict(self, model: ModelTerms, level: Array, command: Array) -> Observed:
        """
        Return the state a period later, by (SO1).

        Parameters
        ----------
        model : ModelTerms
            State and dynamics at the start of the period.
        level : array, shape (n,)
            K̂ [N·m].
        command : array, shape (n,)
            Torque commanded for the period [N·m].

        """
        h = self.drives.period
        state = model.state
        drive = self.drives.follow(state.torque, command)
        load = drive.mean - (model.bias + state.perturbation + 0.5 * h * state.slope)
        holding = dot(model.M, state.dq) / h + load
        _, dq_over_h = nearest_and_motion(model.M, holding, level)
        dq = h * dq_over_h
        q = state.q + 0.5 * h * (state.dq + dq)
        asymmetry = drive.weighted - drive.mean + h / 6.0 * state.slope
        if some(asymmetry):
            q = q + 0.5 * h * h * solve(model.M, asymmetry)
        perturbation = state.perturbation + h * state.slope
        return Observed(q, dq, drive.end, perturbation, state.slope)

    def correct(self, state: Observed, mass: Array, q: Array) -> Observed:
        """Return the state corrected with the measured q (SO2)."""
        error = q - state.q
        load = dot(mass, error)
        perturbation = nearest(mass, state.perturbation - self.force * load, self.bound)
        slope = state.slope - self.jerk * load
        at_bound = np.abs(perturbation) >= self.bound
        if some(at_bound):
            leads_out = slope * perturbation > 0.0
            slope = np.where(at_bound & leads_out, 0.0, slope)
        return state._replace(
            q=state.q + self.position * error,
            dq=state.dq + self.velocity * error,
            perturbation=perturbation,
            slope=slope)


def design_observer(drives: DriveModel, bandwidth: float, bound: Array, slope: bool = True
                    ) -> StateObserver:
    """
    Return an observer with all poles at its bandwidth.

    Parameters
    ----------
    drives : DriveModel
        Between command and torque, with the period h.
    bandwidth : float
        ω [rad/s].
    bound : array, shape (n,)
        Ka [N·m].
    slope : bool
        Have the slope Ṗ̂ as a state (SO2), or without it (SO3).

    """
    h = drives.period
    pole = exp(-bandwidth * h)
    rate = 1.0 - pole
    if not slope:
        return StateObserver(
            drives,
            bound,
            position=1.0 - pole ** 3,
            velocity=1.5 * rate ** 2 * (1.0 + pole) / h,
            force=rate ** 3 / h ** 2,
            jerk=0.0)
    return StateObserver(
        drives,
        bound,
        position=1.0 - pole ** 4,
        velocity=rate ** 2 * (11.0 + 14.0 * pole + 11.0 * pole ** 2) / (6.0 * h),
        force=2.0 * rate ** 3 * (1.0 + pole) / h ** 2,
        jerk=rate ** 4 / h ** 3)
