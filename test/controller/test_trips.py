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
import re
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig, Sample
from ctc_chattering.control.laws.observer_feedback import Memory
from ctc_chattering.controller.trips import joint_beyond, low_bandwidth, TripMonitor
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig, Sinusoid
import numpy as np
import pytest

MS, ZERO = 1_000_000, [0.0, 0.0]
QUIET = Sample(ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, None)


def at(part: float, strained: float = 0.0, law: str = 'observer_feedback', cycling: float = 0.0
       ) -> Controller:
    """Return a controller at a part of its bandwidth, with times of oscillation [s]."""
    made = Controller(ControllerConfig(law=law, compiled=False))
    memory = made.memories.law
    if isinstance(memory, Memory):
        oscillation = memory.oscillation._replace(
            retreat=math.log(part), strained=strained, cycling=cycling,
            wave_1=np.array([0.0, 9.0]), wave_2=np.array([0.0, 8.0]),
            frequency=np.array([3.0, 21.2]))
        made.memories = made.memories._replace(law=memory._replace(oscillation=oscillation))
    return made


def checked(monitor: TripMonitor, law: Controller, samples: int) -> str:
    """Return the first trip within some samples."""
    for _ in range(samples):
        if found := monitor.check(law, QUIET):
            return found
    return ''


