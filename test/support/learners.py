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

"""A learner whose correction depends on one error, and the same run with one table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.simulation.closed_loop import ClosedLoop
from ctc_chattering.simulation.plant import make_plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig
from ctc_chattering.trajectory.transitions import TimedMotion
import numpy as np

#: Path time of the error that counts, and at which its correction begins [ns].
ERROR_TIME, BEGIN = 60_000_000, 100_000_000


class Offset:
    """A motion plus a multiple of a cube from `BEGIN` on."""

    def __init__(self, motion: TimedMotion, size: Sequence[float]) -> None:
        self._motion = motion
        self._size = size

    def at(self, t: int) -> Point:
        """Return the point at `t` [ns]."""
        s = max(t - BEGIN, 0) / 1e8
        added = s ** 3, 3e1 * s ** 2, 6e2 * s
        return tuple(  # type: ignore[return-value]
            tuple(x + amount * size for x, size in zip(row, self._size))
            for row, amount in zip(self._motion.at(t), added))


class OneErrorLearner:
    """Adds an `Offset` as large as the error at `ERROR_TIME`."""

    def __init__(self) -> None:
        #: Path time by which the motion is known beyond the last sample [ns].
        self.horizon = 25_000_000
        self.added: list[tuple[int, Sequence[float], Sequence[float]]] = []

    def corrected(self, motion: TimedMotion) -> TimedMotion:
        """Return the motion with its offset, 0 before the error is known."""
        errors = [e for s, _, e in self.added if s >= ERROR_TIME]
        return Offset(motion, errors[0] if errors else (0.0, 0.0))

    def known_until(self) -> int:
        """Return a path time before `BEGIN` until the error is known."""
        last = self.added[-1][0] if self.added else 0
        return last + self.horizon

    def add(self, s: int, q_d: Sequence[float], e: Sequence[float]) -> None:
        """Note a sample."""
        self.added.append((s, q_d, e))


class LearningSetup(NamedTuple):
    """A learner with the configurations of its run."""

    learner: OneErrorLearner
    plant: PlantConfig
    controller: ControllerConfig
    reference: ReferenceConfig


def learning_setup(compiled: bool) -> LearningSetup:
    """Return a run at half the speed, with a delay and the joints in another order."""
    return LearningSetup(
        OneErrorLearner(), PlantConfig(duration=0.5, input_delay=2, compiled=compiled),
        ControllerConfig.from_mapping({
            'law': 'observer_feedback', 'input_delay': 2, 'state_decimation': 7,
            'compiled': compiled}),
        ReferenceConfig.from_mapping({
            'joint_names': ['joint2', 'joint1'], 'center': [1.5, 3.0], 'frequency': [1.0, 2.0],
            'speed_scaling': 0.5}))


def corrected_at_once(plant: PlantConfig, controller: ControllerConfig,
                      reference: ReferenceConfig) -> ClosedLoop:
    """Return the run with the motion of `OneErrorLearner` from one table, in plain Python."""
    motion = make_motion(reference)
    size = np.zeros(2)
    for _ in range(2):  # The first run only gives the error.
        offset = Offset(motion, size.tolist())
        table = np.array([offset.at(k * 500_000) for k in range(503)])[:, :, ::-1]
        table *= np.array([1.0, 0.5, 0.25])[:, np.newaxis]  # Half the speed.
        loop = ClosedLoop(make_plant(plant), Controller(controller), table)
        loop.advance(501)
        first = next(k for k in range(0, 501, controller.state_decimation)
                     if k * 500_000 >= ERROR_TIME)
        size = loop.recorded.e[first, ::-1]
    return loop
