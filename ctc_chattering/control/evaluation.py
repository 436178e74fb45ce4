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
A state and a reference, evaluated: all that a law needs to know of them.

Filter
------
The filter (3), with b > 0, λ > 0 and a state ξ that needs no acceleration. In continuous time
``v = -b de + ξ`` with ``dξ/dt = -λ ξ + b [(λ I - Kv) de - Kp e]``, ξ(0) = 0.
Sampled, with the bracket held over each period h, this has the exact solution::

    ξ[k+1] = exp(-λ h) ξ[k] + (1 - exp(-λ h)) / λ · b [λ de - u],     u = Kv de + Kp e

Limits
------
Of the torque and of its rate, with the anti-windup of the filter (3). The saturation error, what
the limits take from the torque, acts in the closed loop (8) like a perturbation: over one period
it changes v by -b h M⁻¹ times itself. Added to ξ with the opposite sign, it leaves v as it would
be without limits.

Delay
-----
Under a known input delay the law is evaluated at the state predicted for when its torque is
applied. The prediction runs model, reference and filter ahead under the torques in transit.
Filter and observer themselves advance with what is measured and applied.
"""

from __future__ import annotations

from math import exp, expm1, inf
from typing import Any, NamedTuple, Protocol

from ctc_chattering.compiled.compilable import dot, function, record, solve, some
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.time_grid import period_ns, seconds
from ctc_chattering.parameters import matrix
import numpy as np

#: Time over which the difference of two laws fades [s].
FADE = 0.2
#: Rows of a torque in transit.
ROWS = 4


@record
class ErrorFilter(NamedTuple):
    """
    Coefficients of the filter (3), made by `error_filter`.

    They are arrays of shape (n,), because a product with a float takes twice as long.
    """

    #: λ [1/s] and b.
    pole: Array
    b: Array
    #: exp(-λ h), c = b (1 - exp(-λ h)) / λ, b h and b h - c.
    decay: Array
    gain: Array
    scale: Array
    rest: Array

    def output(self, de: Array, xi: Array) -> Array:
        """Return v, shape (n,) [rad/s], at the velocity error `de` and the state ξ."""
        return xi - self.b * de

    def next_state(self, xi: Array, de: Array, u: Array) -> Array:
        """
        Return ξ, shape (n,), one period later.

        Parameters
        ----------
        xi : array, shape (n,)
            ξ [rad/s].
        de : array, shape (n,)
            Velocity error [rad/s].
        u : array, shape (n,)
            Kv de + Kp e [rad/s²].

        """
        return self.decay * xi + self.gain * (self.pole * de - u)

    def nominal_response(self, v: Array, u: Array) -> Array:
        """
        Return y: what v would be a period later if dde + Kv de + Kp e were 0, shape (n,) [rad/s].

        It is exp(-λ h) v + (b h - c) u, with c the gain of the filter's input; the second part is
        of the order of h². Arguments as `next_state` has them.
        """
        return self.decay * v + self.rest * u


def error_filter(n: int, pole: float, b: float, period: float) -> ErrorFilter:
    """Return the filter of n joints with λ [1/s], b and the sample period [s]."""
    decay, gain = exp(-pole * period), -b * expm1(-pole * period) / pole
    return ErrorFilter(*(np.full(n, x) for x in (
        pole, b, decay, gain, b * period, b * period - gain)))


@record
class Limiter(NamedTuple):
    """Limits of the torque, made by `limiter`; arrays of shape (n,)."""

    #: Largest torque, and largest change of it in a period [N·m]; inf for unlimited.
    effort: Array
    change: Array
    #: Whether there are limits, 1.0 or 0.0; b h of the filter [s], 0.0 for no anti-windup.
    limited: float
    anti_windup: float
    #: n zeros.
    zero: Array

    def limit(self, unsaturated: Array, held: Array) -> Array:
        """Return the torque to send after the torque `held`, shape (n,) [N·m]."""
        if self.limited == 0.0:
            return unsaturated
        near = np.minimum(np.maximum(unsaturated, held - self.change), held + self.change)
        return np.minimum(np.maximum(near, -self.effort), self.effort)

    def correction(self, mass: Array, lost: Array) -> Array:
        """Return the anti-windup correction of ξ and v for a torque lost, (n,) [rad/s]."""
        if self.anti_windup == 0.0 or not some(lost):
            return self.zero
        return self.anti_windup * solve(mass, lost)


def limiter(effort: Array, change: Array, anti_windup: float) -> Limiter:
    """Return limits; arguments as the first fields of `Limiter` but `limited`."""
    limited = min(effort.min(), change.min()) < inf
    return Limiter(effort, change, float(limited), anti_windup, np.zeros_like(effort))


@record
class ControlSettings(NamedTuple):
    """What is common to all laws; made by `control_settings`."""

    #: h [s], the input delay in samples, and `FADE` in samples.
    period: float
    delay: float
    fading: float
    #: Kp [1/s²] and Kv [1/s], shape (n, n).
    kp: Array
    kv: Array
    filter: ErrorFilter  # noqa: A003
    limiter: Limiter
    #: n zeros.
    zero: Array


class Evaluates(Protocol):
    """The part of a model that the control step takes."""

    def evaluate(self, q: Array, dq: Array) -> tuple[Array, Array, Array]:
        """Return M, C and G, shapes (n, n), (n, n) and (n,)."""

    def forward(self, q: Array, dq: Array, u: Array) -> Array:
        """Return ddq, shape (n,) [rad/s²], under a torque [N·m]."""


@record
class Models(NamedTuple):
    """
    One model for the states that are evaluated side by side.

    Compiled code keeps M and C of each in a place of its own.
    """

    #: Of the sample, of the arrival of its torque, and of a period later.
    now: Evaluates
    arriving: Evaluates
    after: Evaluates


@record
class State(NamedTuple):
    """
    A state and a reference, with what all laws need of them; arrays of shape (n,), or (n, n).

    Attributes
    ----------
    q, dq : ndarray
        Position [rad] and velocity [rad/s].
    dq_d, ddq_d : ndarray
        Desired velocity [rad/s] and acceleration [rad/s²].
    e, de : ndarray
        Errors [rad, rad/s].
    u : ndarray
        Kv de + Kp e [rad/s²].
    v : ndarray
        Filtered error [rad/s].
    M, C : ndarray, shape (n, n)
        Mass matrix [kg·m²] and Coriolis matrix [kg·m²/s] of the model.
    G, bias : ndarray
        Gravity, and C dq + G [N·m].
    N : ndarray
        M (ddq_d + u) + C dq + G [N·m].
    zero : ndarray
        n zeros, for terms that a law does not have.

    """

    q: Array
    dq: Array
    dq_d: Array
    ddq_d: Array
    e: Array
    de: Array
    u: Array
    v: Array
    M: Array
    C: Array
    G: Array
    bias: Array
    N: Array
    zero: Array


@record
class Context(NamedTuple):
    """What is the same at all samples."""

    settings: ControlSettings
    models: Models
    #: Torques in transit: `Applied` in four rows each, shape (4 d, n).
    transit: Array
    #: Room for the reference at another instant, shape (3 (1 + d), n).
    reference: Array

    def command(self, memory: ControlMemory, j: int) -> Array:
        """Return the torque in transit that is applied j periods from now, shape (n,) [N·m]."""
        row = ROWS * ((int(memory.turn) + j) % int(self.settings.delay))
        command: Array = self.transit[row]
        return command


@record
class ControlMemory(NamedTuple):
    """What the control step remembers, besides the memory of the law and torques in transit."""

    #: ξ of the filter [rad/s], shape (n,).
    xi: Array
    #: Torque sent last, shape (n,) [N·m].
    held: Array
    #: Of a law that took over (`step.taken_over`): what its torque differed from the one sent,
    #: shape (n,) [N·m]; for how many samples it is still added, -d once none of it is in transit;
    #: 1.0 before the first of them.
    difference: Array
    fading: float
    fresh: float
    #: Which of the torques in transit is applied next.
    turn: float


@record
class LastSample(NamedTuple):
    """The sample before, from which a state is predicted; arrays of shape (n,)."""

    #: Position [rad] and velocity [rad/s] as the law took them.
    q: Array
    dq: Array
    #: Torque that acts from then on [N·m].
    applied: Array


@record
class Arrival(NamedTuple):
    """What is irregular about the state of a sample; truth values are 1.0 and 0.0."""

    #: How long after the sample it was measured, δ [s].
    offset: float
    #: How long after the instants of the reference that is given the sample is [s].
    after_points: float
    #: Whether it has come; else the state that is predicted takes its place.
    measured: float
    #: Whether the torque sent last has been kept.
    kept: float


#: A state that was measured at its sample.
REGULAR = Arrival(0.0, 0.0, 1.0, 0.0)


@function
def losing(settings: ControlSettings, memory: ControlMemory) -> bool:
    """Return whether a torque that is applied may be another one than that of its law."""
    return settings.limiter.limited != 0.0 or memory.fading > -settings.delay


def control_settings(config: ControllerConfig, effort_limits: Vector) -> ControlSettings:
    """Return the settings of a configuration, with the effort limits of its model [N·m]."""
    n, h = len(config.joint_names), seconds(period_ns(config.control_period))
    limits = limiter(np.array(config.largest_torque(effort_limits)),
                     h * np.array(config.effort_rate_limit),
                     config.b * h if config.anti_windup else 0.0)
    return ControlSettings(
        h, float(config.input_delay), float(max(round(FADE / h), 1)),
        np.array(matrix(config.kp, n)), np.array(matrix(config.kv, n)), filter_of(config, h),
        limits, np.zeros(n))


def filter_of(config: ControllerConfig, period: float) -> ErrorFilter:
    """Return the filter (3) of a configuration, with the sample period [s]."""
    return error_filter(len(config.joint_names), config.lambda_, config.b, period)


@function
def evaluated(settings: ControlSettings, model: Any, q: Array, dq: Array, points: Array, i: int,
              xi: Array) -> State:
    """Return the state for row i of the reference, and the state ξ of the filter."""
    q_d, dq_d, ddq_d = points[i], points[i + 1], points[i + 2]
    e, de = q_d - q, dq_d - dq
    u = dot(settings.kv, de) + dot(settings.kp, e)
    v = settings.filter.output(de, xi)                               # (3)
    M, C, G = model.evaluate(q, dq)
    bias = dot(C, dq) + G
    N = dot(M, ddq_d + u) + bias                                     # inverse dynamics
    return State(q, dq, dq_d, ddq_d, e, de, u, v, M, C, G, bias, N, settings.zero)


@function
def arriving(law: Any, law_memory: Any, now: State, context: Context, memory: ControlMemory,
             points: Array) -> State:
    """
    Return the state in which the torque of this sample is applied; `now` without a delay.

    Parameters
    ----------
    law, law_memory
        Law in force, and its memory: of what acts until the torque arrives.
    now : State
        Measured.
    context, memory, points
        As of the control step.

    """
    settings, at, xi = context.settings, now, memory.xi
    if settings.delay == 0.0:
        return now
    delay, perturbation, h = int(settings.delay), law.acting(law_memory, now), settings.period
    lossy, turn = losing(settings, memory), int(memory.turn)
    for j in range(delay):
        row = ROWS * ((turn + j) % delay)
        xi = settings.filter.next_state(xi, at.de, at.u)
        if lossy:
            xi = xi + settings.limiter.correction(at.M, context.transit[row + 2])
        q, dq = predict(context.models.arriving, at, context.transit[row] - perturbation, h)
        at = evaluated(settings, context.models.arriving, q, dq, points, 3 * j + 3, xi)
    return at


@function
def next_state(law: Any, law_memory: Any, last: LastSample, context: Context,
               memory: ControlMemory, points: Array) -> tuple[Array, Array]:
    """
    Return q and dq, shape (n,), a period after the last sample.

    Parameters
    ----------
    law, law_memory
        Law in force, and its memory: of what has acted since.
    last : LastSample
        State and torque.
    context, memory, points
        As of the control step.

    """
    at = evaluated(context.settings, context.models.now, last.q, last.dq, points, 0, memory.xi)
    return predict(context.models.now, at, last.applied - law.acting(law_memory, at),
                   context.settings.period)


@function
def predict(model: Evaluates, at: State, u: Array, h: float) -> tuple[Array, Array]:
    """
    Return q and dq after one period under a held torque, by the midpoint rule.

    Parameters
    ----------
    model : Model
        As the controller knows it.
    at : State
        Now.
    u : array, shape (n,)
        Torque less the perturbation [N·m].
    h : float
        Period [s].

    """
    middle = at.dq + 0.5 * h * solve(at.M, u - at.bias)
    return at.q + h * middle, at.dq + h * model.forward(at.q + 0.5 * h * at.dq, middle, u)
