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

"""What we read and write against the (de)serialization of ROS."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Sequence
import itertools
import math
import os
import random
import struct
import subprocess
import sys
from typing import Any

from bags import Cdr, chunk, efforts, state
from builtin_interfaces.msg import Time
from ctc_chattering.errors import CtcError
from ctc_chattering.ros.messages import (
    effort_writer,
    joint_state,
    message_type,
    Point,
    read_chunk,
    read_efforts,
    read_stamp,
    read_state,
    stamp,
    state_writer,
    trajectory,
)
from faults import KINDS, mutated
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

Answer = tuple[Any, ...]
#: By the number of joints; every remainder of the length of all names by 8 comes up.
NAMES = [tuple('j' * (1 + i + stretch) for i in range(n)) for n in (1, 2, 3, 7)
         for stretch in range(8)]
ODD = [math.inf, -math.inf, math.nan, -0.0, 0.0, 5e-324, -2.2e-308, 1.7e308]


def bits(row: Iterable[float]) -> bytes:
    return array('d', row).tobytes()


def ns(time: Any) -> int:
    return int(time.sec) * 10 ** 9 + int(time.nanosec)


def state_by_ros(data: bytes) -> Answer:
    m = deserialize_message(data, JointState)
    return ns(m.header.stamp), tuple(m.name), *map(bits, (m.position, m.velocity, m.effort))


def state_by_us(data: bytes) -> Answer:
    s = read_state(data)
    return s.t, s.names, bits(s.position), bits(s.velocity), bits(s.effort)


def efforts_by_ros(data: bytes) -> Answer:
    m = deserialize_message(data, Float64MultiArray)
    return tuple(x.label for x in m.layout.dim), bits(m.data)


def efforts_by_us(data: bytes) -> Answer:
    e = read_efforts(data)
    return e.names, bits(e.values)


def chunk_by_ros(data: bytes) -> Answer:
    m = deserialize_message(data, JointTrajectory)
    return tuple(m.joint_names), [
        (ns(m.header.stamp) + ns(p.time_from_start), bits(p.positions), bits(p.velocities),
         bits(p.accelerations)) for p in m.points]


def chunk_by_us(data: bytes) -> Answer:
    p = read_chunk(data)
    return p.names, [(t, *map(bits, rows)) for t, rows in zip(p.times, p.points, strict=True)]


Kind = tuple[Callable[[bytes], Answer], Callable[[bytes], Answer]]
STATE: Kind = state_by_us, state_by_ros
EFFORTS: Kind = efforts_by_us, efforts_by_ros
CHUNK: Kind = chunk_by_us, chunk_by_ros


def samples(names: Sequence[str], shift: float, count: int = 3) -> list[tuple[Kind, bytes]]:
    """Return a message of each kind; all of one `names` and `count` differ in numbers only."""
    rows = [[shift + i + 10.0 * k for i in range(len(names))] for k in range(3)]
    points, stamp = [((*rows, []), k // 2, k) for k in range(count)], (int(shift) - 5, int(shift))
    return [(STATE, state(names, rows, stamp)), (EFFORTS, efforts(names, rows[0])),
            (EFFORTS, efforts([], rows[0])), (CHUNK, chunk(names, points, stamp))]


@pytest.mark.parametrize('frame', ['', 'x', 'base', 'base_link'])
@pytest.mark.parametrize('names', NAMES)
def test_what_ros_serializes(names: tuple[str, ...], frame: str) -> None:
    """Check 4 messages of each kind as ROS writes them, odd numbers in the third."""
    n = len(names)
    for k in range(4):
        rows = [array('d', [ODD[(i + j) % 8] if k == 2 else i + j / 7 for i in range(n)])
                for j in range(3)]
        message = JointState(name=names, position=rows[0], velocity=rows[1], effort=rows[2])
        message.header.frame_id = frame
        message.header.stamp = stamp(-1 + k * 10 ** 9)
        data = serialize_message(message)
        assert state_by_us(data) == state_by_ros(data)
        command = Float64MultiArray(data=rows[0])
        command.layout.dim = [MultiArrayDimension(label=x) for x in names]
        data = serialize_message(command)
        assert efforts_by_us(data) == efforts_by_ros(data)
        motion = JointTrajectory(header=message.header, joint_names=names, points=[
            JointTrajectoryPoint(positions=rows[0], velocities=rows[1], accelerations=rows[2])
            for _ in range(1 + k % 2)])
        data = serialize_message(motion)
        assert chunk_by_us(data) == chunk_by_ros(data)


doubles = st.floats() | st.sampled_from(ODD) | st.just(1.0)
pools = st.sampled_from([(), ('a',), ('b',), ('a', 'bc'), ('bc', 'a'), ('a', 'b', 'cdefg')])
orders = st.sampled_from('<<<<>')
stamps = st.tuples(st.integers(-2 ** 31, 2 ** 31 - 1), st.sampled_from([0, 999_999_999]))
frames = st.sampled_from(['', 'abc', 'abcd'])


def rows_of(n: int, count: int) -> st.SearchStrategy[list[list[float]]]:
    """Return rows of n numbers, now and then of another length."""
    size = st.sampled_from([n] * 8 + [0, 1, 2, 3])
    row = size.flatmap(lambda k: st.lists(doubles, min_size=k, max_size=k))
    return st.lists(row, min_size=count, max_size=count)


@st.composite
def any_state(draw: Any) -> bytes:
    names = draw(pools)
    return state(names, draw(rows_of(len(names), 3)), draw(stamps), draw(frames), draw(orders))


@st.composite
def any_efforts(draw: Any) -> bytes:
    names = draw(pools)
    return efforts(names, draw(rows_of(len(names), 1))[0], draw(orders))


@st.composite
def any_piece(draw: Any) -> bytes:
    names = draw(pools)
    effort = st.sampled_from([[]] * 8 + [[1.0] * len(names)])
    points = draw(st.lists(st.tuples(
        st.tuples(rows_of(len(names), 3), effort).map(lambda x: [*x[0], x[1]]),
        st.integers(-3, 2 ** 31 - 1), st.integers(0, 2 ** 32 - 1)), max_size=4))
    return chunk(names, points, draw(stamps), draw(frames), draw(orders))


@pytest.mark.parametrize(('kind', 'messages'), [
    (STATE, any_state()), (EFFORTS, any_efforts()), (CHUNK, any_piece())])
def test_any_message(kind: Kind, messages: st.SearchStrategy[bytes]) -> None:
    """Check that we read what ROS reads."""
    ours, theirs = kind

    @settings(max_examples=200)
    @given(messages)
    def check(data: bytes) -> None:
        assert ours(data) == theirs(data)
    check()


def attempt(read: Callable[[bytes], Answer], data: bytes) -> Answer | None:
    """Return what is read; None if it is refused by rclpy or by us."""
    try:
        return read(data)
    except RuntimeError as error:
        assert 'deserialize' in str(error)
    except CtcError as error:
        assert len(str(error).splitlines()) == 1
    return None


@pytest.mark.parametrize('index', range(4))
def test_damaged_messages(index: int) -> None:
    """
    Check that a part of a message never passes for a whole one.

    rclpy takes a row of a `JointTrajectory` that is cut off at its count for an empty one.
    """
    (ours, theirs), data = samples(('a', 'bcd'), 1.0)[index]
    for bad in (*(data[:end] for end in range(len(data))), os.urandom(3), b'\xff' * len(data)):
        expected = attempt(theirs, bad)
        assert attempt(ours, bad) is None
        assert expected is None or (index == 3 and b'' in expected[1][-1])
    assert ours(data) == theirs(data)


#: Reads mutated messages of one kind in a process with limited memory; prints how many were read.
FUZZ = """
import random, resource, sys
from faults import KINDS, mutated
from ctc_chattering.ros.topics import COMMANDS, JOINT_STATES, REFERENCE
from ctc_chattering.ros import messages
kind, dice, count = KINDS[sys.argv[1]], random.Random(1), 0
read = {JOINT_STATES: messages.read_state, COMMANDS: messages.read_efforts,
        REFERENCE: messages.read_chunk}.get(kind.topic, messages.read_stamp)
