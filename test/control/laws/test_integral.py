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

"""The integral against its equations written out in numpy."""

from __future__ import annotations

from typing import Any

from laws import check_by_hand, check_windup, error, H, KP, MOST, run, Terms
import numpy as np
from oracles import Array
import pytest


@pytest.mark.parametrize('anti_windup', [True, False])
def test_integral_by_hand(anti_windup: bool) -> None:
    """Check that x tracks M⁻¹ times what is cut off, within the integral time Kp / Ki."""
    x, cuts, ki = np.zeros(2), 0, np.array([300.0, 900.0])

    def step(at: Terms) -> Array:
        nonlocal x, cuts
        wanted = at.computed_torque + at.M @ x
        tau: Array = np.clip(wanted, -MOST, MOST)
        cuts += int((wanted != tau).any())
        x = x + H * ki * at.e
        if anti_windup:
            part = 1.0 - np.exp(-H * ki / np.diag(KP))
            x = x - part * np.linalg.solve(at.M, wanted - tau)
        return tau

    check_by_hand('integral', step, ki=ki.tolist(), effort_limit=MOST.tolist(),
                  anti_windup=anti_windup)
    assert cuts > 100


def test_the_error_under_friction_shrinks() -> None:
    gains: dict[str, Any] = {'kv': 300.0, 'kp': 3e4}
    found = error(run('integral', 2.0, ki=1e6, **gains))
    assert (found < 0.6 * error(run('integral', 2.0, ki=0.0, **gains))).all()


def test_it_does_not_wind_up() -> None:
    check_windup('integral')
