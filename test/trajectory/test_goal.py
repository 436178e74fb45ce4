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

"""A goal ends by the rules of joint_trajectory_controller."""

from __future__ import annotations

from math import inf, nan

from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.time_grid import NANOSECONDS as S
from ctc_chattering.trajectory.goal import (
    ERASE,
    Goal,
    GoalCode,
    GoalTolerances,
    JointTolerance,
)
import pytest

GOAL = Goal(('a', 'b'), 10 * S, GoalTolerances(
    (JointTolerance(0.1), JointTolerance(0.2, 3.0)),
    (JointTolerance(0.01, 0.1), JointTolerance(0.02)), 2.0))
REST = (0.0, 0.0)


@pytest.mark.parametrize(('s', 'e', 'de', 'code'), [
    (9, (0.1, 0.2), (9.0, 3.0), None),
    (9, (0.11, 0.0), REST, GoalCode.PATH_TOLERANCE_VIOLATED),
    (9, (0.0, -0.21), REST, GoalCode.PATH_TOLERANCE_VIOLATED),
    (9, (0.0, 0.0), (0.0, 3.1), GoalCode.PATH_TOLERANCE_VIOLATED),
    (9, (nan, 0.0), REST, GoalCode.PATH_TOLERANCE_VIOLATED),
    (10, (0.01, -0.02), (0.1, 9.0), GoalCode.SUCCESSFUL),
    (10, (0.011, 0.0), REST, None),
    (12, (0.0, 0.021), REST, None),
    (12.1, (0.0, 0.021), REST, GoalCode.GOAL_TOLERANCE_VIOLATED),
    (12.1, REST, (0.11, 0.0), GoalCode.GOAL_TOLERANCE_VIOLATED),
    (99, REST, REST, GoalCode.SUCCESSFUL)])
def test_a_goal_ends_at_its_tolerances(
        s: float, e: tuple[float, float], de: tuple[float, float], code: GoalCode | None) -> None:
    verdict = GOAL.judge(round(s * S), e, de)
    assert (verdict and verdict.code) == code


def test_a_violation_names_joint_amount_and_limit() -> None:
    verdict = GOAL.judge(9 * S, (0.5, 0.3), REST)
    assert verdict is not None
    assert verdict.text == ('The motion left its path: a: position error 0.5, allowed 0.1; '
                            'b: position error 0.3, allowed 0.2.')


def test_without_tolerances_a_goal_ends_with_its_motion() -> None:
    n = JointTolerance()
    goal = Goal(('a',), S, GoalTolerances((n,), (n,)))
    assert goal.judge(S - 1, (1e9,), (1e9,)) is None
    verdict = goal.judge(S, (1e9,), (1e9,))
    assert verdict is not None and verdict.code is GoalCode.SUCCESSFUL


def test_a_goal_keeps_replaces_or_erases_a_default_tolerance() -> None:
    default = JointTolerance(0.1, 0.2)
    assert default.replaced(0.0, 0.0) == default
    assert default.replaced(0.3, ERASE) == (0.3, inf)
    for wrong in (-0.5, nan):
        with pytest.raises(ParameterError, match='position tolerance'):
            default.replaced(wrong, 0.0)
