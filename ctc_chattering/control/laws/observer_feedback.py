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
Law `observer_feedback`: computed torque on an observed state.

It is for real drives and encoders.

An observer has the perturbation as a state (Han, *From PID to active disturbance rejection
control*, IEEE TIE 56, 2009), with the bound Ka of the paper's law (6). `control/observer.py` has
the observer, `dynamics/drive_response.py` the drives. `control/feasible_reference.py`,
`friction_learning.py`, `standstill.py` and `oscillation.py` adapt the law. At every sample::

    q̂, dq̂, P̂, Ṗ̂:  corrected by the measured q, then predicted until the torque arrives   (OF1)
    τ* = M (ddq_r + Kv (dq_r - dq̂) + Kp (q_r - q̂)) + C dq̂ + G - z                       (OF2)
    z  = -(P̂ + F), the nearest within ±Ka in the metric of M⁻¹                           (OF3)
    τ  = the command by which the drives give τ* at arrival and a period later           (OF4)

q_r is the reference with the deviation that the drives need. F is the friction that it causes. In
the metric of M⁻¹, τ is within R (T + h) of the torque of the drives: beyond it they are no faster.
The measured velocity is used at the first sample only. P̂ is kept at a joint that comes to rest.

Drives that differ from the configured ones make the feedback oscillate. `OscillationGuard` then
gives the bandwidths of feedback, P̂, deviation and learning a factor s, and P̂ the bound √s Ka.
The feedback keeps 10 rad/s of its bandwidth::

    f = M (k Kv (dq_r - dq̂) + k² Kp (q_r - q̂)),     k = max(s, 10 / √Kp_ii), at most 1     (OF5)

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
from ctc_chattering.control.observer import (
    design_observer,
    evaluate_model,
    ModelTerms,
    Observed,
    StateObserver,
)
from ctc_chattering.control.oscillation import (
    design_guard,
    Oscillation,
    OscillationGuard,
)
from ctc_chattering.control.recommended_gains import ObserverRule
from ctc_chattering.control.sample import (
    Applied,
    Context,
    Desired,
    LastSample,
    MeasuredState,
    State,
    Terms,
)
from ctc_chattering.control.standstill import (
    design_detector,
    hold_standing,
    Standstill,
    StandstillDetector,
)
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import matrix
import numpy as np

#: ln s above which the law is as configured: less is rounding of the guard.
_FULL_BANDWIDTH = -1e-3
#: Bandwidth that the feedback keeps [rad/s].
_LEAST_POLE = 10.0


@record
class Memory(NamedTuple):
    """Memory of the law."""

    #: State, predicted from the last sample.
    observed: Observed
    #: M of the last sample [kg·m²], shape (n, n).
    mass: Array
    #: ddq_d at the arrival of the last torque [rad/s²], shape (n,).
    ddq: Array
    #: x and dx of the reference.
    deviation: Deviation
    #: 1.0 after the first sample, else 0.0.
    has_sample: float
    #: K̂ and its filters.
    learned: LearnedFriction
    #: Joints at which P̂ is held.
    standing: Standstill
    #: s of (OG1), and the half-waves of the feedback.
    oscillation: Oscillation


@record
class DesiredTorque(NamedTuple):
    """Torque by (OF2) and its terms, each (n,)."""

    #: τ* [N·m].
    torque: Array
    #: z [N·m].
    z: Array
    #: -2 w dx - w² x of (FR3) [rad/s²].
    returning: Array
    #: f of (OF5) [N·m].
    feedback: Array


@law(symbol='-(P̂ + F)', is_watched=True, gain_rule=ObserverRule(),
     parameters=('ka', 'estimator_bandwidth', 'estimator_slope', 'actuator_lag',
                 'torque_rate_limit', 'friction_learning', 'friction_level'))
