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

"""What ends the torques until a reset: a large error, or a loop that oscillates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ctc_chattering.control.controller import Controller, Sample
from ctc_chattering.controller.error_limit import joint_beyond
from ctc_chattering.controller.state_machine import Input
from ctc_chattering.numerics.time_grid import NANOSECONDS

#: How long a loop may seem out of control [s], and how often that is read [ns].
_PATIENCE, _INTERVAL = 0.2, NANOSECONDS // 50
#: Part of the bandwidth below which it is worth a word.
_WORTH_A_WORD = 0.7


class Trip(NamedTuple):
    """Why no torque is sent until a reset."""

    event: Input
    #: For the status, and for the log.
    reason: str
    detail: str


class TripMonitor:
    """
    Watches the error, and the bandwidth that a law leaves itself.

    Parameters
    ----------
    names : sequence of str
        The joints.
    period : int
        Control period [ns].

    """

    def __init__(self, names: Sequence[str], period: int) -> None:
        self._names = names
        self._interval = max(_INTERVAL // period, 1)
        self._samples = 0
        self._lowest = 1.0

    def check(self, law: Controller, sample: Sample) -> Trip | None:
        """Return why the torque of a sample must not be sent; None if it may be."""
        joint = joint_beyond(sample.e, law.config.error_limit)
        if joint is not None:
            return Trip(
                Input.ERROR_LIMIT,
                f'the position error of {self._names[joint]} exceeded error_limit',
                f'the position errors {[float(f"{x:.4g}") for x in sample.e]} rad exceed '
                'error_limit')
        self._samples += 1
        if self._samples % self._interval:
            return None
        part, duration = law.stability
        self._lowest = min(self._lowest, part)
        if duration < _PATIENCE:
            return None
        text = f'the feedback of {law.config.law} oscillated'
        return Trip(Input.OSCILLATION, text, f'{text} at {100.0 * part:.0f} % of its bandwidth')

    def warnings(self) -> list[tuple[int, str]]:
        """Return level and text of what was seen since the last call."""
        lowest, self._lowest = self._lowest, 1.0
        if lowest > _WORTH_A_WORD:
            return []
        return [(1, f'the feedback oscillates; the law is down to {100.0 * lowest:.0f} % of its '
                 'bandwidth. Are the drives slower than torque_rate_limit, or later than '
                 'actuator_lag and input_delay say?')]
