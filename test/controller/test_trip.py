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

"""What trips the controller: a loop that oscillates, and not one that has been quiet."""

from __future__ import annotations

import math

from ctc_chattering.control.controller import Controller, ControllerConfig, Sample
from ctc_chattering.control.laws.observer_feedback import Memory
from ctc_chattering.controller.state_machine import Input
from ctc_chattering.controller.trip import Trip, TripMonitor
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig, Sinusoid
import pytest

MS, ZERO = 1_000_000, [0.0, 0.0]
QUIET = Sample(ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, None)


def at(part: float, strained: float = 0.0, law: str = 'observer_feedback') -> Controller:
    """Return a controller at a part of its bandwidth that has been too much for a time [s]."""
    made = Controller(ControllerConfig(law=law, compiled=False))
    memory = made.law_memory
    if isinstance(memory, Memory):
        made._law_memory = memory._replace(  # type: ignore[assignment]
            oscillation=memory.oscillation._replace(
                retreat=math.log(part), strained=strained))
    return made


def checked(monitor: TripMonitor, law: Controller, samples: int) -> Trip | None:
    """Return the first trip within some samples."""
    for _ in range(samples):
        if (found := monitor.check(law, QUIET)) is not None:
            return found
    return None


@pytest.mark.parametrize('period', [MS, 2 * MS, 50 * MS])
def test_a_fifth_of_a_second_out_of_control_trips(period: int) -> None:
    monitor = TripMonitor(['a', 'b'], period)
    assert checked(monitor, at(0.1, 0.19), 100) is None
    found = checked(monitor, at(0.1, 0.21), max(20 * MS // period, 1))
    assert found is not None and found.event is Input.OSCILLATION
    assert found.detail == 'the feedback of observer_feedback oscillated at 10 % of its bandwidth'


def test_a_loop_that_found_its_bandwidth_goes_on_with_a_warning() -> None:
    monitor = TripMonitor(['a', 'b'], MS)
    assert checked(monitor, at(0.1), 150) is None and checked(monitor, at(0.3), 2000) is None
    (level, text), = monitor.warnings()
    assert level == 1 and 'down to 10 % of its bandwidth' in text
    assert monitor.warnings() == []


def test_other_laws_and_a_quiet_loop_are_not_warned_of() -> None:
    for law in (at(1.0), at(0.8), at(1.0, law='chattering')):
        monitor = TripMonitor(['a', 'b'], MS)
        assert checked(monitor, law, 1000) is None and monitor.warnings() == []


def trip_of(rate: list[float]) -> tuple[Trip | None, float]:
    """Return the trip of the arm with drives of which nothing is known, and the error then."""
    motion = Sinusoid(ReferenceConfig())
    start = motion.at(0)
    law = Controller(ControllerConfig.from_mapping({
        'law': 'observer_feedback', 'kp': [1e4] * 2, 'kv': [200.0] * 2, 'ka': [60.0, 30.0],
        'estimator_bandwidth': 200.0, 'compiled': False}))
    plant = Plant(PlantConfig.from_mapping({
        'coulomb_friction': [9.9] * 2, 'torque_rate_limit': rate, 'actuator_lag': [2e-3] * 2,
        'initial_position': list(start[0]), 'initial_velocity': list(start[1]),
        'compiled': False}))
    monitor, largest = TripMonitor(['a', 'b'], MS), 0.0
    for k in range(1500):
        sample = law.step(*plant.measured, *motion.at(k * MS))
        if (found := monitor.check(law, sample)) is not None:
            return found, largest
        largest = max(largest, *map(abs, sample.e))
        plant.step(sample.tau)
    return None, largest


def test_drives_that_are_too_slow_for_the_motion_trip_before_they_diverge() -> None:
    """Check both sides, with drives of which the law knows nothing."""
    found, error = trip_of([1000.0, 200.0])
    assert found is not None and found.event is Input.OSCILLATION and error < 1.0
    assert trip_of([5000.0, 1000.0])[0] is None


def test_the_error_limit_comes_first() -> None:
    law = Controller(ControllerConfig(error_limit=(0.1, 0.1)))
    found = TripMonitor(['a', 'b'], MS).check(law, QUIET._replace(e=[0.0, 0.2]))
    assert found is not None and found.event is Input.ERROR_LIMIT
    assert found.reason == 'the position error of b exceeded error_limit'
