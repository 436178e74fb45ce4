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

"""Learning the level of friction, on estimates made by three lags written out."""

import math

from ctc_chattering.control.adaptation import friction_level, untaught
import numpy as np
from oracles import Array
import pytest

H, BANDWIDTH, BOUND = 1e-3, 100.0, np.array([30.0, 30.0])


def learned(true: Array, start: Array, duration: float = 8.0, viscous: float = 0.0,
            gravity: float = 0.0, motion: float = 0.5, gain: float = 20.0) -> Array:
    """Return K̂ after a sinusoid of 1 Hz with the friction `true`, and disturbances beside it."""
    made, memory, lags = (
        friction_level(gain, BANDWIDTH, H, BOUND), untaught(start), [np.zeros(2)] * 3)
    follow = 1.0 - math.exp(-BANDWIDTH * H)
    for k in range(round(duration / H)):
        angle = 2.0 * math.pi * k * H
        dq = 2.0 * math.pi * motion * math.cos(angle) * np.ones(2)
        x = (true - memory.level) * np.sign(dq) + viscous * dq + gravity * math.sin(angle)
        for i in range(3):
            lags[i] = lags[i] + follow * (x - lags[i])
            x = lags[i]
        memory = made.learn(memory, dq, x)
    return memory.level


@pytest.mark.parametrize('start', [[0.0, 0.0], [14.0, 1.0]])
def test_the_level_is_found(start: list[float]) -> None:
    true = np.array([9.9, 2.0])
    np.testing.assert_allclose(learned(true, np.array(start)), true, rtol=0.02)


def test_errors_of_the_model_and_viscous_friction_hardly_matter() -> None:
    true = np.array([9.9, 5.0])
    np.testing.assert_allclose(learned(true, np.zeros(2), viscous=0.5, gravity=20.0), true,
                               rtol=0.12)


def test_without_friction_or_motion_or_gain_nothing_is_learned() -> None:
    np.testing.assert_allclose(learned(np.zeros(2), np.zeros(2)), 0.0, atol=1e-9)
    np.testing.assert_array_equal(learned(np.array([9.0, 9.0]), np.ones(2), motion=0.0), 1.0)
    np.testing.assert_array_equal(learned(np.array([9.0, 9.0]), np.ones(2), gain=0.0), 1.0)


def test_the_level_is_bounded() -> None:
    made = friction_level(20.0, BANDWIDTH, H, np.array([3.0, 3.0]))
    memory = untaught(np.array([1.0, 1.0]))
    for k in range(4000):
        sign = 1.0 if k // 500 % 2 else -1.0
        memory = made.learn(memory, np.full(2, sign), sign * np.array([50.0, -50.0]))
        assert (memory.level >= 0.0).all()
        assert (memory.level <= 3.0).all()
    np.testing.assert_allclose(memory.level, [3.0, 0.0])
