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
Law `observer_feedback`: computed torque on an observed state, for drives and encoders as they are.

An observer that has the perturbation as a state (Han, *From PID to active disturbance rejection
control*, IEEE TIE 56, 2009), with the bound Ka of the paper's law (6). At every sample, with what
`observer`, `feasible_reference`, `friction_learning` and `dynamics/drive_response` define::

    q̂, dq̂, P̂, Ṗ̂:  corrected by the measured q, then predicted until the torque arrives   (OF1)
    τ* = M (ddq_r + Kv (dq_r - dq̂) + Kp (q_r - q̂)) + C dq̂ + G - z                       (OF2)
    z  = -(P̂ + F), the nearest within ±Ka in the metric of M⁻¹                           (OF3)
    τ  = the command by which the drives give τ* at arrival and a period later           (OF4)

q_r is the reference with the deviation that the drives need, F the friction it makes. τ is within
R (T + h) of the torque of the drives, in the metric of M⁻¹: beyond it they are no faster. The
measured velocity is not used after the first sample. At a joint that comes to rest P̂ is kept
(`standstill`). Drives that are not as known make the feedback oscillate; `oscillation` then
gives the bandwidths of feedback, P̂, deviation and learning a factor s, and P̂ the bound √s Ka::

    f = M (k Kv (dq_r - dq̂) + k² Kp (q_r - q̂)),     k = max(s, 10 / √Kp_ii), at most 1     (OF5)

so that the feedback keeps 10 rad/s of its bandwidth.

With M̂ = c M, drives without lag and limits, and no friction, (OF1) to (OF3) are linear. Their
poles are within the unit circle, for Kp = p², Kv = 2 p, p = ω = 100 rad/s, h = 1 ms, if::

    0.47 < c < 3.1                                                                       (OF6)
