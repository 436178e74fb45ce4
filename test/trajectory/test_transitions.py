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

"""The smooth start: within the hull of start and motion, whatever the phase."""

from __future__ import annotations

import math

from ctc_chattering.errors import ParameterError
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.joint_limits import JointLimits
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig
from ctc_chattering.trajectory.transitions import (
    braking,
    BRAKING_TIME,
    shortest_duration,
    smooth_start,
    TimedMotion,
    Transition,
)
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from sinusoids import instants, positions, ranges, S, sample, sinusoids, velocities

durations = st.floats(0.05, 20.0)


class Wave:
    """A motion of two joints that never rests."""

    def at(self, t: int) -> Point:
        x = t / S
        return ((np.sin(3 * x), x ** 2), (3 * np.cos(3 * x), 2 * x), (-9 * np.sin(3 * x), 2.0))


@settings(max_examples=100)
@given(sinusoids, positions, velocities, durations, instants)
def test_a_robot_that_moves_leaves_the_hull_by_its_braking_distance(
        config: ReferenceConfig, q0: float, dq0: float, duration: float, t0: int) -> None:
    """Half of its velocity times the time that it brakes, at the most."""
    c, a, speed, push = ranges(config)
    motion = make_motion(config.changed({'start_duration': duration}), None, {'a': (q0, dq0)}, t0)
    assert motion.at(t0) == ((q0,), (dq0,), (0.0,))
    q, dq, ddq = sample(motion, t0, t0 + round((duration + 0.5) * S))[:, :, 0].T
    brake = min(duration, BRAKING_TIME)
    margin = 0.5 * abs(dq0) * brake
    assert q.min() >= min(q0, c - a) - margin - 1e-9
    assert q.max() <= max(q0, c + a) + margin + 1e-9
    far = abs(q0 - c) + a + margin
    assert np.abs(dq).max() <= max(abs(dq0), speed) + 1.875 * far / duration + 1e-9
    assert np.abs(ddq).max() <= (
        max(push, 1.5 * abs(dq0) / brake) + 3.75 * (speed + abs(dq0)) / duration
        + 5.774 * far / duration ** 2) * (1 + 1e-9) + 1e-9


@settings(max_examples=60)
@given(st.tuples(positions, positions), st.tuples(velocities, velocities),
       st.tuples(velocities, velocities), durations, instants)
def test_both_ends(q0: tuple[float, float], dq0: tuple[float, float], ddq0: tuple[float, float],
                   duration: float, t0: int) -> None:
    """Check state and acceleration at both ends to the last bit, and rest before."""
    motion = Wave()
    start = smooth_start(motion, t0, (q0, dq0, ddq0), duration)
    assert start.at(t0) == (q0, dq0, ddq0)
    assert start.at(t0 - 1) == (q0, (0.0, 0.0), (0.0, 0.0))
    assert start.end == t0 + round(duration * S)
    for t in (start.end, start.end + 1, start.end + 7 * S):
        assert start.at(t) == motion.at(t)


@pytest.mark.parametrize('motion', [
    smooth_start(Wave(), 0, ((1.0, 2.0), (-1.0, 0.3), (2.0, 0.0)), 1.5),
    Transition(Wave(), braking(0, ((1.0, 2.0), (0.5, 0.0), (0.0, 1.0)), 1.0), 0, 1.5)])
def test_velocity_and_acceleration_are_derivatives_and_nothing_jumps(motion: TimedMotion) -> None:
    """Check both against finite differences, over the seams too."""
    step = 100_000
    for t in (1, *range(step, 2 * S, S // 17), S // 2, S, 3 * S // 2):
        before, now, after = (np.array(motion.at(t + d)) for d in (0, step, 2 * step))
        np.testing.assert_allclose(now[:2], (before + after)[:2] / 2, atol=1e-6)
        np.testing.assert_allclose(now[1:], (after - before)[:2] / (2 * step / S), atol=1e-2)
        np.testing.assert_allclose(before[2], after[2], atol=5e-2)


def test_braking_ends_at_rest_after_half_the_way() -> None:
    """Check place, velocity and deceleration of a stop, without and with a first acceleration."""
    plain = braking(S, ((1.0,), (2.0,), (0.0,)), 0.5)
    assert [row[0] for row in plain.at(2 * S)] == pytest.approx([1.5, 0.0, 0.0])
    path = sample(plain, S, 2 * S, 2001)
    assert np.abs(path[:, 2]).max() == pytest.approx(1.5 * 2.0 / 0.5, 1e-3)
    speeding = braking(S, ((1.0,), (2.0,), (6.0,)), 0.5)
    path = sample(speeding, S, S + S // 2, 201)
    quartic = np.polyfit(np.linspace(0.0, 1.0, 201), path[:, 0, 0], 5)
    assert quartic[0] == pytest.approx(0.0, abs=1e-9) and abs(quartic[1]) > 0.1
    assert path[-1].ravel().tolist() == pytest.approx([path[-1, 0, 0], 0.0, 0.0], abs=1e-9)


def test_the_shortest_duration() -> None:
    """Check it against a rest-to-rest move, whose greatest velocity is 15/8 of the mean."""
    def move(duration: float) -> Transition:
        first, last = (braking(0, ((q,), (0.0,), (0.0,)), 1.0) for q in (0.0, 3.0))
        return Transition(first, last, 0, duration)

    slow = [JointLimits('a', velocity=(-1.5, 1.5))]
    needed = 3.0 * 1.875 / 1.5
    duration = shortest_duration(move, 0.1, slow)
    assert duration is not None
    assert needed <= duration <= 1.15 * needed
    assert shortest_duration(move, 5.0, slow) == 5.0
    assert shortest_duration(move, 0.1, [JointLimits('a', position=(-9.0, 2.0))]) is None


def test_a_transition_of_no_duration_switches_at_its_instant() -> None:
    """The last nanosecond before it is the one motion, the instant itself the other one."""
    origin, target = Wave(), braking(0, ((1.0, 2.0), (0.0, 0.0), (0.0, 0.0)), 1.0)
    switch = Transition(origin, target, S, 0.0)
    assert switch.end == S
    assert [switch.at(t) for t in (0, S - 1)] == [origin.at(t) for t in (0, S - 1)]
    assert [switch.at(t) for t in (S, S + 1)] == [target.at(t) for t in (S, S + 1)]


@pytest.mark.parametrize(('q0', 'dq0', 'duration', 'ddq0', 'name'), [
    ((0.0, 0.0), (0.0, 0.0), 0.0, (0.0, 0.0), 'duration'),
    ((0.0, 0.0), (0.0, 0.0), math.nan, (0.0, 0.0), 'duration'),
    ((0.0,), (0.0, 0.0), 1.0, (0.0, 0.0), 'start.positions'),
    ((0.0, 0.0), (0.0, math.inf), 1.0, (0.0, 0.0), 'start.velocities'),
    ((0.0, 0.0), (0.0, 0.0), 1.0, (0.0,), 'start.accelerations')])
def test_refusals(q0: tuple[float, ...], dq0: tuple[float, ...], duration: float,
                  ddq0: tuple[float, ...], name: str) -> None:
    """Check that the error names what is wrong."""
    with pytest.raises(ParameterError) as error:
        smooth_start(Wave(), 0, (q0, dq0, ddq0), duration)
    assert error.value.name == name
