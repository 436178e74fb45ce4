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

"""The recommended poles are damped even where nothing makes up for the lag or the delay."""

from __future__ import annotations

from ctc_chattering.control.recommended_gains import (
    estimator_bandwidth,
    largest_pole,
    lateness,
    POLE,
)
import numpy as np
import pytest


def damping(roots: np.ndarray) -> float:
    """Return the least damping ratio of continuous poles."""
    return float((-roots.real / np.abs(roots)).min())


def behind_a_lag(p: float, lag: float) -> float:
    """Return the least damping of e'' = -(2 p e' + p² e) behind a lag, by its polynomial."""
    return damping(np.roots([lag, 1.0, 2.0 * p, p * p]))


def behind_samples(p: float, h: float, delay: int) -> float:
    """Return the same for a sampled loop whose input is held and comes `delay` samples late."""
    n = 2 + delay
    step = np.zeros((n, n))
    step[:2, :2] = [[1.0, h], [0.0, 1.0]]
    feedback = np.array([-p * p, -2.0 * p, *[0.0] * delay])
    push = np.array([0.5 * h * h, h])
    if delay:
        step[:2, 2] = push
        step[2:-1, 3:] = np.eye(delay - 1)
        step[-1] = feedback
    else:
        step[:2] += np.outer(push, feedback)
    roots = np.linalg.eigvals(step)
    return damping(np.log(roots[np.abs(roots) > 1e-9].astype(complex)) / h)


@pytest.mark.parametrize('lag', [1e-4, 2e-3, 1e-2, 0.1])
def test_the_pole_is_damped_behind_a_lag(lag: float) -> None:
    p = largest_pole(lateness(lag, 0.0, -1))
    assert p <= POLE
    assert behind_a_lag(p, lag) > 0.45
    assert behind_a_lag(2.5 / lag, lag) < 0.0


@pytest.mark.parametrize('delay', [0, 1, 3, 8])
def test_the_pole_is_damped_behind_samples_of_delay(delay: int) -> None:
    h = 5e-3
    p = largest_pole(lateness(0.0, h, delay))
    assert behind_samples(p, h, delay) > 0.1
    assert behind_samples(3.0 * p, h, delay) < 0.0


def test_the_observer_is_faster_where_positions_are_fine() -> None:
    assert estimator_bandwidth(100.0, 1e-5) == 200.0
    assert estimator_bandwidth(100.0, 1e-4) == 100.0
