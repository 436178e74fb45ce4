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

"""What we read and write against the (de)serialization of ROS, and joints by name."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
import math
import os
import random
import struct
import subprocess
import sys
from typing import Any

from bags import chunk, efforts, state
from builtin_interfaces.msg import Time
from ctc_chattering.configuration.topics import select
from ctc_chattering.errors import CtcError, RejectedMessage
from ctc_chattering.numerics.time_grid import nanoseconds
from ctc_chattering.ros.messages import (
    effort_reader,
    effort_writer,
    Point,
    read_stamp,
    stamp,
    state_reader,
    state_writer,
    trajectory_reader,
    TrajectoryWriter,
)
from faults import KINDS
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header
from trajectory_msgs.msg import JointTrajectory

#: Every remainder of the length of all names by 8 comes up.
NAMES = [*(tuple('j' * (1 + i + stretch) for i in range(2)) for stretch in range(8)),
         ('a',), tuple('abcdefg')]
ODD = [math.inf, -math.inf, math.nan, -0.0, 0.0, 5e-324, -2.2e-308, 1.7e308]


def bits(row: Iterable[float]) -> bytes:
    return array('d', row).tobytes()


def ns(time: Any) -> int:
    return int(time.sec) * 10 ** 9 + int(time.nanosec)


def read_state(data: bytes) -> tuple[Any, ...]:
    m = deserialize_message(data, JointState)
    return ns(m.header.stamp), tuple(m.name), *map(bits, (m.position, m.velocity, m.effort))


def used(kind: Any, data: bytes, ours: Sequence[str]) -> list[tuple[float, ...]]:
    """Return what the nodes use of a message."""
    if kind is not JointTrajectory:
        m = (state_reader if kind is JointState else effort_reader)()(data)
        return select(ours, m.names or ours, *m.rows[:2])
    content = trajectory_reader()(data)
    if list(content.offsets) != sorted(set(content.offsets)):
        raise RejectedMessage('times')
    return select(ours, content.names, *content.rows)


@pytest.mark.parametrize('index', range(4))
def test_damaged_messages(index: int) -> None:
    """
    Check that a part of a message never passes for a whole one.

    rclpy takes a row of a `JointTrajectory` that is cut off at its count for an empty one, which
    is refused like the time of its point. In a `JointState` the efforts may be missing.
    """
    ours, rows = ('a', 'bcd'), [[1.0 + i + 10.0 * k for i in range(2)] for k in range(3)]
    kind, data = [
        (JointState, state(ours, rows, (1, 2))), (Float64MultiArray, efforts(ours, rows[0])),
        (Float64MultiArray, efforts([], rows[0])),
        (JointTrajectory, chunk(ours, [(rows, k, k) for k in range(3)], (1, 2)))][index]
    whole = used(kind, data, ours)
    for bad in (*(data[:end] for end in range(len(data))), os.urandom(3), b'\xff' * len(data)):
        with pytest.raises((RuntimeError, RejectedMessage)):
            used(kind, bad, ours)
    assert whole == used(kind, data + bytes(8), ours)


#: Reads mutated messages in a process with limited memory; prints how many were read of each kind.
FUZZ = """
import random, resource
from faults import KINDS, mutated
from ctc_chattering.configuration.topics import CLOCK
from ctc_chattering.ros.messages import read_stamp
from rclpy.serialization import deserialize_message

def read(kind, data):
    return read_stamp(data) if kind.topic == CLOCK else deserialize_message(data, kind.type)

for kind in KINDS.values():
    read(kind, kind.valid)
size = int(open('/proc/self/statm').read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (size + 2 ** 27, size + 2 ** 27))
for kind in KINDS.values():
    dice, count = random.Random(1), 0
    for i in range(2000):
        data = mutated(kind, dice) if i % 4 else kind.make(dice)
        try:
            read(kind, data)
            count += 1
        except MemoryError:
            raise
        except Exception:
            pass
    print(count)
