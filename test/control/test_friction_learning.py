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

"""The learned level of friction, from an observer with errors of a known level."""

import math

from ctc_chattering.control.friction_learning import design_learner, LearnedFriction
import numpy as np
import pytest

H, BANDWIDTH, BOUND = 1e-3, 100.0, np.array([30.0, 30.0])


@pytest.mark.parametrize('start', [[0.0, 0.0], [14.0, 1.0]])
def test_the_level_is_found(start: list[float]) -> None:
    """Check K̂ after 8 s of a sinusoid of 1 Hz, from what an observer has of the rest of it."""
    true, lags = np.array([9.9, 2.0]), [np.zeros(2)] * 3
    learner = design_learner(20.0, BANDWIDTH, H, BOUND)
    memory = LearnedFriction(
        np.array(start), *[np.zeros(2)] * 5)
    for k in range(8000):
        dq = np.full(2, math.pi * math.cos(2.0 * math.pi * k * H))
        x = (true - memory.level) * np.sign(dq)
        for i in range(3):
            lags[i] = x = lags[i] + (1.0 - math.exp(-BANDWIDTH * H)) * (x - lags[i])
        memory = learner.learn(memory, dq, x)
    np.testing.assert_allclose(memory.level, true, rtol=0.02)


def test_the_level_is_bounded() -> None:
    learner = design_learner(20.0, BANDWIDTH, H, np.array([3.0, 3.0]))
    memory = LearnedFriction(np.array([1.0, 1.0]), *[np.zeros(2)] * 5)
    for k in range(4000):
        sign = 1.0 if k // 500 % 2 else -1.0
        memory = learner.learn(memory, np.full(2, sign), sign * np.array([50.0, -50.0]))
        assert (memory.level >= 0.0).all()
        assert (memory.level <= 3.0).all()
    np.testing.assert_allclose(memory.level, [3.0, 0.0])
