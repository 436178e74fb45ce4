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

"""The feasible reference: its ramp, its feedforward and its deviation."""

import math

from ctc_chattering.control.feasible_reference import (
    design_reference,
    Desired,
    Deviation,
    next_point,
    OVERSHOOT,
    ramp,
)
import numpy as np
import pytest
from scipy.integrate import quad  # type: ignore[import-untyped]

H, ONE, ZERO = 1e-3, np.ones(1), np.zeros(1)
LEVEL, RATE, INERTIA = np.array([5.0]), np.array([500.0]), np.array([2.0])
REFERENCE = design_reference(1e4 * ONE, 200.0 * ONE, RATE, 2e-3 * ONE, H)


def test_the_ramp_leaves_no_first_moment() -> None:
    """Check the equation for β, by the integral of s (φ - sgn s)."""
    moment, _ = quad(lambda s: s * (float(ramp(np.array([s]))[0]) - math.copysign(1.0, s)),
                     0.0, 1.0 + 2.0 * OVERSHOOT, points=[1.0, 1.0 + OVERSHOOT])
    assert moment == pytest.approx(0.0, abs=2e-3)


def test_the_feedforward_changes_at_the_rate_of_the_drives() -> None:
    """Check F through a reversal at dq_d = -1 t, t from -50 to 50 ms."""
    t = np.linspace(-0.05, 0.05, 1001)
    F = np.array([REFERENCE.feed_forward(Desired(ZERO, -x * ONE, -ONE), LEVEL)[0] for x in t])
    assert F[0] == LEVEL[0]
    assert F[-1] == -LEVEL[0]
    assert np.abs(np.diff(F)).max() == pytest.approx(RATE[0] * (t[1] - t[0]), rel=1e-6)
    assert np.abs(F).max() == pytest.approx((1.0 + OVERSHOOT) * LEVEL[0], rel=2e-2)


@pytest.mark.parametrize('start', [1e-4, 3.0])
def test_a_deviation_returns_to_0(start: float) -> None:
    """From near and far, without overshoot, where the reference stands."""
    point, deviation, largest = Desired(ZERO, ZERO, ZERO), Deviation(start * ONE, ZERO), 0.0
    for _ in range(8000):
        recovery = REFERENCE.compute_recovery(deviation, INERTIA, LEVEL)
        deviation = REFERENCE.advance(point, deviation, recovery, INERTIA, LEVEL)
        assert deviation.x[0] > -0.05 * start
        largest = max(largest, abs(deviation.dx[0]))
    assert abs(deviation.x[0]) < 1e-6 * start
    assert largest > 0.5 * start


def test_a_small_shortfall_moves_nothing_and_a_large_one_the_velocity() -> None:
    mass, deviation = np.diag(INERTIA), Deviation(ZERO, ZERO)
    slack = 10e-3 * RATE
    assert REFERENCE.relieve(deviation, slack, mass) is deviation
    relieved = REFERENCE.relieve(deviation, slack + 4.0, mass)
    assert relieved.dx == pytest.approx(-4.0 / 2.0 / (200.0 + 2e-3 * 1e4))


def test_the_next_point_is_that_of_a_cubic() -> None:
    """Check q = t³ with the step of its acceleration, 6 h, at t = 1."""
    after = next_point(Desired(ONE, 3.0 * ONE, 6.0 * ONE), 6.0 * H * ONE, H)
    t = 1.0 + H
    np.testing.assert_allclose(np.concatenate(after), [t ** 3, 3.0 * t ** 2, 6.0 * t], rtol=1e-14)
