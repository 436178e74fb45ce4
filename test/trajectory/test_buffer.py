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

"""A desired motion in chunks."""

from ctc_chattering.trajectory.buffer import Point, Trajectory
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

MS = 1_000_000


def _point(rng: np.random.Generator, n: int = 2) -> Point:
    position, velocity, acceleration = rng.normal(size=(3, n)).tolist()
    return tuple(position), tuple(velocity), tuple(acceleration)


def _quintics(seed: int, times: list[int]) -> tuple[list[np.poly1d], list[Point]]:
    """Return a random quintic per joint and its points, in time from times[0]."""
    rng = np.random.default_rng(seed)
    polys = [np.poly1d(rng.normal(size=6)) for _ in range(3)]
    return polys, [_of(polys, (t - times[0]) / 1e9) for t in times]


def _of(polys: list[np.poly1d], s: float) -> Point:
    return tuple(  # type: ignore[return-value]
        tuple(float(p.deriv(order)(s)) for p in polys) for order in range(3))


@settings(max_examples=50)
@given(st.integers(0, 2 ** 32 - 1), st.integers(1, 4000), st.integers(0, 10 ** 12))
def test_between_points_it_is_the_quintic(seed: int, gap: int, start: int) -> None:
    """Check that a random quintic is reproduced in value, velocity and acceleration."""
    times = [start, start + gap * MS]
    polys, points = _quintics(seed, times)
    trajectory = Trajectory()
    trajectory.extend(times, points)
    span = gap * 1e-3
    for share in (0.0, 1e-3, 0.37, 0.5, 0.99, 1.0):
        t = start + round(share * gap * MS)
        found = trajectory.at(t)
        assert found is not None
        for order, (value, exact) in enumerate(zip(found, _of(polys, (t - start) / 1e9))):
            scale = 1e-9 * (1.0 + span ** 5) + 1e-13 / span ** order
            assert value == pytest.approx(exact, rel=1e-9, abs=scale)


def test_rest_after_the_end_and_none_before() -> None:
    """Check the last position with zero derivatives, one nanosecond after the last point."""
    trajectory = Trajectory()
    assert trajectory.at(0) is None
    assert trajectory.end is None
    point: Point = ((1.0, 2.0), (3.0, 4.0), (5.0, 6.0))
    trajectory.extend([10, 20], [point, point])
    assert trajectory.at(9) is None
    assert trajectory.at(-5) is None
    assert trajectory.at(10) == trajectory.at(20) == point
    for t in (21, 10 ** 15):
        assert trajectory.at(t) == ((1.0, 2.0), (0.0, 0.0), (0.0, 0.0))


def test_a_new_piece_replaces_from_its_first_instant() -> None:
    """Check points before, on and after the seam; the old tail is gone."""
    rng = np.random.default_rng(4)
    old, new = [_point(rng) for _ in range(5)], [_point(rng) for _ in range(2)]
    trajectory = Trajectory()
    trajectory.extend([0, 10, 20, 30, 40], old)
    trajectory.extend([20, 25], new)
    assert (len(trajectory), trajectory.end) == (4, 25)
    assert [trajectory.at(t) for t in (0, 10, 20, 25)] == [*old[:2], *new]
    after = trajectory.at(30)
    assert after == (new[1][0], (0.0, 0.0), (0.0, 0.0))
    trajectory.extend([], [])
    assert len(trajectory) == 4
    trajectory.extend([0], new[:1])
    assert (len(trajectory), trajectory.at(0), trajectory.end) == (1, new[0], 0)


def test_forget_keeps_what_is_needed() -> None:
    """Check that every instant from `before` on is answered as if nothing were dropped."""
    rng = np.random.default_rng(5)
    times, points = list(range(0, 100, 10)), [_point(rng) for _ in range(10)]
    for before, left in ((-1, 10), (0, 10), (35, 7), (40, 6), (90, 1), (1000, 1)):
        whole, trajectory = Trajectory(), Trajectory()
        whole.extend(times, points)
        trajectory.extend(times, points)
        trajectory.forget(before)
        assert len(trajectory) == left
        for t in range(max(before, 0), 120):
            assert trajectory.at(t) == whole.at(t)
        if left < 10:
            assert trajectory.at(times[-left] - 1) is None
    trajectory = Trajectory()
    trajectory.forget(5)
    assert len(trajectory) == 0


MOVING: Point = ((1.0, 2.0), (3.0, -4.0), (5.0, 6.0))


@pytest.mark.parametrize('grace', [0, 1, 100 * MS, 10 ** 12])
def test_grace_goes_on_at_the_last_velocity_and_then_holds(grace: int) -> None:
    """Check q + v t up to the grace exactly, and the position reached there ever after."""
    trajectory = Trajectory(grace)
    trajectory.extend([0, 500 * MS], [MOVING, MOVING])
    end = 500 * MS
    assert trajectory.at(end) == MOVING
    for late in sorted({1, grace // 3, grace - 1, grace, grace + 1, 3 * grace, 10 ** 15}):
        if late < 1:
            continue
        found = trajectory.at(end + late)
        assert found is not None
        gone = min(late, grace) * 1e-9
        assert found[0] == pytest.approx([1.0 + 3.0 * gone, 2.0 - 4.0 * gone], rel=1e-12)
        assert tuple(found[1]) == (MOVING[1] if late <= grace else (0.0, 0.0))
        assert tuple(found[2]) == (0.0, 0.0)


@pytest.mark.parametrize('grace', [0, 100 * MS])
def test_overdue_begins_after_the_grace(grace: int) -> None:
    """Check both sides of it, and that nothing is overdue before there is any point."""
    trajectory = Trajectory(grace)
    assert not trajectory.overdue(10 ** 15)
    trajectory.extend([0, 20 * MS], [MOVING, MOVING])
    assert not trajectory.overdue(0)
    assert not trajectory.overdue(20 * MS + grace)
    assert trajectory.overdue(20 * MS + grace + 1)
    trajectory.extend([20 * MS], [((1.0, 2.0), (0.0, 0.0), (0.0, 0.0))])
    assert not trajectory.overdue(10 ** 15)
