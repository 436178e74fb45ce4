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

"""
Which topics of a bag have joint states or commanded torques, and their values as arrays.

A topic may be followed by a field: `/NAME/robot_state:desired_joint_state.effort`. Without one,
the fields of known types are taken.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from typing import Any, NamedTuple

from ctc_chattering.bags.bag_reader import BagReader
from ctc_chattering.bags.cdr_columns import blocks, field_names, Floats, NAMES
from ctc_chattering.bags.storage import Connection
from ctc_chattering.errors import CtcError, near, shortened
from ctc_chattering.numerics.time_grid import NANOSECONDS
import numpy as np
import numpy.typing as npt

JOINT_STATE, MULTI_ARRAY = 'sensor_msgs/msg/JointState', 'std_msgs/msg/Float64MultiArray'
_TRAJECTORY_STATE = 'control_msgs/msg/JointTrajectoryControllerState'
_FRANKA_STATE = 'franka_msgs/msg/FrankaRobotState'
_STAMP = ('header.stamp.sec', 'header.stamp.nanosec')
#: Position, velocity and effort of the types that have joint states.
STATE_FIELDS: dict[str, tuple[str, ...]] = {
    JOINT_STATE: ('position', 'velocity', 'effort'),
    _TRAJECTORY_STATE: tuple(f'feedback.{x}' for x in ('positions', 'velocities', 'effort')),
    _FRANKA_STATE: tuple(f'measured_joint_state.{x}' for x in ('position', 'velocity', 'effort')),
}
#: Torque of the types that have commands.
COMMAND_FIELDS: dict[str, tuple[str, ...]] = {
    MULTI_ARRAY: ('data',),
    _TRAJECTORY_STATE: ('output.effort',),
    _FRANKA_STATE: ('desired_joint_state.effort',),
    JOINT_STATE: ('effort',),
}
_OR_FIELD = ', or --commands TOPIC:FIELD'
#: What a name says of values that are no commanded torques.
_OTHERS = ('position', 'velocity', 'acceleration', 'external', 'gripper', 'measured')


class SignalTopic(NamedTuple):
    """A topic of one type, with the fields to read, of which the first must be there."""

    name: str
    kind: str
    fields: tuple[str, ...]
    connections: tuple[Connection, ...]

    @property
    def messages(self) -> int:
        """Return the number of messages."""
        return sum(x.msgcount for x in self.connections)

    @property
    def is_late(self) -> bool:
        """Return whether a torque in it, reported by the robot, was in force before."""
        return self.kind != _TRAJECTORY_STATE and 'State' in self.kind

    def __str__(self) -> str:
        """Return name, type and number of messages."""
        return f'{self.name} ({self.kind}, {self.messages} messages)'


@dataclasses.dataclass
class Signal:
    """
    The values of a topic; N messages, n joints.

    Attributes
    ----------
    logged, stamps : ndarray of int, shape (N,)
        When they were recorded, and their stamps, 0 without [ns].
    values : tuple of ndarray, shape (N, n)
        One for each field, nan where it is missing.

    """

    logged: npt.NDArray[np.int64]
    stamps: npt.NDArray[np.int64]
    values: tuple[Floats, ...]


class Signals:
    """
    The topics of an open bag that have numbers of joints.

    Parameters
    ----------
    reader : BagReader
        Open.
    path : object
        What errors say.

    """

    def __init__(self, reader: BagReader, path: object) -> None:
        self._reader, self._path = reader, path

    def topics(self, kinds: dict[str, tuple[str, ...]]) -> list[SignalTopic]:
        """Return the topics of some types that have messages."""
        found: dict[tuple[str, str], list[Connection]] = {}
        for x in self._reader.connections:
            if x.msgtype in kinds and x.msgcount:
                found.setdefault((x.topic, x.msgtype), []).append(x)
        return [SignalTopic(name, kind, kinds[kind], tuple(same))
                for (name, kind), same in sorted(found.items())]

    def named(self, text: str, option: str, kinds: dict[str, tuple[str, ...]]
              ) -> SignalTopic | None:
        """
        Return the topic that an option names, or None if there is none of this name.

        Raises
        ------
        CtcError
            If several topics have it, or its type is of no use.

        """
        name, _, field = text.partition(':')
        same = [x for x in self._reader.connections if x.msgcount and (
            x.topic == name or (not name.startswith('/') and x.topic.endswith('/' + name)))]
        if not same:
            return None
        found: dict[tuple[str, str], list[Connection]] = {}
        for x in same:
            if field or x.msgtype in kinds:
                found.setdefault((x.topic, x.msgtype), []).append(x)
        if not found:
            raise CtcError(
                f'{self._path}: {same[0].topic} is of type {same[0].msgtype}; allowed: '
                f'{", ".join(kinds)}{_OR_FIELD * (kinds is COMMAND_FIELDS)}')
        topics = [SignalTopic(a, kind, (field,) if field else kinds[kind], tuple(x))
                  for (a, kind), x in sorted(found.items())]
        if len(topics) > 1:
            raise CtcError(f'{self._path}: several topics: {", ".join(map(str, topics))}; name '
                           f'one: {option}')
        return topics[0]

    def missing(self, text: str, option: str, kinds: dict[str, tuple[str, ...]]) -> CtcError:
        """Return the error for a topic that is not in the bag."""
        name = text.partition(':')[0]
        known = [x.topic for x in self._reader.connections]
        fit = self.topics(kinds)
        said = f'; {option} may be: {", ".join(map(str, fit))}' if fit else (
            f'; no topic has a type that fits, such as {next(iter(kinds))}')
        return CtcError(f'{self._path}: no message on {name}{near(name, known)}{said}')

    def may_command(self, topic: SignalTopic, joints: Sequence[str], states: SignalTopic) -> bool:
        """Return whether a topic may have the commanded torques of some joints."""
        name = topic.name.lower()
        if any(x in name for x in _OTHERS) or (
                topic.kind == JOINT_STATE and not ('desired' in name or 'command' in name)):
            return False
        if topic.name == states.name and topic.kind == JOINT_STATE:
            return False
        names, count = self.names(topic)
        return count == len(names or joints) and (not names or set(joints) <= set(names))

    def names(self, topic: SignalTopic) -> tuple[tuple[str, ...], int]:
        """Return the joint names in the first message, or none, and the number of values."""
        definitions = self._reader.definitions(topic.connections[0])
        field = topic.fields[0]
        for _, _, data in self._reader.messages(topic.connections):
            for block in blocks([data], topic.kind, definitions, topic.fields):
                if field in block.numbers:
                    return _names_of(field, block.names), block.numbers[field].shape[1]
            known = field_names(data, topic.kind, definitions)
            if field not in STATE_FIELDS.get(topic.kind, ()) + COMMAND_FIELDS.get(topic.kind, ()):
                raise CtcError(f'{self._path}: {topic.name} has no numbers in {field}; it has in: '
                               f'{", ".join(known)}{near(field, known)}')
            break
        return (), 0

    def all_names(self, topic: SignalTopic) -> list[str]:
        """Return all joint names on a topic."""
        found: set[str] = set()
        for block in self._blocks(topic, topic.fields):
            found.update(_names_of(topic.fields[0], block.names))
        return sorted(found)

    def read(self, topic: SignalTopic, joints: Sequence[str]) -> Signal:
        """
        Return the values of some joints; messages without them are left out.

        Raises
        ------
        CtcError
            If messages have some of the joints only.

        """
        count, wanted = topic.messages, set(joints)
        found = Signal(np.zeros(count, np.int64), np.zeros(count, np.int64), ())
        kept = np.zeros(count, bool)
        for block in self._blocks(topic, (*topic.fields, *_STAMP), found.logged):
            names = _names_of(topic.fields[0], block.names)
            if names and not wanted <= set(names):
                if wanted & set(names):
                    raise CtcError(
                        f'{self._path}: {topic.name} has the joints {shortened(names)}; needed: '
                        f'each of {shortened(joints)}')
                continue
            if not found.values:
                found.values = tuple(np.full((count, len(joints)), np.nan) for _ in topic.fields)
            order = [names.index(x) for x in joints] if names else list(range(len(joints)))
            width = len(names) or len(joints)
            for field, values in zip(topic.fields, found.values):
                numbers = block.numbers.get(field)
                if numbers is not None and numbers.shape[1] == width:
                    values[block.place] = numbers[:, order]
            if all(x in block.numbers for x in _STAMP):
                sec, nanosec = (block.numbers[x][:, 0].astype(np.int64) for x in _STAMP)
                found.stamps[block.place] = sec * NANOSECONDS + nanosec
            kept[block.place] = True
        if kept.all() and count:
            return found
        if not kept.any():
            return Signal(found.logged[:0], found.stamps[:0],
                          tuple(np.empty((0, len(joints))) for _ in topic.fields))
        return Signal(found.logged[kept], found.stamps[kept],
                      tuple(x[kept] for x in found.values))

    def _blocks(self, topic: SignalTopic, fields: Sequence[str],
                logged: npt.NDArray[np.int64] | None = None) -> Iterator[Any]:
        """Yield the blocks of a topic, and note when its messages were recorded [ns]."""
        def messages() -> Iterator[bytes]:
            for number, (_, t, data) in enumerate(self._reader.messages(topic.connections)):
                if logged is not None:
                    logged[number] = t
                yield data
        definitions = self._reader.definitions(topic.connections[0])
        return blocks(messages(), topic.kind, definitions, fields)


def _names_of(field: str, names: dict[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Return the names that stand beside a field, or above it; empty for none."""
    if field == 'data':
        return names.get('layout.dim.label', ())
    parent = field
    while parent:
        parent = parent.rpartition('.')[0]
        for name in NAMES:
            if found := names.get(f'{parent}.{name}' if parent else name):
                return found
    return ()
