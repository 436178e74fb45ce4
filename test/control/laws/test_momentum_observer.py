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

"""The momentum observer against its equations written out in numpy."""

from __future__ import annotations

import math

from laws import check_by_hand, error, H, MOST, rattles, run, Terms
import numpy as np
from oracles import Array


def test_momentum_observer_by_hand() -> None:
    """
    Check the residual of the momentum, filtered, in the torque; C enters transposed.

    It is that of the torque that was sent, so that a limit does not wind the estimate up.
    """
    gain, estimate, before, cuts = 150.0, np.zeros(2), None, 0

    def step(at: Terms) -> Array:
        nonlocal estimate, before, cuts
        p, beta = at.M @ at.dq, at.C.T @ at.dq - at.G
        if before is not None:
            found = before[2] + (before[1] + beta) / 2.0 - (p - before[0]) / H
            estimate = estimate + (1.0 - math.exp(-gain * H)) * (found - estimate)
        wanted = at.computed_torque + estimate
        tau: Array = np.clip(wanted, -10.0 * MOST, 10.0 * MOST)
        cuts += int((wanted != tau).any())
        before = p, beta, tau
        return tau

    check_by_hand('momentum_observer', step, momentum_gain=gain,
                  effort_limit=(10.0 * MOST).tolist())
    assert 20 < cuts < 180


def test_the_bound_of_the_inertia_from_both_sides() -> None:
    """With this gain it is 2.1."""
    assert rattles('momentum_observer', {'inertia_scale': 1.9}, {'inertia_scale': 2.3},
                   duration=1.5, momentum_gain=3000.0)


def test_the_error_under_friction_shrinks_with_the_gain() -> None:
    slow = error(run('momentum_observer', 2.0, momentum_gain=50.0))
    fast = error(run('momentum_observer', 2.0, momentum_gain=300.0))
    assert (slow < 0.5 * error(run('compensation', 2.0))).all()
    assert (fast < 0.5 * slow).all()