"""


def test_thousands_of_mutated_messages_do_no_harm() -> None:
    """Check that there is no crash, and no need for memory."""
    done = subprocess.run(
        [sys.executable, '-c', FUZZ], capture_output=True, text=True, check=False,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(x for x in sys.path if x)})
    assert done.returncode == 0, done.stderr
    counts = [int(line) for line in done.stdout.splitlines()]
    assert len(counts) == len(KINDS) and all(500 < count < 2000 for count in counts), counts


@pytest.mark.parametrize('names', NAMES)
def test_states_that_are_sent(names: tuple[str, ...]) -> None:
    """Check what ROS reads from them, odd numbers and stamps included; no byte is behind them."""
    n = len(names)
    fields = ('position', 'velocity', 'effort')
    for chosen in (fields, ('velocity',), ('position', 'velocity'), ('effort',)):
        for k, t in enumerate((0, -1, -7 * 10 ** 9 + 5, 2 ** 31 * 10 ** 9 - 1)):
            rows = [[(ODD * 2)[k + i] + j for i in range(n)] for j in range(3)]
            by_field = dict(zip(chosen, rows))
            all_rows = [by_field.get(field, ()) for field in fields]
            data = state_writer(names, **dict.fromkeys(chosen, n)).write(
                *all_rows[fields.index(chosen[0]):], t=t)
            assert len(data) == len(state(names, all_rows))
            assert read_state(data) == (t, names, *map(bits, all_rows))
            message = deserialize_message(effort_writer(names).write(rows[0]), Float64MultiArray)
            assert tuple(x.label for x in message.layout.dim) == names
            assert bits(message.data) == bits(rows[0])


@pytest.mark.parametrize('names', NAMES)
def test_messages_of_one_frame_and_others_between(names: tuple[str, ...]) -> None:
    """Check what is read of each against ROS, whichever came before."""
    read, read_efforts, n = state_reader(), effort_reader(), len(names)
    dice = random.Random(n)
    for k in range(60):
        ours = dice.choice((names, names, names, names[::-1], names[1:], ('x', 'y')))
        rows = [[dice.choice(ODD) if dice.random() < 0.3 else dice.gauss(0.0, 1.0)
                 for _ in range(len(ours))] for _ in range(3)]
        if k % 7 == 0:
            rows[dice.randrange(3)] = [1.0] * dice.choice((0, 1, len(ours) + 1))
        data = state(ours, rows, (k - 3, k), dice.choice('<<>'))
        data += bytes(dice.choice((0, 0, 0, 4, 8)))
        found = read(data)
        assert (found.t, found.names, *map(bits, found.rows)) == read_state(data)
        data = efforts(ours, rows[0]) + bytes(dice.choice((0, 0, 0, 4, 8)))
        message = deserialize_message(data, Float64MultiArray)
        found = read_efforts(data)
        assert found.names == tuple(x.label for x in message.layout.dim)
        assert [bits(row) for row in found.rows] == [bits(message.data)]
        with pytest.raises(RuntimeError, match='deserialize'):
            read(data[:dice.randrange(12)])


@pytest.mark.parametrize('names', NAMES)
def test_trajectories_of_one_frame_and_others_between(names: tuple[str, ...]) -> None:
    """Check what is read of each against ROS, whichever came before."""
    read, dice = trajectory_reader(), random.Random(len(names))
    for k in range(80):
        ours = dice.choice((names, names, names, names[::-1], names[1:], ('x', 'y')))
        period = dice.choice((1, 1, 1, 2))
        points = [
            ([[dice.choice(ODD) if dice.random() < 0.3 else dice.gauss(0.0, 1.0) for _ in ours]
              for _ in range(3)], 0, i * period)
            for i in range(dice.choice((3, 3, 3, 1, 0)))]
        if points and k % 7 == 0:
            points[-1][0][dice.randrange(3)] = [1.0] * dice.choice((0, 1, len(ours) + 1))
        data = chunk(ours, points, (k - 3, k)) + bytes(dice.choice((0, 0, 0, 4, 8)))
        message, content = deserialize_message(data, JointTrajectory), read(data)
        assert content.t == ns(message.header.stamp)
        assert content.names == tuple(message.joint_names)
        assert list(content.offsets) == [ns(x.time_from_start) for x in message.points]
        assert list(map(bits, content.rows)) == [bits(row) for x in message.points for row in (
            x.positions, x.velocities, x.accelerations)]
        with pytest.raises(RuntimeError, match='deserialize'):
            read(data[:dice.randrange(12)])


def test_a_trajectory_of_a_known_frame_needs_no_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    read, writer = trajectory_reader(), TrajectoryWriter(['a', 'b'], 1, 3)
    read(writer.write(1_000_000_002, [([0.5, 1.0],) * 3] * 3))
    monkeypatch.setattr('ctc_chattering.ros.messages.deserialize_message', None)
    later = [([k + 0.1, k - 0.1],) * 3 for k in range(3)]
    content = read(writer.write(3_000_000_004, later))
    assert (content.t, content.offsets) == (3_000_000_004, [0, 1, 2])
    assert content.rows == [tuple(row) for point in later for row in point]


def test_writers_take_no_other_number_of_joints() -> None:
    for row in ([], [1.0], [1.0, 2.0, 3.0]):
        with pytest.raises(struct.error):
            effort_writer(['a', 'b']).write(row)
    for count in (2, 4):
        with pytest.raises(ValueError, match='shape'):
            TrajectoryWriter(['a', 'b'], 1, 3).write(0, [([1.0, 2.0],) * 3] * count)


def test_the_stamp_at_the_beginning() -> None:
    """As ROS writes it; refused where there is none, or no time."""
    for sec, nanosec, t in ((0, 0, 0), (3, 999_999_999, 3_999_999_999), (3, 10 ** 9, None),
                            (-1, 0, None), (2 ** 31 - 1, 0, None)):
        message = Time(sec=sec, nanosec=nanosec)
        for data in (serialize_message(Clock(clock=message)),
                     serialize_message(JointState(header=Header(stamp=message)))):
            if t is None:
                with pytest.raises(CtcError, match=f'{sec} s and {nanosec} ns are not a time'):
                    read_stamp(data)
            else:
                assert read_stamp(data) == t
            for wrong in (data[:11], b'\0\2' + data[2:]):
                with pytest.raises((LookupError, struct.error)):
                    read_stamp(wrong)


def test_a_trajectory_that_is_sent() -> None:
    points: list[Point] = [([1.5 + k] * 3, [0.1 * k] * 3, [1.5 - k] * 3) for k in range(25)]
    writer = TrajectoryWriter(('x', 'yy', 'zzz'), 700_000_000, len(points))
    writer.write(5, [([0.0] * 3,) * 3] * len(points))
    data = writer.write(3_200_000_001, points)
    message = deserialize_message(data, JointTrajectory)
    assert len(data) == len(chunk(message.joint_names, [(point, 0, 0) for point in points]))
    assert tuple(message.joint_names) == ('x', 'yy', 'zzz')
    assert ns(message.header.stamp) == 3_200_000_001
    assert [(ns(x.time_from_start), bits(x.positions), bits(x.velocities),
             bits(x.accelerations)) for x in message.points] == [
        (700_000_000 * k, *map(bits, point)) for k, point in enumerate(points)]
    for t in (0, -1, 1_234_567_890_123_456_789, -5 * 10 ** 9):
        assert ns(stamp(t)) == nanoseconds(stamp(t)) == t
