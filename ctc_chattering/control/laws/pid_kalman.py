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
Law `pid_kalman`: PID with inverse dynamics.

It also has a Kalman velocity, a lead, and friction fed forward.

A steady-state Kalman filter of the measured position, for a random jerk, gives the velocity
(Kalata, *The tracking index*, IEEE TAES 20, 1984). Over a period h = 1, with the jerk j, the
position error has the variance 1 and j the deviation σ = (ω h)³::

    x = (q, dq, ddq)⁺ = A x + g j,     A = [1 1 ½; 0 1 1; 0 0 1],     g = (1/6, ½, 1)     (PK1)
    x̂ += k (q - q̂),     k = Π c / (c' Π c + 1),     c = (1, 0, 0)                        (PK2)

Π solves the Riccati equation. For ω h « 1 the poles are those of a Butterworth filter of the
bandwidth ω. With the integral y, and T, R and torque τ_d of the drives, the torque is::

    τ* = M (ddq_d + Kv (dq_d - dq̂) + Kp e + y) + C dq̂ + G + F                             (PK3)
    τ[k] = D τ[k-1] + (1 - D) (τ*[k] - E τ*[k-1]) / (1 - E), within τ_d ± R (T + h)       (PK4)
    y[k+1] = y[k] + h Ki e[k] - (1 - exp(-h Ki_ii / Kp_ii)) M⁻¹ s[k]                      (PK5)

F = f tanh((dq_d + t ddq_d) / ε) is friction, fed forward with the lead t. (PK4) replaces the pole
of the drives, E = exp(-h / T), by D = exp(-h / (a T)), 0 < a <= 1. s is the torque lost at bounds.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import dot, record, solve
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.delay import predict_arrival
from ctc_chattering.control.laws.base import law, observed_state
from ctc_chattering.control.laws.friction_feedforward import friction_ahead, FrictionAhead
from ctc_chattering.control.laws.integral import integral_action, IntegralAction
from ctc_chattering.control.recommended_gains import PoleRule
from ctc_chattering.control.sample import Applied, Context, LastSample, MeasuredState, State, Terms
from ctc_chattering.dynamics.drive_response import DriveModel
from ctc_chattering.numerics.box_qp import clip
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class Kinematics(NamedTuple):
    """Memory of the law, in arrays of shape (n,)."""

    #: q̂ [rad], dq̂ [rad/s] and ddq̂ [rad/s²], predicted from the last sample.
    q: Array
    dq: Array
    ddq: Array
    #: y [rad/s²].
    integral: Array
    #: τ_d [N·m].
    torque: Array
    #: τ* and τ of the last sample [N·m].
    desired: Array
    sent: Array
    #: 1.0 after the first sample, else 0.0.
    has_sample: float


@law(symbol='-(M ∫ Ki e dt + F)',
     parameters=('estimator_bandwidth', 'actuator_lag', 'torque_rate_limit', 'ki', 'lead_ratio',
                 'friction_level', 'friction_velocity', 'friction_lead', 'anti_windup'),
     gain_rule=PoleRule(0.41, 41.0, 3.3, 2.4, 1.5, times_p={'estimator_bandwidth': 8.6}))
class PidKalman(NamedTuple):
    """PID on the velocity of a Kalman filter."""

    #: k of (PK2) in seconds: [1], [1/s] and [1/s²].
    position: float
    velocity: float
    acceleration: float
    #: h [s].
    period: float
    #: y of (PK5).
    action: IntegralAction
    #: F of (PK3).
    friction: FrictionAhead
    #: D of (PK4), shape (n,).
    lead: Array
    drives: DriveModel

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> PidKalman:
        """Return the law of a configuration."""
        h = period
        drives = config.assumed_drives(h)
        k1, k2, k3 = kalman_gains(config.estimator_bandwidth * h).tolist()
        return cls(
            position=k1,
            velocity=k2 / h,
            acceleration=k3 / h ** 2,
            period=h,
            action=integral_action(config, h),
            friction=friction_ahead(config),
            lead=np.exp(-h / (config.lead_ratio * drives.lag)),
            drives=drives)

    def initial(self) -> Kinematics:
        """Return the memory before any sample."""
        zero = 0.0 * self.lead
        return Kinematics(*(zero,) * 7, has_sample=0.0)

    def initialized(self, now: State, estimate: Array) -> Kinematics:
        """Set y to cancel the estimate beside friction."""
        y = solve(now.M, estimate - self.friction.friction_torque(now.dq_d, now.ddq_d))
        return self.initial()._replace(integral=y)

    def predicted_state(self, memory: Kinematics, last: LastSample, context: Context
                        ) -> tuple[Array, Array]:
        """Return q̂ and dq̂ as predicted."""
        return observed_state(self, memory, last, context, memory.q, memory.dq)

    def corrected(self, memory: Kinematics, q: Array, dq: Array, held: Array
                  ) -> tuple[Kinematics, MeasuredState]:
        """
        Return q and dq̂ of (PK2).

        At the first sample it is the measured velocity.
        """
        if memory.has_sample == 0.0:
            return memory._replace(q=q, dq=dq, torque=held), MeasuredState(q, dq)
        error = q - memory.q
        dq_hat = memory.dq + self.velocity * error
        corrected = memory._replace(
            q=memory.q + self.position * error,
            dq=dq_hat,
            ddq=memory.ddq + self.acceleration * error)
        return corrected, MeasuredState(q, dq_hat)

    def answer(self, memory: Kinematics, now: State, context: Context
               ) -> tuple[Terms, Kinematics]:
        """Return the terms of (PK4) at the arrival."""
        state = predict_arrival(self, memory, now, context)
        held = memory.torque
        for j in range(int(context.settings.delay)):
            held = self.drives.follow(held, context.in_transit(j)).end
        z = -self.estimate(memory, state)
        desired = state.N - z
        command = desired
        if memory.has_sample != 0.0:
            D = self.lead
            E = self.drives.decay
            change = desired - E * memory.desired
            command = D * memory.sent + (1.0 - D) / (1.0 - E) * change
        reach = self.drives.reach
        sent = clip(command, held - reach, held + reach)
        y = self.action.relieved(memory.integral, state.M, command - sent)
        memory = memory._replace(integral=y, desired=desired, sent=sent)
        return Terms(sent + z, now.zero, z, now.zero), memory

    def advanced(self, memory: Kinematics, now: State, applied: Applied) -> Kinematics:
        """Predict the next sample by (PK1), and advance y by (PK5)."""
        h = self.period
        y = self.action.integrated(memory.integral, now, applied.saturation_error)
        mean_dq = memory.dq + 0.5 * h * memory.ddq
        return memory._replace(
            q=memory.q + h * mean_dq,
            dq=memory.dq + h * memory.ddq,
            integral=y,
            torque=self.drives.follow(memory.torque, applied.tau).end,
            has_sample=1.0)

    def estimate(self, memory: Kinematics, now: State) -> Array:
        """Return M y + F."""
        F = self.friction.friction_torque(now.dq_d, now.ddq_d)
        return dot(now.M, memory.integral) + F


def kalman_gains(bandwidth: float) -> Array:
    """
    Return k of (PK2), shape (3,), for ω h.

    (PK1) is scaled by h.
    """
    from scipy.linalg import solve_discrete_are  # type: ignore[import-untyped]  # Slow to import.
    A = np.array((
        (1.0, 1.0, 0.5),
        (0.0, 1.0, 1.0),
        (0.0, 0.0, 1.0)))
    g = bandwidth ** 3 * np.array((1.0 / 6.0, 0.5, 1.0))
    c = np.array((1.0, 0.0, 0.0))
    variance = solve_discrete_are(A.T, c[:, np.newaxis], np.outer(g, g), np.eye(1))
    gains: Array = variance @ c / (variance[0, 0] + 1.0)
    return gains