class ObserverFeedback(NamedTuple):
    """Computed torque on an observed state."""

    #: Kp [1/s²] and Kv [1/s], shape (n, n).
    kp: Array
    kv: Array
    #: Ka [N·m], shape (n,).
    ka: Array
    #: K̂ at the start [N·m], shape (n,).
    initial_level: Array
    observer: StateObserver
    reference: FeasibleReference
    learning: FrictionLearner
    standstill: StandstillDetector
    guard: OscillationGuard
    #: k of (OF5).
    feedback_scale: float
    #: Least k.
    least_scale: float

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> ObserverFeedback:
        """Return the law of a configuration."""
        n = len(config.joint_names)
        bandwidth = config.estimator_bandwidth
        ka = np.array(config.ka)
        drives = config.assumed_drives(period)
        return with_parts(
            np.array(matrix(config.kp, n)),
            np.array(matrix(config.kv, n)),
            ka,
            np.array(config.friction_level),
            design_observer(drives, bandwidth, ka, config.estimator_slope),
            design_learner(config.friction_learning, bandwidth, period, ka),
            bandwidth)

    def with_gains(self, kp: Array, kv: Array, ka: Array) -> ObserverFeedback:
        """Return the law with other gains."""
        return with_parts(
            kp,
            kv,
            ka,
            self.initial_level,
            self.observer._replace(bound=ka),
            self.learning._replace(bound=ka),
            self.standstill.bandwidth)

    def stability(self, memory: Memory) -> Stability:
        """Return s of (OG1) and the limit cycle (OG2)."""
        guarded = memory.oscillation
        joint = self.guard.find_cycling_joint(guarded)
        return Stability(
            exp(guarded.retreat),
            guarded.strained,
            guarded.cycling,
            joint,
            float(guarded.frequency[joint]))

    def slowed_down(self, memory: Memory) -> ObserverFeedback:
        """Return the law with s of its bandwidths."""
        if memory.oscillation.retreat > _FULL_BANDWIDTH:
            return self
        s = exp(memory.oscillation.retreat)
        return self._replace(
            observer=self.observer.slow_down(s),
            reference=self.reference.slow_down(s),
            learning=self.learning.slow_down(s),
            feedback_scale=max(s, self.least_scale))

    def reconfigured(self, memory: Memory) -> Memory:
        """Return the memory, without a slope for (SO3)."""
        if self.observer.jerk != 0.0:
            return memory
        return memory._replace(
            observed=memory.observed._replace(slope=0.0 * self.initial_level))

    def initial(self) -> Memory:
        """Return the memory before any sample."""
        zero = 0.0 * self.initial_level
        oscillation = Oscillation(
            *(zero,) * 4,
            retreat=0.0,
            strained=0.0,
            frequency=zero,
            calm=0.0,
            cycling=0.0)
        return Memory(
            observed=Observed(*(zero,) * 5),
            mass=np.zeros_like(self.kp),
            ddq=zero,
            deviation=Deviation(zero, zero),
            has_sample=0.0,
            learned=LearnedFriction(self.initial_level, *(zero,) * 5),
            standing=Standstill(*(zero,) * 4),
            oscillation=oscillation)

    def initialized(self, now: State, estimate: Array) -> Memory:
        """Begin with the other law's estimate, beside friction."""
        friction = self.initial_level * np.sign(now.dq)
        P = nearest(now.M, estimate - friction, self.ka)
        observed = Observed(now.q, now.dq, now.zero, P, now.zero)
        return self.initial()._replace(observed=observed)

    def predicted_state(self, memory: Memory, last: LastSample, context: Context
                        ) -> tuple[Array, Array]:
        """Return q̂ and dq̂ as predicted."""
        return observed_state(self, memory, last, context, memory.observed.q, memory.observed.dq)

    def corrected(self, memory: Memory, q: Array, dq: Array, held: Array
                  ) -> tuple[Memory, MeasuredState]:
        """
        Return q̂ and dq̂, corrected by the measured position.

        At the first sample they are the measured ones.
        """
        standing = self.standstill.track_position(memory.standing, q)
        state = memory.observed._replace(q=q, dq=dq, torque=held)
        if memory.has_sample != 0.0:
            observer = self.slowed_down(memory).observer
            state = observer.correct(memory.observed, memory.mass, q)
            state = hold_standing(standing, memory.observed, state)
        memory = memory._replace(observed=state, standing=standing)
        return memory, MeasuredState(state.q, state.dq)

    def answer(self, memory: Memory, now: State, context: Context) -> tuple[Terms, Memory]:
        """Return the terms of (OF4) at the arrival."""
        return self.slowed_down(memory).respond(memory, now, context)

    def respond(self, memory: Memory, now: State, context: Context) -> tuple[Terms, Memory]:
        """Return `answer` with the bandwidths of this law."""
        delay = int(context.settings.delay)
        level = memory.learned.level
        model = ModelTerms(memory.observed, now.M, now.bias)
        for j in range(delay):
            arriving = self.observer.predict(model, level, context.in_transit(j))
            model = evaluate_model(context.models.arriving, arriving)             # (OF1)
        point = context.reference_at(delay)
        deviation = memory.deviation
        if memory.has_sample == 0.0:
            deviation = Deviation(model.state.q - point.q, model.state.dq - point.dq)
        desired = self.desired_torque(memory, model, point, deviation)            # (OF2)
        inertia = diagonal(model.M)
        deviation = self.reference.advance(point, deviation, desired.returning, inertia, level)
        # The torque a period later, for which the drives are half way to τ* meanwhile.
        held = model.state.torque
        drives = self.observer.drives
        half = 0.5 * (held + desired.torque)
        half_way = model._replace(state=model.state._replace(torque=half))
        state_after = self.observer.predict(half_way, level, half)
        model_after = evaluate_model(context.models.after, state_after)
        ddq_step = memory.has_sample * (point.ddq - memory.ddq)
        point_after = next_point(point, ddq_step, self.reference.period)
        after = self.desired_torque(memory, model_after, point_after, deviation)
        command = drives.command_for(desired.torque, after.torque)                # (OF4)
        sent = held + nearest(model.M, command - held, drives.reach)
        shortfall = command - sent
        memory = memory._replace(
            deviation=self.reference.relieve(deviation, shortfall, model.M),
            ddq=point.ddq,
            standing=self.standstill.detect_standstill(memory.standing, point, inertia, level),
            oscillation=self.guard.update_oscillation(
                memory.oscillation, desired.feedback, shortfall))
        return Terms(sent + desired.z, now.zero, desired.z, now.zero), memory

    def desired_torque(self, memory: Memory, model: ModelTerms, point: Desired,
                       deviation: Deviation) -> DesiredTorque:
        """
        Return τ* for a state and a reference.

        It is by (OF2), (OF3), (FR3) and (OF5).
        """
        state = model.state
        M = model.M
        level = memory.learned.level
        k = self.feedback_scale
        returning = self.reference.compute_recovery(deviation, diagonal(M), level)
        F = self.reference.feed_forward(point, level, 0.0)
        z = -nearest(M, state.perturbation + F, self.ka)
        e = point.q + deviation.x - state.q
        de = point.dq + deviation.dx - state.dq
        u = k * (dot(self.kv, de) + k * dot(self.kp, e))
        feedback = dot(M, u)
        torque = dot(M, point.ddq + returning) + feedback + model.bias - z
        return DesiredTorque(torque, z, returning, feedback)

    def advanced(self, memory: Memory, now: State, applied: Applied) -> Memory:
        """Learn the level of friction, and predict the next sample."""
        state = memory.observed
        learning = self.slowed_down(memory).learning
        learned = learning.learn(memory.learned, state.dq, state.perturbation)
        deviation = self.reference.relieve(memory.deviation, applied.saturation_error, now.M)
        model = ModelTerms(state, now.M, now.bias)
        later = self.observer.predict(model, learned.level, applied.tau)
        return memory._replace(
            observed=later,
            mass=now.M,
            has_sample=1.0,
            learned=learned,
            deviation=deviation)

    def estimate(self, memory: Memory, now: State) -> Array:
        """Return P̂ with the friction of sliding."""
        return memory.observed.perturbation + memory.learned.level * np.sign(now.dq)


@function
def with_parts(kp: Array, kv: Array, ka: Array, initial_level: Array, observer: StateObserver,
               learning: FrictionLearner, bandwidth: float) -> ObserverFeedback:
    """Return the law for its gains and ω [rad/s]."""
    drives = observer.drives
    h = drives.period
    rate = drives.rate
    stiffness = diagonal(kp)
    pole = np.sqrt(stiffness)
    return ObserverFeedback(
        kp=kp,
        kv=kv,
        ka=ka,
        initial_level=initial_level,
        observer=observer,
        reference=design_reference(stiffness, diagonal(kv), rate, drives.lag, h),
        learning=learning,
        standstill=design_detector(bandwidth, ka, rate, h),
        guard=design_guard(ka, rate, pole, h),
        feedback_scale=1.0,
        least_scale=min(1.0, float(_LEAST_POLE / pole.max())))
