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

"""The search against random motions, and the limits it keeps at finer steps than its own."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.configuration import parameter_file
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import make_model
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.excitation.best_motion import Shapes
from ctc_chattering.identification.excitation.collision import SelfCollision
from ctc_chattering.identification.excitation.information import Regression
from ctc_chattering.identification.excitation.limits import bounds_of, ExcitationConfig
from ctc_chattering.identification.excitation.margins import (
    AssumedFriction,
    DistanceLimit,
    Limit,
    TorqueLimit,
)
from ctc_chattering.identification.excitation.plan import plan, request_of
from ctc_chattering.identification.excitation.search import Search
from ctc_chattering.trajectory.joint_limits import DescribedLimits
import numpy as np
import numpy.typing as npt
import pytest
from urdfs import joint, link, urdf

Array = npt.NDArray[np.float64]
ROOT = Path(__file__).parents[3]
NAMES = ('first', 'second')
#: Two bars in a plane, and a wall that the ends of the second may reach.
LENGTH, WALL = 0.5, 0.75
ARM = urdf([
    link('base'), link('upper', 3.0, (0.25, 0.0, 0.0), (0.1, 0.1, 0.1)),
    link('lower', 1.0, (0.25, 0.0, 0.0), (0.05, 0.05, 0.05)).replace(
        '</link>', '<collision><origin xyz="0.5 0 0"/><geometry><sphere radius="0.05"/></geometry>'
        '</collision></link>'),
    link('wall').replace('/>', '><collision><origin xyz="1.25 0 0"/><geometry><box size="1 9 9"/>'
                         '</geometry></collision></link>'),
    joint('first', 'revolute', 'base', 'upper', '0 1 0'),
    joint('second', 'revolute', 'upper', 'lower', '0 1 0', f'{LENGTH} 0 0'),
    joint('fixed', 'fixed', 'base', 'wall', more='')])


class Bench:
    """The arm, with the searches of its motions."""

    def __init__(self, center: tuple[float, float] = (0.8, 1.2), effort: float = np.inf) -> None:
        self.config = ExcitationConfig(NAMES, 40.0, center=center, start=center)
        self.bounds = bounds_of(self.config, DescribedLimits(ARM, NAMES).joints)
        self.model: Model = make_model('urdf', 9.81, NAMES, ARM)
        self.shapes = Shapes(self.config, self.bounds)
        self.links = SelfCollision(ARM, NAMES, {}, np.array([center]), 0.05)
        self.friction = AssumedFriction(np.ones(2), np.zeros(2))
        self.limits: list[Limit] = [
            TorqueLimit(NAMES, self.model, self.friction, np.full(2, effort)),
            DistanceLimit(self.links)]
        self.search = Search(self.shapes, self.bounds, Regression(
            self.model, self.bounds, np.ones(2)), self.limits)

    def played(self, z: Array) -> Array:
        """Return position, velocity and acceleration, in steps of 1 ms."""
        return self.shapes.motion(z).path.at(np.arange(0.0, 40.0, 0.001))


def to_the_wall(q: Array) -> Array:
    """Return the distance of the ball from the wall, (N,) [m]."""
    reach = LENGTH * np.cos(q[:, 0]) + LENGTH * np.cos(q.sum(axis=1))
    found: Array = WALL - reach - 0.05
    return found


def test_the_wall_and_the_bounds_are_kept_in_finer_steps() -> None:
    bench = Bench()
    free = bench.shapes.random(np.random.default_rng(0))
    best = bench.search.best(150, 0)
    q, dq, ddq = bench.played(best.z)
    assert 0.05 <= to_the_wall(q).min() < 0.1  # It is in the way.
    assert to_the_wall(bench.played(free)[0]).min() < 0.05  # Random motions collide.
    for rows, most in ((q - bench.config.center, bench.bounds.room), (dq, bench.bounds.velocity),
                       (ddq, bench.bounds.acceleration)):
        assert (np.abs(rows).max(axis=0) <= most).all()


def test_a_torque_limit_is_kept_in_finer_steps() -> None:
    peaks = []
    for effort in (np.inf, 12.0):
        bench = Bench(effort=effort)
        points = bench.played(bench.search.best(70, 0).z)[:, ::10]
        tau = np.array([bench.model.inverse_dynamics(*x) for x in zip(*points)])
        peaks.append(np.abs(bench.friction.added(tau, points[1])).max())
    assert peaks[1] <= 12.0 < peaks[0]


def test_a_motion_that_cannot_be_is_refused_with_the_limit_that_it_breaks() -> None:
    with pytest.raises(CtcError, match=r'peak torque of first: .* at most 5 N\*m'):
        Bench(effort=5.0).search.best(5, 0)
    near = Bench(center=(0.2, 1.2))
    with pytest.raises(CtcError, match=r'they touch, lower and wall at .* at least 0\.0\d+ m'):
        near.search.best(5, 0)


@pytest.mark.parametrize('robot', ['friction', pytest.param('panda', marks=pytest.mark.slow),
                                   pytest.param('ur5', marks=pytest.mark.slow)])
def test_it_beats_as_many_random_motions(robot: str) -> None:
    setup = parameter_file.load(ROOT / 'config' / f'{robot}.yaml')
    count = 200
    found = plan(setup, request_of(setup, {}), None, count, 0)
    shapes = Shapes(request_of(setup, {}), found.bounds)
    search = Search(shapes, found.bounds, found.regression, [])
    rng = np.random.default_rng(0)
    drawn = [search.evaluated(shapes.random(rng)).information for _ in range(
        found.best.evaluations)]
    assert found.best.evaluations >= count
    assert found.best.information.condition < 0.95 * min(x.condition for x in drawn)
    assert found.best.information.log_determinant > max(x.log_determinant for x in drawn)
    assert found.best.random[0] == drawn[0].condition


def test_the_same_seed_gives_the_same_motion() -> None:
    first, again, other = (Bench().search.best(30, seed).z for seed in (3, 3, 4))
    assert (first == again).all()
    assert (first != other).any()