read(kind.valid)
size = int(open('/proc/self/statm').read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (size + 2 ** 27, size + 2 ** 27))
for i in range(4000):
    data = mutated(kind, dice) if i % 4 else kind.make(dice)
    try:
        read(data)
        count += 1
    except MemoryError:
        raise
    except Exception:
        pass
print(count)
"""


@pytest.mark.parametrize('topic', KINDS)
def test_thousands_of_mutated_messages_do_no_harm(topic: str) -> None:
    """Check that there is no crash, no need for memory, and no word of ROS's own about them."""
    done = subprocess.run(
        [sys.executable, '-c', FUZZ, topic], capture_output=True, text=True, check=False,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(x for x in sys.path if x)})
    assert (done.returncode, done.stderr) == (0, '')
    assert 1000 < int(done.stdout) < 9000


@pytest.mark.parametrize('index', range(3))
def test_what_is_read_of_a_mutated_message_is_what_ros_reads(
        index: int, capfd: pytest.CaptureFixture[str]) -> None:
    """Check that we refuse what ROS reads only where it complains, or takes it for no CDR."""
    ours, theirs = (STATE, EFFORTS, CHUNK)[index]
    dice = random.Random(index)
    for _ in range(1000):
        data = mutated(list(KINDS.values())[index], dice)
        expected = attempt(theirs, data)
        complaint = capfd.readouterr().err
        found = attempt(ours, data)
        if complaint or data[:2] not in (b'\0\0', b'\0\1'):
            assert found is None
        else:
            assert found == expected
        assert capfd.readouterr().err == ''


