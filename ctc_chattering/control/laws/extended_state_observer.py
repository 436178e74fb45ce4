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
observer of Godbole, Kolhe & Talole, IEEE TCST 21, 2013 (the slope of the perturbation is a
state), for drives that are known. With what `observer` and `dynamics/drive_response` define, the
drives' torque τ_d and E = exp(-h / T), ⁺ for the end of the period in which the torque arrives::

    q̂, dq̂, P̂, Ṗ̂:  corrected by the measured q, then predicted until ⁺                    (ES1)
    τ* = M (ddq_d + Kv (dq_d - dq̂) + Kp (q_d - q̂)) + C dq̂ + G + P̂ + F, all at ⁺          (ES2)
    F  = f tanh((dq_d + t ddq_d) / ε)                                                    (ES3)
    τ  = (τ* - E τ_d) / (1 - E), within τ_d ± R (T + h)                                  (ES4)

so that the drives give τ* at ⁺. The observer knows F, too: P̂ is what is left of the friction. The
lead t [s] begins the change of F before the reversal, which drives with a limited rate need.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import dot, record
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.feasible_reference import Desired, next_point
from ctc_chattering.control.laws.base import law, observed_state
from ctc_chattering.control.laws.observer_feedback import Place, placed
from ctc_chattering.control.observer import design_observer, Observed, StateObserver
from ctc_chattering.control.sample import Applied, Context, LastSample, State, Terms
from ctc_chattering.dynamics.drive_response import discretize_drives
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class ExtendedState(NamedTuple):
    """What the law remembers from sample to sample; truth values are 1.0 and 0.0."""

    #: The state, predicted from the last sample with M, (n, n), and ddq_d [rad/s²], shape (n,),
    #: there, and whether there is one.
    observed: Observed
    mass: Array
    ddq: Array
    known: float


@law(symbol='-(P̂ + F)')
class ExtendedStateObserver(NamedTuple):
    """Computed torque plus the estimate of an extended state observer, and friction."""

    #: f [N·m], shape (n,), ε [rad/s] and t [s].
    friction: Array
    width: float
    ahead: float
    observer: StateObserver

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> ExtendedStateObserver:
        """Return the law of a configuration."""
        drives = discretize_drives(
            np.array(config.assumed_lag), np.array(config.torque_rate_limit), period)
        observer = design_observer(drives, config.estimator_bandwidth, np.array(config.ka))
        return cls(np.array(config.friction_level), config.friction_velocity,
                   config.friction_lead, observer)

    def with_gains(self, kp: Array, kv: Array, ka: Array) -> ExtendedStateObserver:
        """Return the law with another Ka."""
        return self._replace(observer=self.observer._replace(bound=ka))

    def initial(self) -> ExtendedState:
        """Return the memory with nothing observed."""
        zero = 0.0 * self.friction
        return ExtendedState(Observed(*(zero,) * 5), np.diag(zero), zero, known=0.0)

    def initialized(self, now: State, estimate: Array) -> ExtendedState:
        """Begin with what the other law estimates beside friction."""
        P = nearest(now.M, estimate - self.fed_forward(now.dq_d, now.ddq_d),
                    self.observer.bound)
        return self.initial()._replace(
            observed=Observed(now.q, now.dq, now.zero, P, now.zero))

    def predicted_state(self, memory: ExtendedState, last: LastSample, context: Context
                        ) -> tuple[Array, Array]:
        """Return q̂ and dq̂ as predicted; at first, by the model."""
        return observed_state(self, memory, last, context, memory.observed.q, memory.observed.dq)

    def corrected(self, memory: ExtendedState, q: Array, dq: Array, held: Array
                  ) -> tuple[ExtendedState, Array, Array]:
        """Return q̂ and dq̂, corrected by the measured position; at first the measured ones."""
        if memory.known != 0.0:
            at = self.observer.correct(memory.observed, memory.mass, q)
        else:
            at = memory.observed._replace(q=q, dq=dq, torque=held)
        return memory._replace(observed=at), at.q, at.dq

    def answer(self, memory: ExtendedState, now: State, context: Context
               ) -> tuple[Terms, ExtendedState]:
        """Return the terms of (ES4), for the period in which the torque arrives."""
        points = context.points
        place, delay = Place(memory.observed, now.M, now.bias), int(context.settings.delay)
        for j in range(delay):
            F = self.fed_forward(points[3 * j + 1], points[3 * j + 2])
            after = self.moved(place, context.in_transit(j), F)
            place = placed(context.models.arriving, after)
        held, drives = place.at.torque, self.observer.drives
        dq, ddq = points[3 * delay + 1], points[3 * delay + 2]
        place = placed(context.models.after,
                       self.moved(place, context.memory.held, self.fed_forward(dq, ddq)))
        r = next_point(Desired(points[3 * delay], dq, ddq), memory.known * (ddq - memory.ddq),
                       drives.period)
        z = -(place.at.perturbation + self.fed_forward(r.dq, r.ddq))
        settings = context.settings
        u = dot(settings.kv, r.dq - place.at.dq) + dot(settings.kp, r.q - place.at.q)
        wanted = dot(place.M, r.ddq + u) + place.bias - z
        command = (wanted - drives.decay * held) / (1.0 - drives.decay)
        sent = np.minimum(np.maximum(command, held - drives.reach), held + drives.reach)
        return Terms(sent + z, now.zero, z, now.zero), memory._replace(ddq=ddq)

    def moved(self, place: Place, command: Array, F: Array) -> Observed:
        """Return the state a period later, under a command to the drives and the friction F."""
        return self.observer.predict(place.at, place.M, place.bias + F, 0.0 * F, command)

    def fed_forward(self, dq_d: Array, ddq_d: Array) -> Array:
        """Return F of (ES3), shape (n,) [N·m]."""
        return self.friction * np.tanh((dq_d + self.ahead * ddq_d) / self.width)

    def advanced(self, memory: ExtendedState, now: State, applied: Applied) -> ExtendedState:
        """Predict the next sample."""
        after = self.moved(Place(memory.observed, now.M, now.bias), applied.tau,
                           self.fed_forward(now.dq_d, now.ddq_d))
        return memory._replace(observed=after, mass=now.M, known=1.0)

    def estimate(self, memory: ExtendedState, now: State) -> Array:
        """Return P̂ + F."""
        return memory.observed.perturbation + self.fed_forward(now.dq_d, now.ddq_d)
