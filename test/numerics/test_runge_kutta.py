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

"""The integrator's step against closed forms."""

from __future__ import annotations

import math

from ctc_chattering.numerics.integration import runge_kutta
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest


def swing(squares: Array, q: Array, _dq: Array, u: Array) -> Array:
    """Two oscillators."""
    return u - squares * q


def test_oscillators_to_fourth_order() -> None:
    errors = []
    for n in (50, 100):
        q, dq, no = np.array((1.0, 0.0)), np.array((0.0, 3.0)), np.zeros(2)
        for _ in range(n):
            q, dq = runge_kutta(swing, np.array((4.0, 9.0)), q, dq, (no,) * 3, 1.0 / n)
        errors.append(max(abs(q[0] - math.cos(2.0)), abs(q[1] - math.sin(3.0)),
                          abs(dq[0] + 2.0 * math.sin(2.0)), abs(dq[1] - 3.0 * math.cos(3.0))))
    assert errors[1] < 1e-6
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.1)


def test_a_load_that_changes_is_integrated_by_simpson_s_rule() -> None:
    """With ddq = u(t) alone, dq is exact for cubic u."""
    def free(_: None, _q: Array, _dq: Array, u: Array) -> Array:
        return u

    h = 0.7
    first, middle, last = (np.array((s ** 3, 1.0 - s ** 2)) for s in (0.0, 0.5 * h, h))
    _, dq = runge_kutta(free, None, np.zeros(2), np.zeros(2), (first, middle, last), h)
    assert dq == pytest.approx((h ** 4 / 4.0, h - h ** 3 / 3.0), rel=1e-14)
