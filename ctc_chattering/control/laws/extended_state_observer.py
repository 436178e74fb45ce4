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
Law `extended_state_observer`: active disturbance rejection with friction fed forward.

Han, *From PID to active disturbance rejection control*, IEEE TIE 56, 2009, with the generalized
observer of Godbole, Kolhe & Talole, IEEE TCST 21, 2013, in which the slope of the perturbation is
a state. The drives are known: their torque is τ_d, and E = exp(-h / T). ⁺ is the end of the period
in which the torque arrives. `control/observer.py` has the observer and
`dynamics/drive_response.py` the drives::

    q̂, dq̂, P̂, Ṗ̂:  corrected by the measured q, then predicted until ⁺                    (ES1)
    τ* = M (ddq_d + Kv (dq_d - dq̂) + Kp (q_d - q̂)) + C dq̂ + G + P̂ + F, all at ⁺          (ES2)
    F  = f tanh((dq_d + t ddq_d) / ε)                                                    (ES3)
    τ  = (τ* - E τ_d) / (1 - E), within τ_d ± R (T + h)                                  (ES4)

so that the drives give τ* at ⁺. The observer also knows F, so P̂ is the remaining friction. The
lead t [s] begins the change of F before the reversal, since the rate of the drives is limited.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import dot, record
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.feasible_reference import next_point
from ctc_chattering.control.laws.base import law, observed_state
from ctc_chattering.control.laws.friction_feedforward import friction_ahead, FrictionAhead
from ctc_chattering.control.observer import (
    design_observer,
    evaluate_model,
    ModelTerms,
    Observed,
    StateObserver,
)
from ctc_chattering.control.recommended_gains import PoleRule
from ctc_chattering.control.sample import Applied, Context, LastSample, MeasuredState, State, Terms
from ctc_chattering.numerics.box_qp import clip, nearest
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class ExtendedState(NamedTuple):
    """Memory of the law."""

    #: State, predicted from the last sample.
    observed: Observed
    #: M of the last sample [kg·m²], shape (n, n).
    mass: Array
    #: ddq_d at the arrival of the last torque [rad/s²], shape (n,).
    ddq: Array
    #: 1.0 after the first sample, else 0.0.
    has_sample: float


@law(symbol='-(P̂ + F)',
     parameters=('ka', 'estimator_bandwidth', 'actuator_lag', 'torque_rate_limit',
                 'friction_level', 'friction_velocity', 'friction_lead'),
     gain_rule=PoleRule(0.4, 40.0, times_p={'estimator_bandwidth': 3.0}))
class ExtendedStateObserver(NamedTuple):
    """Computed torque plus an observer's estimate, and friction."""

    #: F of (ES3).
    friction: FrictionAhead
    observer: StateObserver

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> ExtendedStateObserver:
        """Return the law of a configuration."""
        drives = config.assumed_drives(period)
        observer = design_observer(drives, config.estimator_bandwidth, np.array(config.ka))
        return cls(friction_ahead(config), observer)

    def with_gains(self, kp: Array, kv: Array, ka: Array) -> ExtendedStateObserver:
        """Return the law with another Ka."""
        return self._replace(observer=self.observer._replace(bound=ka))

    def initial(self) -> ExtendedState:
        """Return the memory before any sample."""
        zero = 0.0 * self.friction.level
        return ExtendedState(Observed(*(zero,) * 5), np.diag(zero), zero, has_sample=0.0)

    def initialized(self, now: State, estimate: Array) -> ExtendedState:
        """Begin with the other law's estimate, beside friction."""
        remaining = estimate - self.friction.friction_torque(now.dq_d, now.ddq_d)
        P = nearest(now.M, remaining, self.observer.bound)
        observed = Observed(now.q, now.dq, now.zero, P, now.zero)
        return self.initial()._replace(observed=observed)

    def predicted_state(self, memory: ExtendedState, last: LastSample, context: Context
                        ) -> tuple[Array, Array]:
        """Return q̂ and dq̂ as predicted."""
        return observed_state(self, memory, last, context, memory.observed.q, memory.observed.dq)

    def corrected(self, memory: ExtendedState, q: Array, dq: Array, held: Array
                  ) -> tuple[ExtendedState, MeasuredState]:
        """
        Return q̂ and dq̂, corrected by the measured position.

        At the first sample they are the measured ones.
        """
        if memory.has_sample != 0.0:
            state = self.observer.correct(memory.observed, memory.mass, q)
        else:
            state = memory.observed._replace(q=q, dq=dq, torque=held)
        return memory._replace(observed=state), MeasuredState(state.q, state.dq)

    def answer(self, memory: ExtendedState, now: State, context: Context
               ) -> tuple[Terms, ExtendedState]:
        """
        Return the terms of (ES4).

        They are for the period in which the torque arrives.
        """
        settings = context.settings
        delay = int(settings.delay)
        drives = self.observer.drives
        model = ModelTerms(memory.observed, now.M, now.bias)
        for j in range(delay):
            point = context.reference_at(j)
            F = self.friction.friction_torque(point.dq, point.ddq)
            later = self.moved(model, context.in_transit(j), F)
            model = evaluate_model(context.models.arriving, later)
        arrival = context.reference_at(delay)
        F = self.friction.friction_torque(arrival.dq, arrival.ddq)
        held = model.state.torque
        later = self.moved(model, context.memory.held, F)
        model = evaluate_model(context.models.after, later)
        change = memory.has_sample * (arrival.ddq - memory.ddq)
        r = next_point(arrival, change, drives.period)
        s = model.state
        z = -(s.perturbation + self.friction.friction_torque(r.dq, r.ddq))
        u = dot(settings.kv, r.dq - s.dq) + dot(settings.kp, r.q - s.q)
        desired = dot(model.M, r.ddq + u) + model.bias - z                        # (ES2)
        command = (desired - drives.decay * held) / (1.0 - drives.decay)          # (ES4)
        sent = clip(command, held - drives.reach, held + drives.reach)
        memory = memory._replace(ddq=arrival.ddq)
        return Terms(sent + z, now.zero, z, now.zero), memory

    def moved(self, model: ModelTerms, command: Array, F: Array) -> Observed:
        """
        Return the state a period later.

        It is under a command to the drives, and the friction F.
        """
        with_friction = model._replace(bias=model.bias + F)
        return self.observer.predict(with_friction, 0.0 * F, command)

    def advanced(self, memory: ExtendedState, now: State, applied: Applied) -> ExtendedState:
        """Predict the next sample."""
        model = ModelTerms(memory.observed, now.M, now.bias)
        F = self.friction.friction_torque(now.dq_d, now.ddq_d)
        later = self.moved(model, applied.tau, F)
        return memory._replace(observed=later, mass=now.M, has_sample=1.0)

    def estimate(self, memory: ExtendedState, now: State) -> Array:
        """Return P̂ + F."""
        return memory.observed.perturbation + self.friction.friction_torque(now.dq_d, now.ddq_d)
