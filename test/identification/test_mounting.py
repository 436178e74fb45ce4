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
"""Gravity in the frame of a base that is mounted otherwise."""

from __future__ import annotations

from ctc_chattering.identification.mounting import angle_between, estimate_gravity
from made_up_windows import arm_windows, observed
import numpy as np
from panda_torques import scaled_torque, turned_base
import pytest
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]
import urdfs


@pytest.mark.parametrize('degrees', [5.0, 30.0, 90.0, 180.0])
@pytest.mark.parametrize('axis', ['x', 'y'])
def test_a_base_that_is_mounted_otherwise(degrees: float, axis: str) -> None:
    data, gravity = turned_base(Rotation.from_euler(axis, degrees, degrees=True))
    found = estimate_gravity(data, np.array([0.0, 0.0, -9.81]))
    assert np.degrees(angle_between(found, gravity)) < 1.0
    assert np.linalg.norm(found) == pytest.approx(9.81)


def test_a_base_that_is_mounted_as_the_urdf_has_it() -> None:
    gravity = np.array([0.0, 0.0, -9.81])
    assert estimate_gravity(scaled_torque(), gravity) is gravity


def test_a_planar_arm_keeps_gravity_across_its_plane() -> None:
    rows, _ = arm_windows(urdfs.two_links(), urdfs.TWO_LINKS, 400)
    down = Rotation.from_euler('y', 60.0, degrees=True).apply([0.0, 0.0, -9.81])
    torque = rows.model_torque + rows.bodies[:, :, -3:] @ (down - [0.0, 0.0, -9.81])
    data = observed(rows, torque + 2.0 * rows.direction)
    found = estimate_gravity(data, np.array([0.0, 0.0, -9.81]))
    assert found == pytest.approx(down, abs=0.05)