"""

from __future__ import annotations

from math import exp
from typing import NamedTuple

from ctc_chattering.compiled.compilable import diagonal, dot, function, record
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.feasible_reference import (
    design_reference,
    Desired,
    Deviation,
    FeasibleReference,
    next_point,
)
from ctc_chattering.control.friction_learning import (
    design_learner,
    FrictionLearner,
    LearnedFriction,
)
from ctc_chattering.control.laws.base import law, observed_state, Stability
from ctc_chattering.control.observer import design_observer, Observed, StateObserver
from ctc_chattering.control.oscillation import (
    design_guard,
    Oscillation,
    OscillationGuard,
    START_GRACE_S,
)
from ctc_chattering.control.sample import Applied, Context, LastSample, State, Terms
from ctc_chattering.control.standstill import (
    design_detector,
    hold_standing,
    Standstill,
    StandstillDetector,
)
from ctc_chattering.dynamics.drive_response import discretize_drives
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import matrix
import numpy as np

#: ln s from which on the law is as configured; what the feedback keeps of bandwidth [rad/s].
_NO_RETREAT, _STIFF = -1e-3, 10.0


@record
class Memory(NamedTuple):
    """What the law remembers from sample to sample; truth values are 1.0 and 0.0."""

    #: The state, predicted from the last sample with M, (n, n), and ddq_d [rad/s²], shape (n,),
    #: there; x and dx of the reference; and whether there was such a sample.
    observed: Observed
    mass: Array
    ddq: Array
    deviation: Deviation
    known: float
    #: K̂ as learned so far.
    learned: LearnedFriction
    #: Which joints are held.
    rest: Standstill
    #: Of the feedback, and with it s of `oscillation`.
    oscillation: Oscillation


@record
class Place(NamedTuple):
    """A state of robot and drives with M, shape (n, n), and C dq + G, shape (n,), there."""

    at: Observed
    M: Array
    bias: Array


@law(symbol='-(P̂ + F)')
class ObserverFeedback(NamedTuple):
    """Computed torque on an observed state."""

    #: Kp [1/s²] and Kv [1/s], shape (n, n), and Ka [N·m], shape (n,).
    kp: Array
    kv: Array
    ka: Array
    #: The level of friction at the start, shape (n,) [N·m].
    given: Array
    observer: StateObserver
    reference: FeasibleReference
    learning: FrictionLearner
    standstill: StandstillDetector
    guard: OscillationGuard
    #: k of (OF5), for the law of a sample (`slowed_down`), and the least of it.
    part: float
    least: float

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> ObserverFeedback:
        """Return the law of a configuration."""
        n, bandwidth, ka = len(config.joint_names), config.estimator_bandwidth, np.array(config.ka)
        drives = discretize_drives(
            np.array(config.assumed_lag), np.array(config.torque_rate_limit), period)
        return with_parts(
            np.array(matrix(config.kp, n)), np.array(matrix(config.kv, n)), ka,
            np.array(config.friction_level),
            design_observer(drives, bandwidth, ka, config.estimator_slope),
            design_learner(config.friction_learning, bandwidth, period, ka), bandwidth)

    def with_gains(self, kp: Array, kv: Array, ka: Array) -> ObserverFeedback:
        """Return the law with other gains, and with what depends on them."""
        return with_parts(
            kp, kv, ka, self.given, self.observer._replace(bound=ka),
            self.learning._replace(bound=ka), self.standstill.bandwidth)

    def stability(self, memory: Memory) -> Stability:
        """Return s of (OG1), how long less of it has not helped, and L of (OG2)."""
        seen = memory.oscillation
        joint = self.guard.find_cycling_joint(seen)
        return Stability(exp(seen.retreat), seen.strained, seen.cycling, joint,
                         float(seen.frequency[joint]))

    def slowed_down(self, memory: Memory) -> ObserverFeedback:
        """Return the law with the part of its bandwidths that it may use."""
        if memory.oscillation.retreat > _NO_RETREAT:
            return self
        part = exp(memory.oscillation.retreat)
        return self._replace(
            observer=self.observer.slow_down(part), reference=self.reference.slow_down(part),
            learning=self.learning.slow_down(part), part=max(part, self.least))

    def reconfigured(self, memory: Memory) -> Memory:
        """Return the memory without a slope if the observer has none now."""
        if self.observer.jerk != 0.0:
            return memory
        return memory._replace(observed=memory.observed._replace(slope=0.0 * self.given))

    def initial(self) -> Memory:
        """Return the memory with nothing observed or learned."""
        zero = 0.0 * self.given
        return Memory(
            observed=Observed(*(zero,) * 5), mass=np.zeros_like(self.kp), ddq=zero,
            deviation=Deviation(zero, zero), known=0.0,
            learned=LearnedFriction(self.given, *(zero,) * 5),
            rest=Standstill(*(zero,) * 4),
            oscillation=Oscillation(
                *(zero,) * 4, retreat=0.0, strained=-START_GRACE_S, frequency=zero, calm=0.0,
                cycling=0.0))

    def initialized(self, now: State, estimate: Array) -> Memory:
        """Begin with what the other law estimates beside friction."""
        P = nearest(now.M, estimate - self.given * np.sign(now.dq), self.ka)
        return self.initial()._replace(
            observed=Observed(now.q, now.dq, now.zero, P, now.zero))

    def predicted_state(self, memory: Memory, last: LastSample, context: Context
                        ) -> tuple[Array, Array]:
        """Return q̂ and dq̂ as predicted; at first, by the model."""
        return observed_state(self, memory, last, context, memory.observed.q, memory.observed.dq)

    def corrected(self, memory: Memory, q: Array, dq: Array, held: Array
                  ) -> tuple[Memory, Array, Array]:
        """Return q̂ and dq̂, corrected by the measured position; at first the measured ones."""
        rest = self.standstill.track_position(memory.rest, q)
        if memory.known != 0.0:
            at = hold_standing(rest, memory.observed, self.slowed_down(memory).observer.correct(
                memory.observed, memory.mass, q))
        else:
            at = memory.observed._replace(q=q, dq=dq, torque=held)
        return memory._replace(observed=at, rest=rest), at.q, at.dq

    def answer(self, memory: Memory, now: State, context: Context) -> tuple[Terms, Memory]:
        """Return the terms of (OF4), for the state in which the torque arrives."""
        return self.slowed_down(memory).answered(memory, now, context)

    def answered(self, memory: Memory, now: State, context: Context) -> tuple[Terms, Memory]:
        """Return `answer` with the bandwidths of this law."""
        points, delay = context.points, int(context.settings.delay)
        place = Place(memory.observed, now.M, now.bias)
        for j in range(delay):
            arrived = self.predicted(memory, place, context.in_transit(j))
            place = placed(context.models.arriving, arrived)
        point = Desired(points[3 * delay], points[3 * delay + 1], points[3 * delay + 2])
        by = memory.deviation
        if memory.known == 0.0:
            by = Deviation(place.at.q - point.q, place.at.dq - point.dq)
        held, level = place.at.torque, memory.learned.level
        tau, z, back, feedback = self.wanted(memory, place, point, by)
        by = self.reference.advance(point, by, back, diagonal(place.M), level)
        half = 0.5 * (held + tau)                              # The drives are half way to τ*.
        half_way = place._replace(at=place.at._replace(torque=half))
        after = placed(context.models.after, self.predicted(memory, half_way, half))
        step = memory.known * (point.ddq - memory.ddq)
        later, _, _, _ = self.wanted(
            memory, after, next_point(point, step, self.reference.period), by)
        tau = self.observer.drives.command_for(tau, later)
        sent = held + nearest(place.M, tau - held, self.observer.drives.reach)
        by = self.reference.relieve(by, tau - sent, place.M)
        return Terms(sent + z, now.zero, z, now.zero), memory._replace(
            deviation=by, ddq=point.ddq,
            rest=self.standstill.detect_standstill(memory.rest, point, diagonal(place.M), level),
            oscillation=self.guard.update_oscillation(memory.oscillation, feedback, tau - sent))

    def predicted(self, memory: Memory, place: Place, command: Array) -> Observed:
        """Return the state a period later, under a command to the drives."""
        return self.observer.predict(
            place.at, place.M, place.bias, memory.learned.level, command)

    def wanted(self, memory: Memory, place: Place, point: Desired, by: Deviation
               ) -> tuple[Array, Array, Array, Array]:
        """
        Return τ* [N·m], z [N·m], -2 w dx - w² x [rad/s²] and f [N·m], each of shape (n,).

        By (OF2), (OF3), (FR3) and (OF5); parameters are the memory, the state, a point of the
        reference there, and its deviation.
        """
        at, M, level = place.at, place.M, memory.learned.level
        back = self.reference.compute_recovery(by, diagonal(M), level)
        r = self.reference.shift(point, by, back)
        z = -nearest(M, at.perturbation + self.reference.feed_forward(point, level, 0.0), self.ka)
        u = self.part * (dot(self.kv, r.dq - at.dq) + self.part * dot(self.kp, r.q - at.q))
        feedback = dot(M, u)
        return dot(M, r.ddq) + feedback + place.bias - z, z, back, feedback

    def advanced(self, memory: Memory, now: State, applied: Applied) -> Memory:
        """Learn the level of friction, and predict the next sample."""
        at = memory.observed
        learned = self.slowed_down(memory).learning.learn(memory.learned, at.dq, at.perturbation)
        by = self.reference.relieve(memory.deviation, applied.saturation_error, now.M)
        after = self.observer.predict(at, now.M, now.bias, learned.level, applied.tau)
        return memory._replace(
            observed=after, mass=now.M, known=1.0, learned=learned, deviation=by)

    def estimate(self, memory: Memory, now: State) -> Array:
        """Return P̂ with the friction of sliding."""
        return memory.observed.perturbation + memory.learned.level * np.sign(now.dq)


@function
def with_parts(kp: Array, kv: Array, ka: Array, given: Array, observer: StateObserver,
               learning: FrictionLearner, bandwidth: float) -> ObserverFeedback:
    """Return the law with its gains, and ω [rad/s] of the observer; the rest follows from them."""
    drives, stiffness = observer.drives, diagonal(kp)
    pole, h, rate = np.sqrt(stiffness), drives.period, drives.rate
    return ObserverFeedback(
        kp=kp, kv=kv, ka=ka, given=given, observer=observer,
        reference=design_reference(stiffness, diagonal(kv), rate, drives.lag, h),
        learning=learning, standstill=design_detector(bandwidth, ka, rate, h),
        guard=design_guard(ka, rate, pole, h),
        part=1.0, least=min(1.0, float(_STIFF / pole.max())))


@function
def placed(model: Model, at: Observed) -> Place:
    """Return a state with its dynamics."""
    M, C, G = model.evaluate(at.q, at.dq)
    return Place(at, M, dot(C, at.dq) + G)
