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

"""States that come early, late or never, against states in time."""

from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig, Sample
from ctc_chattering.control.irregular_sample import locate_sample, MAX_MISSED_PERIODS
import numpy as np
from oracles import Masses
import pytest

MASS, MS = np.array([[2.0, 0.7], [0.7, 0.5]]), 1_000_000


@pytest.mark.parametrize('law', ['chattering', 'momentum_observer'])
def test_irregular_states_change_nothing_where_the_model_is_right(law: str) -> None:
    """
    Check every torque against those of states in time, on masses that only the law moves.

    Of four states one was measured 0.3 ms early, one comes late by two periods, and two never;
    meanwhile the law answers what it predicts.
    """
    slope, a = np.array([9.0, -7.0]), np.zeros(2)
    config = ControllerConfig(law=law, switching='implicit_observer')
    prompt, other = (Controller(config, Masses(MASS.tolist())) for _ in range(2))
    states: list[tuple[Any, Any]] = [(np.array([0.1, -0.2]), np.array([0.3, 0.4]))]
    goals: list[tuple[Any, Any, Any]] = []
    for k in range(41):
        (q, dq), t, early = states[k], 1e-3 * k, 3e-4 * (k > 0)
        goals.append((0.5 * slope * t * t, slope * t, slope))
        right = prompt.step(q, dq, *goals[k], t=k * MS)
        if k % 4 == 0:
            found: Sample | None = other.step(
                q - early * dq + 0.5 * early ** 2 * a, dq - early * a, *goals[k],
                t=k * MS - round(1e9 * early), at=k * MS)
        elif k % 4 == 3:
            found = other.step(*states[k - 2], *goals[k - 2], t=(k - 2) * MS, late=2)
        else:
            found = other.predicted_step(*goals[k])
        assert found is not None
        np.testing.assert_allclose(found.tau, right.tau, rtol=0.0, atol=1e-9)
        a = np.linalg.solve(MASS, np.array(right.tau))
        states.append((q + 1e-3 * dq + 0.5e-6 * a, dq + 1e-3 * a))


@pytest.mark.parametrize(('offset', 'elapsed', 'missed', 'after'), [
    (0, MS, 0, 0), (0, MS + 9, 0, 9), (9, MS, 0, 9), (0, 3 * MS - 9, 2, -9),
    (0, MS * 3 // 2 - 1, 0, MS * 9 // 20), (0, MS * 3 // 2, 1, -MS * 9 // 20),
    (0, 1, 0, -MS * 9 // 20),
    (0, (MAX_MISSED_PERIODS + 1) * MS, MAX_MISSED_PERIODS, 0),
    (0, (MAX_MISSED_PERIODS + 2) * MS, 0, 0), (0, -1, 0, 0)])
def test_a_stamp_belongs_to_the_nearest_sample(
        offset: int, elapsed: int, missed: int, after: int) -> None:
    assert locate_sample(MS, offset, elapsed) == (missed, after)
