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

"""An arm that a hand leads: it floats, comes to rest by itself, and stays off its limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.hand_guiding import HandGuiding
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest

MS = 1_000_000
ZERO = (0.0, 0.0)
FRICTION = {'friction_level': [9.0, 9.0]}


def guided(lasts: float, q: Sequence[float], dq: Sequence[float] = ZERO,
           push: Sequence[float] = ZERO, friction: float = 0.0, gravity_error: float = 1.0,
           limits: Sequence[tuple[float, float]] = (),
           config: Mapping[str, object] | None = None) -> Array:
    """Return times, positions, velocities and torques of an arm with Coulomb friction."""
    arm = TwoLink(9.81)
    known = TwoLink(9.81 * gravity_error)
    known.position_limits = limits
    guiding = HandGuiding(ControllerConfig().changed(config or {}), known, MS)
    state, tau, rows = np.array([q, dq], float), list(arm.gravity_torque(q)), []
    for k in range(round(lasts * 1000)):
        tau = guiding.torque(known, state[0].tolist(), state[1].tolist(), tau)
        rows.append([np.full(2, 1e-3 * k), *state, tau])
        for _ in range(5):  # Friction that holds below its level, by a steep viscous part.
            resisting = friction * np.clip(state[1] / 1e-4, -1.0, 1.0)
            h = 2e-4
            M, bias = arm.mass_and_bias(*state)
            slope = np.diag((np.abs(state[1]) < 1e-4) * friction / 1e-4)
            state[1] += h * np.linalg.solve(M + h * slope, tau + np.array(push) - bias - resisting)
            state[0] += h * state[1]
    result: Array = np.array(rows).transpose(1, 0, 2)
    return result


def test_an_arm_without_friction_floats_where_it_is_left() -> None:
    _, q, dq, _ = guided(1.0, (0.4, 0.9))
    assert np.abs(q - (0.4, 0.9)).max() < 1e-9
    assert np.abs(dq).max() < 1e-9


def test_a_push_moves_the_arm_and_it_comes_to_rest_by_itself() -> None:
    _, pushed, _, _ = guided(
        1.0, (0.4, 0.9), push=(30.0, 0.0), friction=9.0, config=FRICTION)
    assert pushed[-1, 0] > 0.5
    _, _, dq, _ = guided(3.0, (0.4, 0.9), (0.8, 0.5), friction=9.0, config=FRICTION)
    assert np.abs(dq[-1]).max() < 1e-3
    assert np.abs(dq[:, 0]).max() <= 0.81


def test_friction_that_is_left_holds_an_arm_of_wrong_weight() -> None:
    """With all of the friction compensated it would sink."""
    _, q, _, _ = guided(2.0, (0.4, 0.9), friction=9.0, gravity_error=0.995, config=FRICTION)
    assert np.abs(q[-1] - (0.4, 0.9)).max() < 1e-3
    wrong = TwoLink(9.81).gravity_torque((0.4, 0.9))
    assert 0.1 < abs(0.005 * wrong[0]) < 0.3 * 9.0


def test_a_wall_stops_the_arm_before_its_limit_and_a_hand_may_lead_it_out() -> None:
    limits = ((-1.0, 1.0), (-2.0, 2.0))
    _, q, _, _ = guided(3.0, (0.5, 0.5), (1.2, 0.0), limits=limits)
    assert 0.9 < q[:, 0].max() < 1.0
    _, free, _, _ = guided(3.0, (0.5, 0.5), (1.2, 0.0))
    assert free[:, 0].max() > 1.0


def test_a_fast_arm_is_damped_more_strongly() -> None:
    _, _, slow, _ = guided(0.2, (0.4, 0.9), (0.9, 0.0))
    _, _, fast, _ = guided(0.2, (0.4, 0.9), (3.0, 0.0))
    assert slow[-1, 0] / slow[0, 0] > 0.75
    assert fast[-1, 0] < 1.6


@pytest.mark.parametrize('name', ['effort_limit', 'effort_rate_limit'])
def test_the_torque_keeps_the_limits_of_the_drives(name: str) -> None:
    limit = [100.0, 20.0]
    _, _, _, tau = guided(0.5, (0.4, 0.9), (3.0, 0.0), config={name: limit})
    if name == 'effort_limit':
        assert (np.abs(tau).max(axis=0) <= limit).all()
        assert np.abs(tau[:, 0]).max() == 100.0
    else:
        steps = np.abs(np.diff(tau, axis=0)).max(axis=0)
        assert steps == pytest.approx([1e-3 * x for x in limit])


def test_an_arm_enters_a_wall_without_a_step_of_its_torque() -> None:
    """Also at a limit that counts for no joint that turns endlessly."""
    limits = ((-1.0, 1.0), (-2.0, 2.0))
    arm = TwoLink(9.81)
    arm.position_limits = limits
    guiding = HandGuiding(ControllerConfig(), arm, MS)
    before, after = (
        guiding.torque(arm, (q, 0.5), (1.0, 0.0), ZERO)[0] for q in (0.8999, 0.9001))
    assert after == pytest.approx(before, abs=2.0)
    endless = HandGuiding(ControllerConfig().changed({'continuous_joints': ['joint1']}), arm, MS)
    q = 7.0, 0.5
    assert endless.torque(arm, q, ZERO, ZERO) == pytest.approx(arm.gravity_torque(q))
