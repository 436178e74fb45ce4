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

"""A robot of two joints before a control loop, without ROS."""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.controller.loop import ControlLoop
from ctc_chattering.controller.positions import JointSample
from ctc_chattering.controller.status import loop_status
from ctc_chattering.trajectory.reference import ReferenceConfig, Sinusoid

MS = 1_000_000
ZERO = [0.0, 0.0]
MOTION = [Sinusoid(ReferenceConfig()).at(k * MS) for k in range(2000)]


class Log:
    """Keeps what is logged."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def info(self, message: str, /, **_filters: float) -> None:
        self.lines.append(message)

    warning = error = info


class Robot:
    """A robot before a loop; it stands at q, and a state comes as soon as it is taken."""

    def __init__(self, simulated: bool, enabled: bool = True, **config: object) -> None:
        self.sent: list[list[float]] = []
        self.log = Log()
        self.config = ControllerConfig().changed(config)
        self.loop = ControlLoop(
            self.config, 0.02, 0.1, enabled, lambda tau: self.sent.append([float(x) for x in tau]),
            self.log)
        self.loop.law = Controller(self.config)
        self.loop.motion.restart_duration = 2.0
        self.simulated = simulated
        self.k = 0

    def reference(self, first: int, last: int) -> None:
        self.loop.take_reference([k * MS for k in range(first, last)], MOTION[first:last])

    def state(self, k: int, q: Sequence[float] = (0.1, 0.2), matched: bool = True
              ) -> list[list[float]]:
        """Send the state of sample k; return what was sent for it."""
        self.k, before = k, len(self.sent)
        self.restarted = self.loop.take_state(
            JointSample(k * MS, q, ZERO), k * MS, self.simulated)
        self.answer(matched)
        return self.sent[before:]

    def answer(self, matched: bool = True) -> None:
        self.loop.answer(matched)

    def silence(self, k: int) -> list[list[float]]:
        """Let it be sample k without a state."""
        before = len(self.sent)
        if not self.simulated:
            self.loop.check_silence(k * MS)
        self.answer()
        return self.sent[before:]

    def status(self) -> tuple[int, str]:
        return loop_status(self.loop, self.k * MS, {}, 0)