@pytest.mark.parametrize('period', [MS, 2 * MS, 50 * MS])
def test_a_fifth_of_a_second_out_of_control_trips(period: int) -> None:
    monitor = TripMonitor(['a', 'b'], period)
    assert checked(monitor, at(0.1, 0.19), 100) == ''
    found = checked(monitor, at(0.1, 0.21), max(20 * MS // period, 1))
    assert found.startswith('the feedback of observer_feedback oscillated: b oscillates at 21 Hz; '
                            'possible causes are drives ')


def test_a_second_of_a_limit_cycle_trips_with_joint_and_frequency() -> None:
    monitor = TripMonitor(['a', 'b'], MS)
    assert checked(monitor, at(0.4, cycling=0.99), 100) == ''
    assert checked(monitor, at(0.4, cycling=1.0), 20) == (
        'the feedback of observer_feedback oscillated at every bandwidth: b oscillates '
        'at 21 Hz; the joints are elastic, or an inertia of the model is wrong, often a rotor; '
        'set resonance or correct rotor_inertia (docs/safety.md#limit-cycles)')


def test_a_loop_that_found_its_bandwidth_goes_on_with_a_warning() -> None:
    """And none of a quiet loop, or of another law."""
    for law, warned in ((at(0.1), 1), (at(0.3), 1), (at(0.8), 0), (at(1.0, law='chattering'), 0)):
        assert checked(TripMonitor(['a', 'b'], MS), law, 1000) == ''
        assert len(low_bandwidth(law)) == warned
    assert 'uses 10 % of its bandwidth' in low_bandwidth(at(0.1))[0]


#: Gains for drives with a lag of 2 ms.
HIGH = {'kp': [1e4] * 2, 'kv': [200.0] * 2, 'estimator_bandwidth': 200.0}


def trip_of(rate: list[float], **gains: Any) -> tuple[str, float]:
    """Return the trip of the arm with drives of which nothing is known, and the error then."""
    motion = Sinusoid(ReferenceConfig())
    start = motion.at(0)
    law = Controller(ControllerConfig.from_mapping({
        'law': 'observer_feedback', 'ka': [60.0, 30.0], 'compiled': False, **gains}))
    plant = Plant(PlantConfig.from_mapping({
        'coulomb_friction': [9.9] * 2, 'torque_rate_limit': rate, 'actuator_lag': [2e-3] * 2,
        'initial_position': list(start[0]), 'initial_velocity': list(start[1]),
        'compiled': False}))
    monitor, largest = TripMonitor(['a', 'b'], MS), 0.0
    for k in range(1500):
        sample = law.step(*plant.measured, *motion.at(k * MS))
        if found := monitor.check(law, sample):
            return found, largest
        largest = max(largest, *map(abs, sample.e))
        plant.step(sample.tau)
    return '', largest


@pytest.mark.parametrize(('rate', 'gains', 'reason'), [
    ([1000.0, 200.0], HIGH, 'the feedback of observer_feedback oscillated'),
    ([5000.0, 1000.0], HIGH, ''),
    # Told 2.5 times too high; without (TR1) the error is 1.5 rad by the trip.
    ([400.0, 100.0], {'torque_rate_limit': [1000.0, 250.0]},
     'the position error of a has grown by 1.00 rad')])
def test_drives_that_are_too_slow_trip_before_the_loop_diverges(
        rate: list[float], gains: dict[str, Any], reason: str) -> None:
    found, error = trip_of(rate, **gains)
    assert found.startswith(reason) and bool(found) == bool(reason)
    assert error <= 1.0 or not reason


@pytest.mark.slow
def test_an_elastic_arm_trips_within_two_seconds_with_joint_and_frequency() -> None:
    """The frequency is that of the largest part of the torque's spectrum."""
    motion = Sinusoid(ReferenceConfig())
    start = motion.at(0)
    law = Controller(ControllerConfig.from_mapping({
        'law': 'observer_feedback', 'ka': [60.0, 30.0], **HIGH}))
    plant = Plant(PlantConfig.from_mapping({
        'coulomb_friction': [9.9] * 2, 'joint_stiffness': [6e4, 6e3], 'joint_damping': [20.0, 2.0],
        'motor_inertia': [2.0, 0.2], 'encoder_side': 'link', 'initial_position': list(start[0]),
        'initial_velocity': list(start[1])}))
    monitor, reason = TripMonitor(['a', 'b'], MS), ''
    torques: list[Any] = []
    while not reason and len(torques) < 2000:
        sample = law.step(*plant.measured, *motion.at(len(torques) * MS))
        reason = monitor.check(law, sample)
        torques.append(sample.tau)
        plant.step(sample.tau)
    shown = re.search(r'oscillated at every bandwidth: (a|b) oscillates at (\d+) Hz', reason)
    assert shown is not None, reason
    last = np.array(torques)[-512:, 'ab'.index(shown[1])]
    spectrum = np.abs(np.fft.rfft((last - last.mean()) * np.hanning(512)))
    peak = np.fft.rfftfreq(512, 1e-3)[spectrum.argmax()]
    assert float(shown[2]) == pytest.approx(peak, rel=0.25)


def test_the_error_limit_comes_first() -> None:
    law = Controller(ControllerConfig(error_limit=(0.1, 0.1)))
    found = TripMonitor(['a', 'b'], MS).check(law, QUIET._replace(e=[0.0, 0.2]))
    assert found == 'the position error of b, 0.2 rad, exceeded error_limit'


@pytest.mark.parametrize(('e', 'limit', 'joint'), [
    (0.1, 0.1, None), (-0.1, 0.1, None), (math.nextafter(0.1, 9.0), 0.1, 1),
    (-math.nextafter(3.0, 9.0), 3.0, 1), (1e300, math.inf, None), (math.nan, math.inf, 1)])
def test_the_limit_itself_is_allowed(e: float, limit: float, joint: int | None) -> None:
    assert joint_beyond([0.0, e], [limit, limit]) == joint
    assert joint_beyond([e, e], [limit, limit]) == (None if joint is None else 0)


def along(errors: list[float], law: str = 'observer_feedback', limit: float = math.inf) -> str:
    """Return the trip at the last of these errors of joint b."""
    config = ControllerConfig(law=law, compiled=False, error_limit=(limit, limit))
    monitor, made = TripMonitor(['a', 'b'], MS), Controller(config)
    for x in errors[:-1]:
        assert monitor.check(made, QUIET._replace(e=[0.0, x])) == ''
    return monitor.check(made, QUIET._replace(e=[0.0, errors[-1]]))


def test_an_error_that_grows_trips() -> None:
    """Check both sides of (TR1), after a start 1 rad off, with an overshoot."""
    assert along([-1.0, -0.2, 0.6, -0.3, 1.21]).startswith(
        'the position error of b has grown by 1.01 rad (set error_limit to allow more than 1 rad)')
    assert along([-1.0, -0.2, 0.75, -1.19]) == ''


def test_an_error_that_grows_is_allowed_to_other_laws_and_where_a_limit_is_set() -> None:
    assert along([0.0, 2.9], 'compensation') == along([0.0, 2.9], 'chattering') == ''
    assert along([0.0, 2.9], limit=3.0) == ''


def test_growth_counts_from_the_start_of_torques_and_of_the_law() -> None:
    monitor, laws = TripMonitor(['a', 'b'], MS), [
        Controller(ControllerConfig(law=x, compiled=False)) for x in (
            'compensation', 'observer_feedback')]
    far, near = QUIET._replace(e=[2.0, 0.0]), QUIET
    assert monitor.check(laws[0], near) == monitor.check(laws[1], far) == ''
    assert monitor.check(laws[1], near) == '' != monitor.check(laws[1], far)
    monitor.restart()
    assert monitor.check(laws[1], far) == ''
