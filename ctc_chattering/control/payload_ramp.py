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
A payload that enters the model of a running controller smoothly.

`Controller` has one `PayloadRamp`. A payload that was set comes in, and the one before goes, as
point masses that grow and shrink by steps over a second.
"""

from __future__ import annotations

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.dynamics.model import Model, PointMass
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import seconds

#: Time in which a payload enters [s].
RAMP_S = 1.0
#: Number of steps in which it enters. Each changes its torque by a hundredth.
_STEPS = 100


class PayloadRamp:
    """
    The model of an arm with its payload.

    Parameters
    ----------
    model : Model
        The arm alone.
    config : ControllerConfig
        Its payload is there from the start.
    period : int
        Control period [ns].

    Attributes
    ----------
    model : Model
        With the present payload.

    """

    def __init__(self, model: Model, config: ControllerConfig, period: int) -> None:
        self._arm = model
        model.with_payload([])  # It finds the tip, which takes longer than a sample.
        self._samples_per_step = max(round(RAMP_S / _STEPS / seconds(period)), 1)
        #: Payload that leaves, and that which enters.
        self._old: list[PointMass] = []
        self._new = _payload(config)
        #: Samples since a payload was set.
        self._sample = self._samples_per_step * _STEPS
        self.model = self._loaded()

    @property
    def _share(self) -> float:
        """Share of the payload that has entered, from 0 to 1."""
        return min(self._sample // self._samples_per_step / _STEPS, 1.0)

    @property
    def changing(self) -> bool:
        """Tell whether a payload is entering."""
        return self._share < 1.0

    def check(self, config: ControllerConfig) -> None:
        """Raise `CtcError` if the model cannot carry a payload."""
        if config.payload_mass:
            self._arm.with_payload([_payload(config)])

    def request(self, config: ControllerConfig) -> None:
        """Have the payload of a configuration enter."""
        payload = _payload(config)
        if payload != self._new:
            self._old = self._present()
            self._new = payload
            self._sample = 0

    def finish(self) -> None:
        """Have all of the payload enter with the next sample."""
        self._sample = max(self._sample, self._samples_per_step * _STEPS - 1)

    def advance(self) -> bool:
        """Go on by a sample, and return whether the model has changed."""
        last_share = self._share
        self._sample += 1
        if self._share == last_share:
            return False
        self.model = self._loaded()
        return True

    def _present(self) -> list[PointMass]:
        """Return the point masses that the arm carries now."""
        share = self._share
        leaving = [PointMass((1.0 - share) * x.mass, x.center) for x in self._old]
        entering = PointMass(share * self._new.mass, self._new.center)
        return [x for x in (*leaving, entering) if x.mass]

    def _loaded(self) -> Model:
        masses = self._present()
        return self._arm.with_payload(masses) if masses else self._arm


def _payload(config: ControllerConfig) -> PointMass:
    """Return the payload of a configuration."""
    center: Vector = config.payload_center
    return PointMass(config.payload_mass, center)
