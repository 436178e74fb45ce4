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

"""Rest: which joints are held, what is kept there, and what it does to a joint that sticks."""

from __future__ import annotations

import math
from typing import Any

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.sample import Desired
from ctc_chattering.control.standstill import (
    design_detector,
    Standstill,
    StandstillDetector,
)
from ctc_chattering.simulation.closed_loop import run_closed_loop
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig, Trapezoid
import numpy as np
from oracles import Array
import pytest

H, BANDWIDTH, ZERO = 1e-3, 200.0, np.zeros(2)
#: Ka, M_ii, K̂.
BOUND, INERTIA, LEVEL = np.array([60.0, 30.0]), np.array([9.0, 0.62]), np.full(2, 10.0)
STILL, MOVING = Desired(ZERO, ZERO, ZERO), Standstill(ZERO, ZERO, ZERO, ZERO)


def slips(law: dict[str, Any], plant: dict[str, Any]) -> int:
    """Return how often a joint begins to slide 0.1 s after the end of a move, or later."""
    drives = {'actuator_lag': [2e-3, 2e-3], 'torque_rate_limit': [5e3, 1e3], 'compiled': False}
    motion = ReferenceConfig(profile='trapezoid', frequency=(0.6, 0.6), start_duration=0.0)
    run = run_closed_loop(
        PlantConfig.from_mapping({**drives, 'duration': 2.1, 'encoder_resolution': [1e-5] * 2,
                                  'initial_position': list(Trapezoid(motion).at(0)[0]),
                                  **plant}),
        ControllerConfig.from_mapping({
            **drives, 'law': 'observer_feedback', 'kp': [1e4] * 2, 'kv': [200.0] * 2,
            'ka': [60.0, 30.0], 'estimator_bandwidth': 200.0, **law}), motion, truth=True)
    slides = np.abs(run.dq[run.t > 1.8]) > 1e-3
    return int((slides[1:] & ~slides[:-1]).sum())


@pytest.mark.slow
def test_a_stop_with_higher_friction_at_rest_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check the end of a move on drives and encoders like real ones; without (SS1) it slips."""
    law = {'inertia_scale': 0.9, 'gravity_scale': 0.9}
    plant = {'stribeck_friction': [5.0, 5.0], 'stribeck_velocity': [1e-2, 1e-2]}
    assert slips(law, plant) == 0
    monkeypatch.setattr('ctc_chattering.control.standstill.OBSERVER_PERIODS', math.inf)
    assert slips(law, plant) > 0


def detector(rate: float = math.inf) -> StandstillDetector:
    return design_detector(BANDWIDTH, BOUND, np.full(2, rate), H)


def after(samples: int, point: Desired = STILL, q: Array = ZERO, rate: float = math.inf,
          last: Standstill = MOVING, level: Array = LEVEL) -> Standstill:
    """Return the standstill after samples at one measured position."""
    for _ in range(samples):
        tracked = detector(rate).track_position(last, q)
        last = detector(rate).detect_standstill(tracked, point, INERTIA, level)
    return last


@pytest.mark.parametrize(('rate', 'samples'), [(math.inf, (30, 30)), (1e3, (90, 60))])
def test_a_joint_is_held_when_observer_and_drives_had_the_time_to_free_it(
        rate: float, samples: tuple[int, int]) -> None:
    """Check W = 6 / ω + Ka / R, where joint and reference stand from the start."""
    for i, expected in enumerate(samples):
        assert not after(expected - 1, rate=rate).held[i]
        assert after(expected + 1, rate=rate).held[i]


def test_none_is_held_that_the_learned_friction_cannot_hold() -> None:
    """Check (SS2) with the torque that moves a joint by 2 δ within the time it stood."""
    stood, samples = 0.1, 100
    enough = 2.0 * INERTIA * 2e-4 / stood ** 2
    np.testing.assert_array_equal(after(samples + 1, level=enough).held, [1.0, 1.0])
    np.testing.assert_array_equal(
        after(samples, level=enough * np.array([0.98, 1.02])).held, [0.0, 1.0])
    assert not after(3000, level=ZERO).held.any()


def test_the_longer_slips_go_on_the_shorter_a_stop_serves() -> None:
    """Check that stops of s₁ are held after W² / s₁, and none that is shorter than 2 / ω."""
    for stop, latest in ((9, math.inf), (11, 900 / 11), (28, 900 / 28)):
        last, k = MOVING, 0
        while not last.held.any() and k < 1000:
            k += 1
            last = after(1, q=np.full(2, 1e-3 * (k // stop % 2)), last=last, level=1e2 * LEVEL)
        assert k <= latest + 2 * stop if latest < math.inf else k == 1000


def test_a_joint_that_moves_is_released_and_the_time_begins_again() -> None:
    held = after(100)
    assert after(1, q=np.array([0.9e-4, -0.9e-4]), last=held).held.all()
    moved = after(1, q=np.array([0.0, 1.1e-4]), last=held)
    np.testing.assert_array_equal(moved.held, [1.0, 0.0])
    np.testing.assert_allclose(moved.reference_time, [0.101, 0.001])
