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

"""Help for tests that inject faults: diagnostics, malformed messages, and load."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import math
from pathlib import Path
import random
import struct
import subprocess
import sys
from typing import Any, NamedTuple

from bags import chunk, efforts, state
from ctc_chattering.configuration.topics import (
    CLOCK,
    COMMANDS,
    DIAGNOSTICS,
    JOINT_STATES,
    REFERENCE,
)
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from processes import CONFIG, descendants, Probe, wait_for
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR
JOINTS = ('joint1', 'joint2')
#: Report on a topic with several publishers, between its name and theirs.
CONTESTED = 'has several publishers; messages from all of them are ignored'


class Report(NamedTuple):
    """The last diagnostics of a node."""

    level: bytes
    message: str
    values: dict[str, str]
    #: Time on the node's clock [ns].
    stamp: int = 0

    def count(self, key: str) -> int:
        """Return a count; 0 if it is not there."""
        return int(self.values.get(key, 0))

    def refused(self, topic: str) -> dict[str, int]:
        """Return how many messages of a topic were refused, by kind."""
        head = f'{topic}: refused, '
        return {key.removeprefix(head): int(value) for key, value in self.values.items()
                if key.startswith(head)}


class Diagnostics:
    """The latest reports of all nodes, by name without the slash."""

    def __init__(self, it: Probe) -> None:
        self._probe = it
        self.latest: dict[str, Report] = {}
        it.node.create_subscription(DiagnosticArray, DIAGNOSTICS, self._on_message, 100)

    def _on_message(self, message: DiagnosticArray) -> None:
        stamp = message.header.stamp
        for status in message.status:
            self.latest[status.name.removeprefix('/')] = Report(
                status.level, status.message, {x.key: x.value for x in status.values},
                stamp.sec * 10 ** 9 + stamp.nanosec)

    def until(self, node: str, done: Callable[[Report], Any], what: str) -> Report:
        """Wait for a report of a node that comes from now on and of which `done` is true."""
        self.latest.pop(node, None)
        self._probe.until(lambda: node in self.latest and done(self.latest[node]),
                          f'{what} of {node}')
        return self.latest[node]

    def next(self, node: str) -> Report:  # noqa: A003
        """Wait for the next report of a node."""
        return self.until(node, lambda _: True, 'a report')


class Kind(NamedTuple):
    """A topic with its type, a valid message, and a maker of messages that may be wrong."""

    topic: str
    type: Any  # noqa: A003
    valid: bytes
    make: Callable[[random.Random], bytes]


NUMBERS = (0.0, 1.0, -1.0, 1e308, -1e308, 5e-324, math.nan, math.inf, -math.inf)
NAMES = ((), ('joint1',), JOINTS, ('joint2', 'joint1'), ('joint1', 'joint1'), ('', ''),
         ('a', 'b'), ('joint1', 'joint2', 'joint2'), ('joint1', 'joint2', 'x'), ('\u00fc' * 50,))
_SECONDS = (0, 1, -1, 3, 5, 10 ** 9, 2 ** 31 - 1, -2 ** 31)
_NANOSECONDS = (0, 1, 999_999_999, 10 ** 9, 2 ** 32 - 1)


def _row(dice: random.Random, n: int) -> list[float]:
    length = dice.choice([n, n, n, 0, n + 1, max(0, n - 1), 7])
    return [dice.choice(NUMBERS) for _ in range(length)]


def _stamp(dice: random.Random) -> tuple[int, int]:
    return dice.choice(_SECONDS), dice.choice(_NANOSECONDS)


def _state(dice: random.Random) -> bytes:
    names = dice.choice(NAMES)
    return state(names, [_row(dice, len(names)) for _ in range(3)], _stamp(dice))


def _efforts(dice: random.Random) -> bytes:
    names = dice.choice(NAMES)
    return efforts(names, _row(dice, len(names)))


def _piece(dice: random.Random) -> bytes:
    names = dice.choice(NAMES)
    return chunk(names, [
        ([_row(dice, len(names)) for _ in range(3)], *_stamp(dice))
        for _ in range(dice.randrange(4))], _stamp(dice))


def _clock(dice: random.Random) -> bytes:
    return clock(*_stamp(dice))


def clock(sec: int, nanosec: int) -> bytes:
    """Return a serialized `Clock`."""
    return struct.pack('<4siI', b'\0\1\0\0', sec, nanosec)


#: Late, so that nothing that is made of a valid message replaces what comes before.
_LATE = 10 ** 9, 4
_ROWS = [[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]]
KINDS = {kind.topic: kind for kind in (
    Kind(JOINT_STATES, JointState, state(JOINTS, _ROWS, _LATE), _state),
    Kind(COMMANDS, Float64MultiArray, efforts(JOINTS[::-1], _ROWS[0]), _efforts),
    Kind(REFERENCE, JointTrajectory, chunk(
        JOINTS, [(_ROWS, 0, 1_000_000 * k) for k in range(4)], _LATE), _piece),
    Kind(CLOCK, Clock, clock(*_LATE), _clock))}


def mutated(kind: Kind, dice: random.Random) -> bytes:
    """Return random bytes, or a valid message cut off, with wrong bits or with wrong words."""
    data = bytearray(kind.valid)
    way = dice.randrange(5)
    if way == 0:
        return dice.randbytes(dice.randrange(len(data) + 1))  # No more than a Clock may have.
    if way == 1:
        return bytes(data[:dice.randrange(len(data))])
    if way == 2:
        for _ in range(dice.randint(1, 8)):
            data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
    elif way == 3:
        at = 4 * dice.randrange(len(data) // 4)
        data[at:at + 4] = struct.pack('<I', dice.choice((
            0, 1, 3, 5, 2 ** 20, 2 ** 24, 2 ** 31 - 1, 2 ** 32 - 1, dice.getrandbits(32))))
    else:
        data[4:] = dice.randbytes(len(data) - 4)
        for at in range(4, len(data) - 4, 4):
            if dice.random() < 0.3:
                data[at:at + 4] = struct.pack('<I', dice.randrange(9))
    return bytes(data)


def malformed(kind: Kind, count: int, seed: int = 1) -> list[bytes]:
    """
    Return messages of which hardly any is a good one, and many are no messages at all.

    They come in words of four bytes: the middleware fills up others, and a reader that gets an
    empty one hears no more of the writer.
    """
    dice = random.Random(seed)
    found = [kind.make(dice) if i % 2 else mutated(kind, dice) or bytes(4) for i in range(count)]
    return [data + bytes(-len(data) % 4) for data in found]


def nodes_of(pid: int) -> dict[str, int]:
    """Return the processes of the nodes that bringup has started, by name."""
    mark = 'ctc_chattering.cli.node '
    return {line.split(mark)[1].split()[0]: child for child, line in descendants(pid).items()
            if mark in line}


def endless(bag: Path) -> tuple[str, ...]:
    """Return arguments of a bringup that records until it is stopped, 100 samples a second."""
    return ('--params-file', str(CONFIG / 'friction.yaml'), '--pacing', 'real_time',
            '--duration', '0', '--record', str(bag), '--ros-args', '-p', 'control_period:=0.01')


def running(process: subprocess.Popen[str], bag: Path) -> dict[str, int]:
    """Wait until the nodes of a bringup run, and its recorder has samples; return their pids."""
    wait_for(lambda: len(nodes_of(process.pid)) == 4, 'the nodes')
    # Some samples: the recorder has been heard by all, and hears all.
    wait_for(lambda: sum(x.stat().st_size for x in bag.glob('*.mcap')) > 20_000, 'samples')
    return nodes_of(process.pid)


@contextmanager
def load(count: int = 4) -> Iterator[Sequence[subprocess.Popen[bytes]]]:
    """Keep the processors busy with so many processes."""
    busy = [subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(count)]
    try:
        yield busy
    finally:
        for process in busy:
            process.kill()
            process.wait()
