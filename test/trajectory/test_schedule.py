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

"""Time of a motion that is published ahead of time, and its chunks."""

from __future__ import annotations

from ctc_chattering.errors import CtcError, ParameterError, RejectedMessage
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.trajectory.motion_plan import MotionPlan
from ctc_chattering.trajectory.reference import ReferenceConfig, Sinusoid
from ctc_chattering.trajectory.schedule import MotionSchedule
from ctc_chattering.trajectory.waypoints import Route
import pytest

S = NANOSECONDS
MS = S // 1000
PERIOD = 10 * MS
HORIZON = 400 * MS
CONFIG = ReferenceConfig(phase=(0.3, 0.4), control_period=0.01)
REST = (0.0, 0.0)


def scheduled() -> MotionSchedule:
    """Return the schedule of a motion that does not wait for the robot."""
    plan = MotionPlan(CONFIG, None)
    plan.prepare()
    return MotionSchedule(plan, PERIOD, HORIZON)


def stamps(schedule: MotionSchedule) -> list[int]:
    """Return the stamps of the chunks that are due."""
    return [stamp for stamp, _ in schedule.chunks()]


def waypoints(*points: tuple[int, tuple[float, float]]) -> Route:
    return Route(CONFIG.joint_names, [t for t, _ in points], [(q, REST, ()) for _, q in points])


def test_chunks_cover_the_horizon_once_on_the_control_grid() -> None:
    schedule, published = scheduled(), {}
    for now in range(0, 3 * S, 37 * MS):
        schedule.follow_clock(now)
        for stamp, points in schedule.chunks():
            for k, point in enumerate(points):
                assert stamp + k * PERIOD not in published
                published[stamp + k * PERIOD] = point
        assert max(published) >= now // PERIOD * PERIOD + HORIZON - PERIOD
    assert sorted(published) == list(range(0, max(published) + 1, PERIOD))
    assert all(point == Sinusoid(CONFIG).at(t) for t, point in published.items())


def test_chunks_come_again_where_time_stands_still_or_goes_back_and_for_a_new_subscriber() -> None:
    schedule = scheduled()
    schedule.follow_clock(2 * S)
    assert stamps(schedule) == [2 * S + k * 100 * MS for k in range(4)]
    assert stamps(schedule) == []
    schedule.follow_clock(2 * S)
    assert stamps(schedule)[0] == 2 * S
    schedule.repeat()
    assert stamps(schedule)[0] == 2 * S
    schedule.follow_clock(S)
    assert stamps(schedule)[0] == S


def test_real_time_begins_with_a_state_in_step_and_goes_on_with_the_clock() -> None:
    """The stamps are of another clock, 5000 s ahead of that of the node."""
    schedule = scheduled()
    assert schedule.follow_states(7 * S, 100 * S) is None
    assert schedule.follow_states(5100 * S, 100 * S + MS) is None
    assert not schedule.started
    assert schedule.follow_states(5101 * S, 101 * S) == 0
    assert schedule.follow_states(5103 * S, 103 * S) == 2 * S
    schedule.follow_real_time(103 * S)
    assert (schedule.now, schedule.simulated) == (2 * S, False)
    assert stamps(schedule)[0] == 5103 * S
    with pytest.raises(RejectedMessage, match='follows real time'):
        schedule.follow_clock(0)


def test_a_clock_makes_time_simulated() -> None:
    schedule = scheduled()
    schedule.follow_clock(S)
    schedule.follow_real_time(500 * S)
    assert (schedule.now, schedule.simulated, schedule.running) == (S, True, True)


def test_waypoints_are_followed_after_what_has_been_published() -> None:
    schedule = scheduled()
    with pytest.raises(RejectedMessage, match='has not begun'):
        schedule.follow(waypoints((S, (1.0, 1.0))), 0)
    schedule.follow_clock(2 * S)
    before = {t: point for begin, points in schedule.chunks()
              for t, point in zip(range(begin, begin + S, PERIOD), points)}
    followed = schedule.follow(waypoints((S, (3.0, 1.0))), 0)
    assert followed.end == 2 * S + 100 * MS + S
    begin, points = next(schedule.chunks())
    assert begin == 2 * S + 100 * MS
    assert points[0][0] == pytest.approx(before[begin][0])
    assert points[-1] != before[begin + 9 * PERIOD]
    assert schedule.follow(waypoints((S, (3.0, 1.0))), 4 * S).end == 5 * S
    assert schedule.follow(Route((), [], []), 0).waypoints == 0


def test_waypoints_in_real_time_have_the_stamps_of_the_nodes_clock() -> None:
    """Also where the states have stamps of another clock."""
    schedule = scheduled()
    schedule.follow_states(5100 * S, 100 * S)
    schedule.follow_states(5101 * S, 101 * S)
    schedule.follow_real_time(102 * S)
    assert schedule.follow(waypoints((S, (3.0, 1.0))), 103 * S).end == 3 * S
    with pytest.raises(CtcError, match=r'the last one was due 0\.500 s ago'):
        schedule.follow(waypoints((S // 2, (3.0, 1.0))), 101 * S)
    with pytest.raises(ParameterError, match=r'points\[0\].time_from_start: -1.0'):
        schedule.follow(waypoints((-S, (3.0, 1.0))), 103 * S)


def test_changed_parameters_are_in_force_after_what_has_been_published() -> None:
    schedule = scheduled()
    schedule.follow_clock(2 * S)
    assert schedule.update() == 0
    list(schedule.chunks())
    schedule._plan.config = CONFIG.changed({'amplitude': (0.1, 0.1)})
    assert schedule.update() == 2 * S + 100 * MS
    assert stamps(schedule)[0] == 2 * S + 100 * MS


def test_a_change_during_a_transition_is_in_force_after_its_end() -> None:
    schedule = scheduled()
    schedule.follow_clock(2 * S)
    for amplitude in (0.1, 0.2):
        schedule._plan.config = CONFIG.changed({'amplitude': (amplitude, amplitude)})
        in_force = schedule.update()
    assert in_force is None
    schedule.follow_clock(5 * S)
    assert schedule.update() == 5 * S + 100 * MS


def test_a_motion_that_begins_again_has_its_parameters_from_its_start_on() -> None:
    plan = MotionPlan(CONFIG.changed({'start_duration': 1.0}), None)
    schedule = MotionSchedule(plan, PERIOD, HORIZON)
    schedule.follow_clock(0)
    schedule.begin({}, 0)
    schedule.follow_clock(8 * S)
    plan.config = plan.config.changed({'amplitude': (0.1, 0.1)})
    assert schedule.update() == 8 * S + 100 * MS
    schedule.follow_clock(S)
    schedule.begin({}, S)
    assert schedule.update() == 0


def test_the_desired_motion_has_the_instants_of_its_chunk() -> None:
    """At half the speed, with a time of the states that does not begin at 0."""
    plan = MotionPlan(CONFIG.changed({'speed_scaling': 0.5}), None)
    plan.prepare()
    schedule = MotionSchedule(plan, PERIOD, HORIZON)
    assert [schedule.follow_states(7 * S, 5 * S) for _ in range(2)] == [None, 0]
    schedule.follow_real_time(5 * S)
    chunks = list(schedule.chunks())
    assert len(chunks) == 4
    for stamp, points in chunks:
        assert schedule.desired(stamp) == points