@pytest.mark.parametrize('index', range(4))
@pytest.mark.parametrize('extra', [4, 8, 16])
def test_bytes_behind_a_message(index: int, extra: int) -> None:
    """Check that what rclpy passes over at the end is not taken for numbers."""
    for names in (('a',), ('a', 'bcd')):
        ours, theirs = samples(names, 0.0)[index][0]
        for tail, x in itertools.product((bytes(extra), b'\xff' * extra, b''), (0.0, 1.0, 2.0)):
            data = samples(names, x, 1)[index][1] + tail
            assert ours(data) == theirs(data)


@pytest.mark.parametrize('names', NAMES)
def test_states_that_are_sent(names: tuple[str, ...]) -> None:
    """Check what ROS reads from them, odd numbers and negative stamps included."""
    n = len(names)
    fields = ('position', 'velocity', 'effort')
    for chosen in (fields, ('velocity',), ('position', 'velocity'), ('effort',)):
        for k, t in enumerate((0, 1, -1, -7 * 10 ** 9 + 5, 2 ** 31 * 10 ** 9 - 1)):
            rows = [[(ODD * 2)[k + i] + j for i in range(n)] for j in range(3)]
            by_field = dict(zip(chosen, rows))
            expected = [bits(by_field.get(field, [])) for field in fields]
            data = serialize_message(joint_state(t, names, **by_field))
            assert state_by_ros(data) == state_by_us(data) == (t, names, *expected)
            if chosen == fields:
                assert state_by_ros(state_writer(names).write(*rows, t=t)) == (
                    t, names, *expected)
            data = effort_writer(names).write(rows[0])
            assert efforts_by_ros(data) == efforts_by_us(data) == (names, bits(rows[0]))


def test_every_byte_of_a_writer() -> None:
    for names in NAMES:
        row = [1.5] * len(names)
        assert state_writer(names).write(row, row, row, t=3 * 10 ** 9 + 4) == state(
            names, [row] * 3, (3, 4))
        assert effort_writer(names).write(row) == efforts(names, row)


def test_writers_take_no_other_number_of_joints() -> None:
    for row in ([], [1.0], [1.0, 2.0, 3.0]):
        with pytest.raises(struct.error):
            effort_writer(['a', 'b']).write(row)


@pytest.mark.parametrize('index', range(4))
def test_padding_may_be_any_bytes(index: int, monkeypatch: pytest.MonkeyPatch) -> None:
    names = ('a', 'bc', 'defg')
    (ours, theirs), data = samples(names, 1.0)[index]
    expected = ours(data)
    monkeypatch.setattr(Cdr, 'padding', b'\xff')
    padded = samples(names, 1.0)[index][1]
    assert padded != data
    assert ours(padded) == theirs(padded) == expected


def test_the_stamp_at_the_beginning() -> None:
    """As ROS writes it; refused where there is none, or no time."""
    for sec, nanosec, t in ((0, 0, 0), (3, 999_999_999, 3_999_999_999), (3, 10 ** 9, None),
                            (-1, 0, None), (2 ** 31 - 1, 0, None)):
        message = Time(sec=sec, nanosec=nanosec)
        for data in (serialize_message(Clock(clock=message)),
                     serialize_message(JointState(header=Header(stamp=message)))):
            if t is None:
                with pytest.raises(CtcError, match=f'{sec} s and {nanosec} ns are no time'):
                    read_stamp(data)
            else:
                assert read_stamp(data) == t
            with pytest.raises(CtcError, match='incomplete'):
                read_stamp(data[:11])


def test_stamp_and_message_type() -> None:
    """Check a stamp, and a class by its name."""
    for t in (0, -1, 1_234_567_890_123_456_789, -5 * 10 ** 9):
        assert ns(stamp(t)) == t
    assert message_type('sensor_msgs/msg/JointState') is JointState


@pytest.mark.parametrize('names', [('a',), ('joint1', 'joint2'), ('x', 'yy', 'zzz', 'wwww')])
@pytest.mark.parametrize('count', [1, 2, 25])
def test_a_trajectory_that_is_sent(names: tuple[str, ...], count: int) -> None:
    n = len(names)
    for shift in (0.0, 1.5):
        points: list[Point] = [
            ([shift + k] * n, [shift + 0.1 * k] * n, [shift - k] * n) for k in range(count)]
        data = serialize_message(trajectory(names, 3_200_000_001, 700_000_000, points))
        assert chunk_by_us(data) == chunk_by_ros(data) == (names, [
            (3_200_000_001 + 700_000_000 * k, *map(bits, point))
            for k, point in enumerate(points)])
