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

"""The adaptive law against its equations written out in numpy."""

from __future__ import annotations

from laws import check_by_hand, H, KP, KV, MOST, rattles, Terms
import numpy as np
from oracles import Array
import pytest


@pytest.mark.parametrize('anti_windup', [True, False])
def test_slotine_li_by_hand(anti_windup: bool) -> None:
    """Check the law in terms of dq_r and s; joints at their limit do not adapt."""
    gamma, width, slope = np.array([150.0, 40.0]), 0.3, np.linalg.inv(KV) @ KP
    level, frozen = np.array([2.0, 3.0]), 0

    def step(at: Terms) -> Array:
        nonlocal level, frozen
        dq_r, ddq_r = at.dq_d + slope @ at.e, at.ddq_d + slope @ at.de
        s, y = dq_r - at.dq, np.tanh(dq_r / width)
        damping = np.diag(1.0 / np.diag(np.linalg.inv(at.M))) @ KV
        wanted = at.M @ ddq_r + at.C @ dq_r + at.G + damping @ s + level * y
        cut = (np.abs(wanted) > MOST) & anti_windup
        frozen += int(cut.sum())
        level = np.maximum(level + np.where(cut, 0.0, H * gamma * y * s), 0.0)
        tau: Array = np.clip(wanted, -MOST, MOST)
        return tau

    check_by_hand('slotine_li', step, 1.0, adaptation_gain=gamma.tolist(), friction_velocity=width,
                  friction_level=level.tolist(), effort_limit=MOST.tolist(),
                  anti_windup=anti_windup)
    assert (frozen > 50) == anti_windup


def test_the_bound_of_the_adaptation_gain_from_both_sides() -> None:
    """The loop is stable if h Γ < K, about 0.55 · 50 N·m·s/rad."""
    assert rattles('slotine_li', {'adaptation_gain': [100.0, 1.65e4]},
                   {'adaptation_gain': [100.0, 5.5e4]}, duration=1.5)
