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
"""Windows of a motion: terms, rest, and how much memory they take."""

from __future__ import annotations

import tracemalloc

from ctc_chattering.dynamics.registry import make_model
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.identification.regressor import BodyRegressor
from ctc_chattering.identification.stretches import Stretch
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import join_windows, STRIBECK_VELOCITIES, Windows
import numpy as np
import pytest
from urdfs import TWO_LINKS, two_links

H = 1e-3
PHI = TestFunction(H)


def stretch(*positions: np.ndarray) -> Stretch:
    return Stretch(0.0, H, np.stack(positions, axis=1), None, None)


def test_a_joint_slides_rests_or_reverses() -> None:
    """The mean direction of a window with a reversal is between -1 and 1."""
    t = H * np.arange(4000)
    still = np.full_like(t, 0.123456789)
    flicker = 0.5 + 1e-5 * np.random.default_rng(0).integers(0, 2, len(t))
    found = Windows.of(stretch(np.sin(t), still + flicker), TwoLink(), PHI, None)
    away = np.abs(found.t - 0.5 * np.pi) > PHI.half * H + 0.02
    assert found.direction[away, 0] == pytest.approx(np.sign(np.cos(found.t[away])))
    assert (np.abs(found.direction[~away, 0]) < 1.0).any()
    assert found.resting[:, 1].min() > 0.9
    assert not found.bodies.size


def test_means_are_those_of_the_motion() -> None:
    t = H * np.arange(3000)
    q = np.stack((0.6 * np.sin(2.0 * t), 0.4 * np.cos(3.0 * t)), axis=1)
    found = Windows.of(stretch(*q.T), TwoLink(), PHI, None)
    dq = np.stack((1.2 * np.cos(2.0 * t), -1.2 * np.sin(3.0 * t)), axis=1)
    assert found.velocity == pytest.approx(PHI.sums(dq, PHI.values, found.centres), abs=1e-5)
    assert found.acceleration == pytest.approx(
        PHI.sums(np.gradient(dq, H, axis=0), PHI.values, found.centres), abs=1e-3)
    k = 10
    slow = np.sign(dq) * np.exp(-np.square(dq / STRIBECK_VELOCITIES[k]))
    sliding = np.abs(found.direction).min(axis=1) > 1.0 - 1e-9
    assert found.stribeck[sliding, :, k] == pytest.approx(
        PHI.sums(slow, PHI.values, found.centres)[sliding], abs=1e-5)
    # Where the torque keeps its sign.
    loaded = sliding[:, None] & (np.abs(found.model_torque) > 2.0)
    assert np.abs(found.load)[loaded] == pytest.approx(
        np.abs(found.model_torque)[loaded], abs=0.1)


@pytest.mark.parametrize('place', [2.4, 10.6])
def test_a_stribeck_column_between_two_velocities(place: float) -> None:
    t = H * np.arange(6000)
    found = Windows.of(stretch(0.05 * np.sin(t), 0.4 * np.cos(0.3 * t)), TwoLink(), PHI, None)
    velocity = STRIBECK_VELOCITIES[0] * (
        STRIBECK_VELOCITIES[1] / STRIBECK_VELOCITIES[0]) ** place
    dq = 0.05 * np.cos(t)
    exact = np.sign(dq) * np.exp(-np.square(dq / velocity))
    sliding = np.abs(found.direction[:, 0]) > 1.0 - 1e-9
    assert found.stribeck_column(0, place)[sliding] == pytest.approx(
        PHI.sums(exact[:, None], PHI.values, found.centres)[sliding, 0], abs=1e-3)


def test_gravity_along_another_direction_is_that_of_another_model() -> None:
    t = H * np.arange(2000)
    part = stretch(np.sin(t), np.cos(2.0 * t))
    model = UrdfModel(two_links(), TWO_LINKS)
    heavy = UrdfModel(two_links(), TWO_LINKS, 12.0)
    regressor = BodyRegressor.of(model)
    found = Windows.of(part, model, PHI, regressor).with_gravity(np.array([0.0, 0.0, -2.19]))
    expected = Windows.of(part, heavy, PHI, None)
    assert found.model_torque == pytest.approx(expected.model_torque, abs=1e-4)
    assert found.weight == pytest.approx(expected.weight, abs=1e-4)


def test_windows_of_stretches_are_joined() -> None:
    t = H * np.arange(1000)
    one = Windows.of(stretch(np.sin(t), np.cos(t)), TwoLink(), PHI, None)
    assert join_windows([one]) is one
    both = join_windows([one, one])
    assert len(both.t) == 2 * len(one.t)
    assert np.array_equal(both.load[len(one.t):], one.load)


def test_a_stretch_that_is_too_short_has_no_windows() -> None:
    t = H * np.arange(150)
    found = Windows.of(stretch(np.sin(t), np.cos(t)), TwoLink(), PHI, None)
    assert len(found.t) == 0 and found.stribeck.shape == (0, 2, len(STRIBECK_VELOCITIES))


def test_windows_are_evaluated_in_blocks() -> None:
    """All windows at once would need 70 MB for this, and more with every second."""
    count = 12_000
    t = H * np.arange(count)
    q = np.stack((np.sin(2.0 * t), np.cos(3.0 * t)), axis=1)
    model, phi = make_model('urdf', 9.81, TWO_LINKS, two_links()), TestFunction(H, H * count)
    tracemalloc.start()
    Windows.of(Stretch(0.0, H, q, None, q), model, phi, BodyRegressor.of(model))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 30e6
