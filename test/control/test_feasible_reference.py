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

"""The reference that drives can follow, against its equations and a simulated joint."""

import math

from ctc_chattering.control.adaptation import (
    Desired,
    Deviation,
    feasible_reference,
    FeasibleReference,
    OVERSHOOT,
    ramp,
)
import numpy as np
from oracles import Array
import pytest

H, LAG = 1e-3, np.array([2e-3, 0.0])
INERTIA, LEVEL, RATE = np.array([9.0, 0.62]), np.array([9.9, 9.9]), np.array([5e3, 1e3])


def reference(kp: float = 1e4, rate: Array = RATE) -> FeasibleReference:
    return feasible_reference(np.full(2, kp), np.full(2, 2.0 * math.sqrt(kp)), rate, LAG, H)


def following(made: FeasibleReference, at: Desired, by: Deviation, level: Array) -> Deviation:
    back = made.returning(by, INERTIA, level)
    return made.following(at, by, back, INERTIA, level)


def sinusoid(t: float, amplitude: float = 0.5, w: float = 2.0 * math.pi) -> Desired:
    s, c = amplitude * math.sin(w * t), amplitude * math.cos(w * t)
    return Desired(np.full(2, s), np.full(2, w * c), np.full(2, -w * w * s))


def test_the_overshoot_makes_the_first_moment_of_the_ramp_vanish() -> None:
    """Check ∫ s (φ - sgn) ds by quadrature, and that φ is continuous and odd."""
    s = np.linspace(-3.0, 3.0, 600001)
    moment = np.trapezoid(s * (ramp(s) - np.sign(s)), s)
    assert abs(moment) < 0.01
    assert np.abs(np.diff(ramp(s))).max() < 2e-5
    np.testing.assert_allclose(ramp(-s), -ramp(s))
    np.testing.assert_allclose(ramp(np.array([0.5, 1.0 + OVERSHOOT, 9.0])),
                               [0.5, 1.0 + OVERSHOOT, 1.0])


def test_the_friction_of_the_reference_is_a_ramp_before_the_reversal() -> None:
    """Check the slope R at the reversal, the lead of 0.67 T, and ±K̂ elsewhere."""
    made, T = reference(), LEVEL / RATE
    for i in (0, 1):
        zero = 0.25 - 0.67 * T[i]
        values = [made.feedforward(sinusoid(zero + x * T[i]), LEVEL)[i] for x in (-0.5, 0.0, 0.5)]
        np.testing.assert_allclose(values, [4.95, 0.0, -4.95], atol=0.05)
    np.testing.assert_array_equal(made.feedforward(sinusoid(0.1), LEVEL), LEVEL)
    np.testing.assert_array_equal(made.feedforward(sinusoid(0.5), LEVEL), -LEVEL)
    rest = Desired(np.ones(2), np.zeros(2), np.zeros(2))
    np.testing.assert_array_equal(made.feedforward(rest, LEVEL), 0.0)


def test_drives_without_a_limit_need_no_deviation() -> None:
    made, by = reference(rate=np.full(2, math.inf)), Deviation(np.zeros(2), np.zeros(2))
    with np.errstate(all='ignore'):
        for k in range(1000):
            by = following(made, sinusoid(k * H), by, LEVEL)
            assert np.abs(by.x).max() < 2e-5


def test_the_deviation_is_small_and_comes_back() -> None:
    """Check one reversal of joint 2: within K̂ T² / M times 0.4, and 0 before the next one."""
    made, by = reference(), Deviation(np.zeros(2), np.zeros(2))
    xs = []
    for k in range(100, 700):
        by = following(made, sinusoid(k * H), by, LEVEL)
        xs.append(by.x)
    unit = LEVEL * (LEVEL / RATE) ** 2 / INERTIA
    largest = np.abs(xs).max(axis=0)
    assert 0.05 * unit[1] < largest[1] < 0.4 * unit[1]
    assert largest[0] < 1e-5
    assert np.abs(xs[350][1]) < 0.02 * unit[1]


def test_the_torque_of_the_deviation_has_the_rate_of_the_drives() -> None:
    """Check that M_ii ddx + f, which is what the drives must add, changes by about R."""
    made, by, load = reference(), Deviation(np.zeros(2), np.zeros(2)), []
    for k in range(100, 500):
        before = by
        by = following(made, sinusoid(k * H), by, LEVEL)
        load.append(made.feedforward(sinusoid(k * H), LEVEL))
        assert np.isfinite(before.x).all()
    assert (np.abs(np.diff(load, axis=0)).max(axis=0) / H < 1.1 * RATE).all()


@pytest.mark.parametrize('distance', [0.01, 3.0])
def test_the_way_back_is_smooth_from_anywhere(distance: float) -> None:
    """Check that it ends at 0 without an overshoot of a tenth, with the jerk that R allows."""
    made, none = reference(), np.zeros(2)
    rest = Desired(none, none, none)
    by, xs, accelerations = Deviation(np.full(2, distance), none), [], []
    for _ in range(4000):
        accelerations.append(made.returning(by, INERTIA, none))
        by = following(made, rest, by, none)
        xs.append(by.x)
    assert np.abs(xs[-1]).max() < 1e-6
    assert np.min(xs) > -0.1 * distance
    jerk = np.abs(np.diff(accelerations, axis=0)).max(axis=0) / H
    assert (jerk < 2.0 * RATE / INERTIA).all()


def test_friction_does_not_keep_a_deviation_where_the_reference_stands() -> None:
    made, none = reference(), np.zeros(2)
    by = Deviation(np.full(2, 1e-3), none)
    for _ in range(300):
        by = following(made, Desired(none, none, none), by, LEVEL)
    assert np.abs(by.x).max() < 1e-6


def test_what_the_drives_miss_by_far_moves_the_reference() -> None:
    """Check dx -= M⁻¹ rest / (Kv + T_a Kp) for what exceeds 10 ms R, and nothing below."""
    made, by = reference(), Deviation(np.zeros(2), np.zeros(2))
    mass = np.array([[9.0, 0.8], [0.8, 0.62]])
    assert made.relieved(by, np.array([49.0, -9.9]), mass) is by
    moved = made.relieved(by, np.array([60.0, -15.0]), mass)
    np.testing.assert_allclose(mass @ (moved.dx * [-220.0, -200.0]), [10.0, -5.0])
    np.testing.assert_array_equal(moved.x, 0.0)
