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

"""Motion through waypoints."""

from __future__ import annotations

from typing import Any

from ctc_chattering.errors import ParameterError
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.waypoints import Route, Waypoints
import numpy as np
import pytest
from scipy.interpolate import (  # type: ignore[import-untyped]
    BPoly,
    CubicHermiteSpline,
    interp1d,
)

S = 1_000_000_000


def _random(seed: int, given_: int, count: int = 6, n: int = 2) -> tuple[list[int], list[Point]]:
    """Return random waypoints with positions, velocities, accelerations: the first `given_`."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.integers(S // 2, 3 * S, count)).tolist()
    rows = rng.normal(size=(count, 3, n)).tolist()
    return times, [_cut(tuple(map(tuple, point)), given_) for point in rows]


def _cut(point: Any, given_: int) -> Point:
    """Return a point without what comes after its first `given_` rows."""
    q, dq, ddq = (row if k < given_ else () for k, row in enumerate(point))
    return q, dq, ddq


def _oracle(times: list[int], points: list[Point], given_: int, t: float, order: int) -> Any:
    x = np.array(times) / S
    rows = [np.array([p[k] for p in points]) for k in range(given_)]
    if given_ == 3:
        return BPoly.from_derivatives(x, np.stack(rows, 1))(t, nu=order)
    if given_ == 2:
        return CubicHermiteSpline(x, *rows)(t, nu=order)
    line = interp1d(x, rows[0], axis=0)
    if order == 2:
        return np.zeros(rows[0].shape[1])
    if order == 0:
        return line(t)
    i = int(np.searchsorted(x, t, 'right')) - 1
    return (line(x[i + 1]) - line(x[i])) / (x[i + 1] - x[i])


@pytest.mark.parametrize('given_', [1, 2, 3])
@pytest.mark.parametrize('n', [1, 3])
def test_segments_against_scipy(given_: int, n: int) -> None:
    """Check position, velocity and acceleration of every kind of segment."""
    times, points = _random(given_, given_, n=n)
    motion = Waypoints(times, points)
    for t in np.linspace(times[0] + 1, times[-1] - 1, 203).astype(int).tolist():
        for order, row in enumerate(motion.at(t)):
            exact = _oracle(times, points, given_, t / S, order)
            np.testing.assert_allclose(row, exact, rtol=1e-7, atol=1e-7)
    assert motion.end == times[-1]


@pytest.mark.parametrize(('first', 'second', 'order'), [
    (3, 3, 5), (3, 2, 3), (2, 3, 3), (2, 2, 3), (3, 1, 1), (1, 3, 1), (2, 1, 1), (1, 1, 1)])
def test_the_lesser_end_decides(first: int, second: int, order: int) -> None:
    """Check the degree of the polynomial between ends of different kinds."""
    times, whole = [0, S], _random(5, 3, 2, 1)[1]
    points = [_cut(point, g) for g, point in zip((first, second), whole)]
    motion = Waypoints(times, points)
    x = np.linspace(0.05, 0.95, 30)
    path = [motion.at(round(t * S))[0][0] for t in x]
    fit = np.polynomial.Polynomial.fit(x, path, 5, domain=[0, 1], window=[0, 1])
    size = [abs(c) > 1e-6 for c in fit.coef]
    assert size[order]
    assert not any(size[order + 1:])


def test_rest_before_and_after() -> None:
    """Check that it rests at the first and the last position, whatever their velocities."""
    points: list[Point] = [((1.0,), (2.0,), (3.0,)), ((4.0,), (5.0,), (6.0,))]
    motion = Waypoints([S, 2 * S], points)
    assert [motion.at(t) for t in (-S, 0, S - 1)] == [((1.0,), (0.0,), (0.0,))] * 3
    assert motion.at(2 * S) == points[1]
    assert [motion.at(t) for t in (2 * S + 1, 10 ** 15)] == [((4.0,), (0.0,), (0.0,))] * 2
    single = Waypoints([S], [((7.0,), (), ())])
    assert [single.at(t) for t in (0, S, 2 * S)] == [((7.0,), (0.0,), (0.0,))] * 3


@pytest.mark.parametrize('given_', [1, 2, 3])
def test_start_state(given_: int) -> None:
    """Check the way from a start state to the first waypoint, by the same rule."""
    times, points = _random(8, given_)
    begin, state = times[0] - 2 * S, _random(9, 3, 1)[1][0]
    motion = Waypoints(times, points, (begin, state))
    for t in np.linspace(begin, times[0] - 1, 21).astype(int).tolist():
        for order, row in enumerate(motion.at(t)):
            exact = _oracle(
                [begin, *times], [_cut(state, given_), *points], given_, t / S, order)
            np.testing.assert_allclose(row, exact, rtol=1e-7, atol=1e-7)
    assert motion.at(begin)[0] == state[0]
    assert motion.at(begin - 1) == (state[0], (0.0, 0.0), (0.0, 0.0))
    without = Waypoints(times, points)
    for t in (times[0], times[0] + 1, times[2] + 5, times[-1] + 1):
        assert motion.at(t) == without.at(t)


def test_a_start_that_is_not_before_the_first_waypoint_is_passed_over() -> None:
    times, points = _random(8, 3)
    for begin in (times[0], times[0] + 1, times[-1] + 1):
        motion = Waypoints(times, points, (begin, points[3]))
        assert [motion.at(t) for t in times] == points
        assert motion.at(times[0] - 1)[0] == points[0][0]


GOOD: list[Any] = [((0.0, 1.0), (), ()), ((1.0, 2.0), (), ()), ((2.0, 0.0), (), ())]


@pytest.mark.parametrize(('times', 'change', 'name', 'allowed'), [
    ([0, S, S], {}, 'points[2].time_from_start', '1.0 s'),
    ([5, 4, 6], {}, 'points[1].time_from_start', 'more than'),
    ([0, S], {}, 'times', '3'),
    ([0, 1, 2], {0: ((), (), ())}, 'points[0].positions', 'one per joint'),
    ([0, 1, 2], {0: ((1.0, 2.0), (1.0,), ())}, 'points[0].velocities', 'n = 2, got 1'),
    ([0, 1, 2], {1: ((1.0,), (), ())}, 'points[1].positions', 'n = 2, got 1'),
    ([0, 1, 2], {2: ((1.0, 2.0), (1.0,), ())}, 'points[2].velocities', 'got 1'),
    ([0, 1, 2], {1: ((1.0, 2.0), (), (1.0, 2.0))}, 'points[1].accelerations', 'velocities'),
    ([0, 1, 2], {1: ((1.0, float('nan')), (), ())}, 'points[1].positions', 'finite'),
    ([0, 1, 2], {1: ((1.0, 'x'), (), ())}, 'points[1].positions', 'list of finite numbers'),
    ([0, 1, 2], {1: (None, (), ())}, 'points[1].positions', 'list of finite numbers')])
def test_refusals(times: list[int], change: dict[int, Any], name: str, allowed: str) -> None:
    """Check that the error names the waypoint and what is allowed."""
    points = [change.get(i, point) for i, point in enumerate(GOOD)]
    with pytest.raises(ParameterError) as error:
        Waypoints(times, points)
    assert error.value.name == name
    assert allowed in error.value.allowed
    with pytest.raises(ParameterError) as error:
        Route(('a', 'b'), times, points).ordered(('b', 'a'))
    assert error.value.name == name


def test_joints_by_name() -> None:
    """Check every row's order, and that rows left out stay so."""
    route = Route(['c', 'a', 'b'], [0, S], [
        ([1, 2, 3], [4, 5, 6], [7, 8, 9]), ([1, 2, 3], [], [])])
    assert route.ordered(('a', 'b', 'c')) == (
        ('a', 'b', 'c'), (0, S), (((2, 3, 1), (5, 6, 4), (8, 9, 7)), ((2, 3, 1), (), ())))


@pytest.mark.parametrize('names', [
    ('a',), ('a', 'x'), ('a', 'a'), ('a', 'b', 'c'), ('a', 'b', 'b'), ()])
def test_other_joints(names: tuple[str, ...]) -> None:
    """Check that missing, unknown and repeated joints are refused, and which are allowed."""
    row = (0.0,) * len(names)
    with pytest.raises(ParameterError, match='each of these once: a, b') as error:
        Route(names, [0], [(row, (), ())]).ordered(('a', 'b'))
    assert (error.value.name, error.value.value) == ('joint_names', names)
