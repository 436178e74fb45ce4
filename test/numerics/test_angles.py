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

"""Angles modulo a turn, against complex numbers and recordings of which the truth is known."""

from __future__ import annotations

import cmath
from math import nan, pi

from ctc_chattering.numerics.angles import (
    expected,
    TURN,
    turned,
    turns_to,
    unwrapped,
    unwrapped_beside,
    within_turn,
)
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

ANGLES = st.floats(-50.0, 50.0)


@given(ANGLES, ANGLES)
def test_the_nearest_representative_is_the_same_angle_within_half_a_turn(x: float, y: float
                                                                         ) -> None:
    found = turned(x, turns_to(x, y))
    assert abs(found - y) <= pi * (1.0 + 1e-12)
    assert cmath.exp(1j * found) == pytest.approx(cmath.exp(1j * x), abs=1e-12)


@given(st.floats(allow_nan=False, allow_infinity=False), st.floats())
def test_nothing_is_done_to_a_position_without_turns(x: float, y: float) -> None:
    """To the last bit; no number makes it fail."""
    turns = turns_to(x, y)
    assert turned(x, 0) is x
    assert turns == 0 or abs(y - x) > pi
    assert turns_to(x, x) == turns_to(x, nan) == 0


@given(ANGLES, st.sampled_from([-pi, 0.0, 1.7, -100.0]))
def test_a_driver_s_window(x: float, least: float) -> None:
    found = within_turn(x, least)
    assert least - 1e-12 <= found <= least + TURN + 1e-12
    assert cmath.exp(1j * found) == pytest.approx(cmath.exp(1j * x), abs=1e-12)


def test_where_velocities_lead() -> None:
    assert expected(1.0, 2.0, 4.0, 0.5) == 2.5


@pytest.mark.parametrize('least', [-pi, 0.0, -1.0])
def test_turns_of_a_recording_are_counted_again(least: float) -> None:
    """Also where samples are missing for more than half a turn, by the velocities."""
    t = np.arange(0.0, 20.0, 0.01)
    truth = np.column_stack([8.0 * np.sin(t) + 3.0 * t, 9.0 * np.cos(0.7 * t)])
    dq = np.column_stack([8.0 * np.cos(t) + 3.0, -6.3 * np.sin(0.7 * t)])
    seen = np.vectorize(within_turn)(truth, least)
    gap = (t > 5.0) & (t < 5.5)  # Over which joint 1 turns by more than half a turn.
    for kept, velocities in ((~gap, dq[~gap]), (t >= 0.0, None), (t >= 0.0, dq[:50])):
        found = unwrapped(t[kept], seen[kept], velocities, (True, False))
        assert found[:, 0] - found[0, 0] == pytest.approx(
            truth[kept, 0] - truth[0, 0], abs=1e-11)
        assert np.array_equal(found[:, 1], seen[kept, 1])
    plain = unwrapped(t, truth, dq, (True, True))
    assert plain is truth  # Nothing to do, nothing changed.


def test_after_a_gap_they_begin_again_nearest_to_the_motion() -> None:
    t = np.arange(6.0)
    q, dq = np.array([[3.0], [-3.0], [-2.9], [0.1], [0.2], [0.3]]), np.zeros((6, 1))
    target = np.array([[9.3], [9.5], [9.7], [0.0], [0.0], [0.0]])
    found = unwrapped_beside(t, q, dq, target, (True,), [3])
    assert found[:, 0] == pytest.approx(
        [3.0 + TURN, 2.0 * TURN - 3.0, 2.0 * TURN - 2.9, 0.1, 0.2, 0.3])
    assert unwrapped_beside(t, q, dq, target, (False,), [3]) is q
