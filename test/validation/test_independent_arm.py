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

"""The independent plant: smooth motion, sticking, and drives, against what is known of them."""

from __future__ import annotations

from typing import Any

from held_out_robots import nominal, PAPER
from independent_arm import Arm, go_on, Motion, motion_from
import numpy as np
from oracles import Array, paper_field
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]

pytestmark = pytest.mark.slow  # The plant takes a quarter of a minute to compile.
START, SPEED = np.array([0.7, -0.4]), np.array([1.0, -2.0])


def arm(**values: Any) -> Arm:
    """Return the two-link arm without friction, with drives that follow at once."""
    zero, one = np.zeros(2), np.ones(2)
    return Arm(nominal('two_link')[0], PAPER, zero, zero, zero, one, zero, zero, np.inf * one,
               1e4 * one, zero, np.zeros(2), np.zeros((0, 2)))._replace(**values)


def after(plant: Arm, tau: Array, speed: Array = SPEED, seconds: float = 0.2) -> Motion:
    """Return what becomes of the start under a constant torque."""
    now = motion_from(START, speed, 0)
    go_on(plant, now, tau, round(seconds / 1e-5), 1e-5)
    return now


def test_smooth_motion_is_that_of_the_paper() -> None:
    tau = np.array([20.0, -5.0])
    found = solve_ivp(paper_field(tau.tolist()), (0.0, 0.2), [*START, *SPEED], rtol=1e-10,
                      atol=1e-12)
    now = motion_from(START, SPEED, 0)
    now.torque[:] = tau
    go_on(arm(), now, tau, 20_000, 1e-5)
    np.testing.assert_allclose([*now.q, *now.dq], found.y[:, -1], atol=1e-8)


@pytest.mark.parametrize(('part', 'moves'), [(0.99, False), (1.01, True)])
def test_a_joint_sticks_up_to_its_friction(part: float, moves: bool) -> None:
    level = np.array([9.0, 4.0])
    weight = np.array([PAPER[6] * (PAPER[4] * np.sin(START[0]) + PAPER[5] * np.sin(START.sum())),
                       PAPER[6] * PAPER[5] * np.sin(START.sum())])
    held = arm(lag=np.full(2, 5e-3), coulomb=level + 100.0)
    now = after(held, weight + part * level, np.zeros(2))  # The drives get there first.
    go_on(held._replace(coulomb=level), now, weight + part * level, 10_000, 1e-5)
    assert (np.abs(now.dq) > 0.0).all() == moves
