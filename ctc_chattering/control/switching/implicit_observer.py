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

"""Switching `implicit_observer`: `implicit` with an estimate P̂ of the perturbation."""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.evaluation import ErrorFilter, filter_of, State
from ctc_chattering.control.laws.base import Applied
from ctc_chattering.control.perturbation_observer import (
    Perturbation,
    perturbation_observer,
    PerturbationObserver,
)
from ctc_chattering.control.switching.base import switching
from ctc_chattering.control.switching.implicit import unclipped
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@switching
class ImplicitObserver(NamedTuple):
    """The term of `Implicit` for w - P̂ in the place of w; the whole term stays within ±Ka."""

    #: The filter (3), which predicts v.
    filter: ErrorFilter  # noqa: A003
    #: Estimates the perturbation within ±Ka.
    observer: PerturbationObserver

    @classmethod
    def made(cls, config: ControllerConfig, period: float) -> ImplicitObserver:
        """Return the switching of a configuration."""
        return cls(filter_of(config, period), perturbation_observer(
            config.observer_bandwidth, period, config.b, np.array(config.ka)))

    def term(self, memory: Perturbation, at: State, compensation: Array) -> tuple[Array, Array]:
        """Return z for the estimated perturbation, and its clipping error."""
        wanted = unclipped(self.filter, at, compensation) - memory.perturbation
        z = nearest(at.M, wanted, self.observer.bound)
        return z, wanted - z

    def updated(self, memory: Perturbation, now: State) -> Perturbation:
        """Improve P̂."""
        return self.observer.improve(memory, now.v)

    def advanced(self, memory: Perturbation, now: State, applied: Applied, correction: Array
                 ) -> Perturbation:
        """Predict the next sample."""
        nominal = self.filter.nominal_response(now.v, now.u) + correction
        return self.observer.expect(
            memory, now.M, nominal, now.N - applied.tau, applied.clipping_error)

    def estimate(self, memory: Perturbation, now: State) -> Array:
        """Return P̂."""
        return memory.perturbation


#: What the name of this module stands for.
SWITCHING = ImplicitObserver
