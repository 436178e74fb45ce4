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

"""Causes of errors, against robots whose base is turned."""

from __future__ import annotations

from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.identification.regression.attribution import absurd, Explanation
from ctc_chattering.identification.regression.causes import Cause, CauseKind, causes
from ctc_chattering.identification.regression.error_columns import ErrorColumns
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]
import urdfs


def gravity_cause(text: str, joints: tuple[str, ...]) -> tuple[ErrorColumns, Cause]:
    columns = ErrorColumns.of(UrdfModel(text, joints))
    assert columns is not None
    return columns, next(
        x for x in causes(columns, len(joints), [], np.ones(len(joints)))
        if x.kind == CauseKind.GRAVITY)


def torques(columns: ErrorColumns, gravity: Array) -> Array:
    """Return the weights of some poses under a gravity."""
    poses = np.random.default_rng(1).normal(size=(20, columns.model.n))
    return np.array([columns.model.gravity_map(q) @ gravity for q in poses])


@pytest.mark.parametrize('lean', [0.0, 0.08])
def test_a_planar_arm_shows_gravity_in_its_plane(lean: float) -> None:
    """A turn in the plane, and what a lean across it takes away; never an angle across it."""
    columns, cause = gravity_cause(urdfs.two_links(), urdfs.TWO_LINKS)
    assert np.abs(columns.across()) == pytest.approx([0.0, 1.0, 0.0])
    turn = 0.06 * cause.direction
    down = Rotation.from_rotvec(turn).apply(
        Rotation.from_rotvec([lean, 0.0, 0.0]).apply([0.0, 0.0, -9.81]))
    value = np.array([0.06, 1.0 - np.cos(lean)])
    found = columns.prior[-3:] + cause.errors(columns, value)[-3:]
    assert torques(columns, found) == pytest.approx(torques(columns, down), abs=1e-9)
    design = cause.design(columns, value)
    assert np.linalg.matrix_rank(design) == 2
    assert design @ value == pytest.approx(columns.coordinates(cause.errors(columns, value)))


def test_a_base_that_is_not_level_is_not_turned_by_much() -> None:
    columns, cause = gravity_cause(urdfs.two_links(), urdfs.TWO_LINKS)
    for value, wanted in (([0.2, 0.02], False), ([0.3, 0.0], True), ([0.1, 0.1], True)):
        assert absurd(Explanation((cause,), (np.array(value),), 0.0)) == wanted
    columns, cause = gravity_cause(urdfs.panda(), urdfs.PANDA)
    assert len(columns.across()) == 0
    for value, wanted in (([0.2, 0.2], False), ([0.0, -0.3], True)):
        assert absurd(Explanation((cause,), (np.array(value),), 0.0)) == wanted
