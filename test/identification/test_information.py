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

"""What a motion tells, against least squares of its columns and numbers of the literature."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from ctc_chattering.configuration import parameter_file
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import make_model, model_of
from ctc_chattering.identification.random_motions import Bounds, Regression
import numpy as np
import numpy.typing as npt
import pytest
from urdfs import heavier_links, PANDA, panda

Array = npt.NDArray[np.float64]
ROOT = Path(__file__).parents[2]


@cache
def robot(name: str) -> tuple[Model, Bounds, Regression]:
    setup = parameter_file.load(ROOT / 'config' / f'{name}.yaml')
    model = model_of(setup.controller, setup.descriptions.get('controller', ''))
    bounds = Bounds(np.array(setup.reference.center), *(np.full(model.n, x) for x in (
        0.8, 1.0, 4.0)))
    return model, bounds, Regression(model, bounds, np.ones(model.n))


def states(bounds: Bounds, count: int, seed: int = 0) -> Array:
    """Return random positions, velocities and accelerations, (3, count, n)."""
    drawn = np.random.default_rng(seed).uniform(-1.0, 1.0, (3, count, len(bounds.center)))
    drawn *= np.array([bounds.room, bounds.velocity, bounds.acceleration])[:, np.newaxis]
    drawn[0] += bounds.center
    return drawn


# Gautier & Khalil's count: 43 of an arm like the Panda, 36 of a UR5. Two links in a plane have 5;
# the paper's arm has 6 constants, for M12 and M22 have different ones.
@pytest.mark.parametrize(('name', 'count'), [('panda', 43), ('ur5', 36), ('friction', 6)])
def test_the_number_of_base_parameters(name: str, count: int) -> None:
    model, _, regression = robot(name)
    assert regression.parameters == count
    # A vertical first axis has no weight, so that its friction and all else are still told apart.
    motion = states(robot(name)[1], 200)
    assert np.isfinite(regression.of(motion, np.ones(200)).condition)
    assert len(regression.of(motion, np.ones(200)).matrix) == 3 * model.n + count


def test_torques_of_the_model_and_of_heavier_links_are_combinations_of_the_columns() -> None:
    model, bounds, regression = robot('panda')
    motion = states(bounds, 120)
    columns = regression.columns(motion).reshape(-1, regression.parameters)
    for other in (model, make_model('urdf', 9.81, PANDA, heavier_links(panda(), PANDA)[3][1])):
        tau = np.array([other.inverse_dynamics(*x) for x in zip(*motion)])
        rest = tau.ravel() - columns @ np.linalg.lstsq(columns, tau.ravel(), rcond=None)[0]
        assert np.abs(rest).max() < 1e-8 * np.abs(tau).max()


def test_inflation_is_what_is_left_of_a_column_beside_all_others() -> None:
    _, bounds, regression = robot('panda')
    told = regression.of(states(bounds, 60), np.full(60, 0.1))
    x = np.linalg.cholesky(told.matrix).T
    for k in (0, 8, 20, 40):
        others = np.delete(x, k, axis=1)
        rest = x[:, k] - others @ np.linalg.lstsq(others, x[:, k], rcond=None)[0]
        expected = np.linalg.norm(x[:, k]) / np.linalg.norm(rest)
        assert told.inflation()[k] == pytest.approx(expected, rel=1e-6)
    scaled = x / np.linalg.norm(x, axis=0)
    assert told.condition == pytest.approx(np.linalg.cond(scaled), rel=1e-6)


def test_a_joint_at_rest_tells_nothing() -> None:
    _, bounds, regression = robot('friction')
    motion = states(bounds, 40)
    motion[1, :, 0] = 0.0
    told = regression.of(motion, np.ones(40))
    assert not told.matrix[0].any()
    assert told.condition == np.inf
    assert told.merit() == -np.inf
