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
Law `pid_kalman`: PID with inverse dynamics, Kalman velocity, lead and friction fed forward.

The velocity is that of a steady-state Kalman filter of the measured position, for a random jerk
(Kalata, *The tracking index*, IEEE TAES 20, 1984). Over a period, with the jerk j, h = 1, and a
position error of variance 1, σ = (ω h)³ being the deviation of j::

    x = (q, dq, ddq)⁺ = A x + g j,     A = [1 1 ½; 0 1 1; 0 0 1],     g = (1/6, ½, 1)     (PK1)
    x̂ += k (q - q̂),     k = Π c / (c' Π c + 1),     c = (1, 0, 0)                        (PK2)

Π from the Riccati equation. For ω h « 1 its poles are those of a Butterworth filter of the
bandwidth ω. The torque, with y the integral, T and R of the drives and their torque τ_d::

    τ* = M (ddq_d + Kv (dq_d - dq̂) + Kp e + y) + C dq̂ + G + F                             (PK3)
    τ[k] = D τ[k-1] + (1 - D) (τ*[k] - E τ*[k-1]) / (1 - E), within τ_d ± R (T + h)       (PK4)
    y[k+1] = y[k] + h Ki e[k] - (1 - exp(-h Ki_ii / Kp_ii)) M⁻¹ s[k]                      (PK5)

F = f tanh((dq_d + t ddq_d) / ε) is friction, fed forward with the lead t. (PK4) is the lead of the
torque: E = exp(-h / T) is the pole of the drives, in whose place it puts
D = exp(-h / (a T)), 0 < a <= 1. s is what bounds have taken from the torque.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import dot, record, solve, some
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.delay import predict_arrival
from ctc_chattering.control.laws.base import law, observed_state
from ctc_chattering.control.sample import Applied, Context, LastSample, State, Terms
from ctc_chattering.dynamics.drive_response import discretize_drives, DriveModel
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import matrix
import numpy as np
from scipy.linalg import solve_discrete_are  # type: ignore[import-untyped]


@record
class Kinematics(NamedTuple):
    """What the law remembers; arrays of shape (n,)."""

    #: q̂ [rad], dq̂ [rad/s] and its slope [rad/s²], predicted from the last sample.
    q: Array
    dq: Array
    ddq: Array
    #: y of (PK3) [rad/s²]; τ_d, and of the last sample τ* and τ [N·m].
    integral: Array
    torque: Array
    asked: Array
    sent: Array
    #: Whether there was a sample, 1.0 or 0.0.
    known: float


@law(symbol='-(M ∫ Ki e dt + F)')
class PidKalman(NamedTuple):
    """PID on the velocity of a Kalman filter."""

    #: Gains of (PK2) in s, and h [s].
    position: float
    velocity: float
    acceleration: float
    period: float
    #: h Ki [1/s²], and 1 - exp(-h Ki / Kp), 0 for no anti-windup, shape (n,).
    gain: Array
    tracking: Array
    #: f [N·m], shape (n,), ε [rad/s] and t [s].
    friction: Array
    width: float
    ahead: float
    #: D of (PK4), shape (n,).
    lead: Array
    drives: DriveModel

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> PidKalman:
        """Return the law of a configuration."""
        n, h, ki = len(config.joint_names), period, np.array(config.ki)
        drives = discretize_drives(
            np.array(config.assumed_lag), np.array(config.torque_rate_limit), h)
        k = kalman_gains(config.estimator_bandwidth * h)
        tracking = -np.expm1(-h * ki / np.diag(matrix(config.kp, n)))
        return cls(float(k[0]), float(k[1]) / h, float(k[2]) / h ** 2, h, h * ki,
                   tracking if config.anti_windup else 0.0 * tracking,
                   np.array(config.friction_level), config.friction_velocity,
                   config.friction_lead, np.exp(-h / (config.lead_ratio * drives.lag)), drives)

    def initial(self) -> Kinematics:
        """Return the memory of no sample."""
        zero = 0.0 * self.gain
        return Kinematics(*(zero,) * 7, known=0.0)

    def initialized(self, now: State, estimate: Array) -> Kinematics:
        """Set y so that it cancels what the other law estimates beside friction."""
        y = solve(now.M, estimate - self.friction_ahead(now))
        return self.initial()._replace(integral=y)

    def predicted_state(self, memory: Kinematics, last: LastSample, context: Context
                        ) -> tuple[Array, Array]:
        """Return q̂ and dq̂ as predicted; at first, by the model."""
        return observed_state(self, memory, last, context, memory.q, memory.dq)

    def corrected(self, memory: Kinematics, q: Array, dq: Array, held: Array
                  ) -> tuple[Kinematics, Array, Array]:
        """Return q and dq̂ of (PK2); at first the measured velocity."""
        ddq, torque = memory.ddq, memory.torque
        if memory.known != 0.0:
            error = q - memory.q
            dq = memory.dq + self.velocity * error
            ddq = ddq + self.acceleration * error
            q_hat = memory.q + self.position * error
        else:
            q_hat, torque = q, held
        return memory._replace(q=q_hat, dq=dq, ddq=ddq, torque=torque), q, dq

    def friction_ahead(self, at: State) -> Array:
        """Return F, shape (n,) [N·m]."""
        return self.friction * np.tanh((at.dq_d + self.ahead * at.ddq_d) / self.width)

    def answer(self, memory: Kinematics, now: State, context: Context
               ) -> tuple[Terms, Kinematics]:
        """Return the terms of (PK4), for the state in which the torque arrives."""
        at, held = predict_arrival(self, memory, now, context), memory.torque
        for j in range(int(context.settings.delay)):
            held = self.drives.respond(held, context.in_transit(j)).end
        z = -self.estimate(memory, at)
        wanted, E, reach = at.N - z, self.drives.decay, self.drives.reach
        command = wanted
        if memory.known != 0.0:
            command = self.lead * memory.sent + (1.0 - self.lead) / (1.0 - E) * (
                wanted - E * memory.asked)
        sent = np.minimum(np.maximum(command, held - reach), held + reach)
        y = memory.integral
        if some(command - sent):
            y = y - self.tracking * solve(at.M, command - sent)
        return Terms(sent + z, now.zero, z, now.zero), memory._replace(
            integral=y, asked=wanted, sent=sent)

    def advanced(self, memory: Kinematics, now: State, applied: Applied) -> Kinematics:
        """Predict the next sample by (PK1), and advance y by (PK5)."""
        h, y = self.period, memory.integral + self.gain * now.e
        if some(applied.saturation_error):
            y = y - self.tracking * solve(now.M, applied.saturation_error)
        torque = self.drives.respond(memory.torque, applied.tau).end
        return memory._replace(
            q=memory.q + h * (memory.dq + 0.5 * h * memory.ddq), dq=memory.dq + h * memory.ddq,
            integral=y, torque=torque, known=1.0)

    def estimate(self, memory: Kinematics, now: State) -> Array:
        """Return M y with the friction."""
        return dot(now.M, memory.integral) + self.friction_ahead(now)


def kalman_gains(bandwidth: float) -> Array:
    """Return k of (PK2), shape (3,), for ω h; (PK1) is scaled by h."""
    A = np.array(((1.0, 1.0, 0.5), (0.0, 1.0, 1.0), (0.0, 0.0, 1.0)))
    g, c = bandwidth ** 3 * np.array((1.0 / 6.0, 0.5, 1.0)), np.array((1.0, 0.0, 0.0))
    variance = solve_discrete_are(A.T, c[:, np.newaxis], np.outer(g, g), np.eye(1))
    gains: Array = variance @ c / (variance[0, 0] + 1.0)
    return gains
