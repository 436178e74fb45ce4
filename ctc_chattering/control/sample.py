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
Records of one sample, which the control step and a law exchange.

The control step (`step.py`) evaluates the measured state. It hands `State` and `Context` to the
law and gets `Terms` back. Two functions evaluate the model. Vectors are arrays of shape (n,),
matrices of shape (n, n). Truth values are 1.0 and 0.0, so that all records can be compiled.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import dot, function, record, solve
from ctc_chattering.control.settings import ControlSettings
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Array

#: Rows of a torque in transit, the fields of `Applied`.
TRANSIT_ROWS = 4


@record
class Desired(NamedTuple):
    """A point of the reference [rad, rad/s, rad/s²]."""

    q: Array
    dq: Array
    ddq: Array


@record
class State(NamedTuple):
    """
    A state and a reference, evaluated for the laws.

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
        Zeros, for terms that a law lacks.

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
class Terms(NamedTuple):
    """
    Terms of a law's torque, each (n,) [N·m].

    The torque is nominal - compensation - robust.

    Attributes
    ----------
    nominal : ndarray
        Torque by model and feedback.
    compensation : ndarray
        C v of the paper's laws.
    robust : ndarray
        Term against the perturbation: chattering, integral, estimate.
    clipping_error : ndarray
        Torque that ±Ka has taken from the chattering term.

    """

    nominal: Array
    compensation: Array
    robust: Array
    clipping_error: Array


@record
class Applied(NamedTuple):
    """
    A torque that is applied, each (n,) [N·m].

    Attributes
    ----------
    tau, saturation_error : ndarray
        Torque within the limits, and the torque that these have taken.
    excess : ndarray
        The law's torque less ``tau``, kept from the filter. It is 0 for `advanced` without
        anti-windup.
    clipping_error : ndarray
        Of `Terms`.

    """

    tau: Array
    saturation_error: Array
    excess: Array
    clipping_error: Array


@record
class MeasuredState(NamedTuple):
    """Position [rad] and velocity [rad/s] that a law takes."""

    q: Array
    dq: Array


@record
class LastSample(NamedTuple):
    """
    The sample before, each of shape (n,).

    The next state is predicted from it.

    Attributes
    ----------
    q, dq : ndarray
        Position [rad] and velocity [rad/s] as the law took them.
    applied : ndarray
        Torque that acts from then on [N·m].

    """

    q: Array
    dq: Array
    applied: Array


@record
class ControlMemory(NamedTuple):
    """
    Memory of the control step.

    Attributes
    ----------
    xi : ndarray, shape (n,)
        ξ of the filter [rad/s].
    held : ndarray, shape (n,)
        Torque sent last [N·m].
    handover_offset : ndarray, shape (n,)
        Torque step hidden at a change of law [N·m].
    handover_samples_left : float
        Samples for which the offset is still added, down to -d when none is in transit.
    transit_index : float
        Index of the torque in transit that is applied next.

    """

    xi: Array
    held: Array
    handover_offset: Array
    handover_samples_left: float
    transit_index: float


@record
class Memories(NamedTuple):
    """Memory of step and law, and the last sample."""

    control: ControlMemory
    law: Any
    last: LastSample


@record
class Models(NamedTuple):
    """
    One model for three states side by side.

    Compiled code keeps M and C of each apart. In plain Python all three are the same `Model`.

    Attributes
    ----------
    now, arriving, after : Model
        For the sample, the arrival of its torque, and a period later.

    """

    now: Any
    arriving: Any
    after: Any


@record
class Context(NamedTuple):
    """
    Surroundings of the state of a sample.

    Attributes
    ----------
    settings : ControlSettings
    models : Models
    transit : ndarray, shape (4 d, n)
        Torques in transit, four rows for each `Applied` [N·m].
    memory : ControlMemory
    points : ndarray, shape (3 (1 + d), n)
        q_d [rad], dq_d [rad/s] and ddq_d [rad/s²] for this sample and the d next ones.
    reference_offset : float
        Time from the instants of these points to the samples [s].

    """

    settings: ControlSettings
    models: Models
    transit: Array
    memory: ControlMemory
    points: Array
    reference_offset: float

    def reference_at(self, j: int) -> Desired:
        """Return the reference j periods after this sample."""
        q = self.points[3 * j]
        dq = self.points[3 * j + 1]
        ddq = self.points[3 * j + 2]
        t = self.reference_offset
        if t == 0.0:
            return Desired(q, dq, ddq)
        mean_dq = dq + 0.5 * t * ddq
        return Desired(q + t * mean_dq, dq + t * ddq, ddq)

    def transit_row(self, j: int) -> int:
        """
        Return the first row of a torque in transit.

        It is applied j periods from now.
        """
        index = int(self.memory.transit_index) + j
        return TRANSIT_ROWS * (index % int(self.settings.delay))

    def in_transit(self, j: int) -> Array:
        """Return the torque applied in j periods [N·m]."""
        torque: Array = self.transit[self.transit_row(j)]
        return torque

    def torque_is_modified(self) -> bool:
        """Return whether limits or a hand-over change the law's torque."""
        settings = self.settings
        return settings.limited != 0.0 or self.memory.handover_samples_left > -settings.delay


@function
def evaluate_state(settings: ControlSettings, model: Any, q: Array, dq: Array, desired: Desired,
                   xi: Array) -> State:
    """Return the state for a reference and ξ."""
    e = desired.q - q
    de = desired.dq - dq
    u = dot(settings.kv, de) + dot(settings.kp, e)
    v = settings.filter.output(de, xi)                               # (3)
    M, C, G = model.evaluate(q, dq)
    bias = dot(C, dq) + G
    N = dot(M, desired.ddq + u) + bias                                     # inverse dynamics
    return State(q, dq, desired.dq, desired.ddq, e, de, u, v, M, C, G, bias, N, settings.zero)


@function
def predict_state(model: Model, state: State, torque: Array, h: float) -> tuple[Array, Array]:
    """
    Return q and dq a period later, under a torque.

    The torque is held, and the method is the midpoint rule.

    Parameters
    ----------
    model : Model
        The controller's model.
    state : State
        At the start of the period.
    torque : array, shape (n,)
        Torque less the perturbation [N·m].
    h : float
        Period [s].

    """
    half = 0.5 * h
    dq_middle = state.dq + half * solve(state.M, torque - state.bias)
    q_middle = state.q + half * state.dq
    ddq_middle = model.forward(q_middle, dq_middle, torque)
    return state.q + h * dq_middle, state.dq + h * ddq_middle
