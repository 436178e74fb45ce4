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

from array import array
from collections.abc import Iterator, Sequence
import dataclasses
from functools import cache
from operator import attrgetter
from typing import Any, NamedTuple

from ctc_chattering.bags.bag import Bag
from ctc_chattering.errors import CtcError, near, shortened
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
import numpy as np
import numpy.typing as npt
from rosbags.interfaces import Connection

JOINT_STATE, MULTI_ARRAY = 'sensor_msgs/msg/JointState', 'std_msgs/msg/Float64MultiArray'
_TRAJECTORY_STATE = 'control_msgs/msg/JointTrajectoryControllerState'
_FRANKA_STATE = 'franka_msgs/msg/FrankaRobotState'
#: Fields of strings that name joints, as messages call them.
_NAMES = ('name', 'names', 'joint_names', 'dof_names', 'label')
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


class Signal(NamedTuple):
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
    values: tuple[Array, ...]


class Signals:
    """
    The topics of an open bag that have numbers of joints.

    Parameters
    ----------
    reader : Bag
        Open.
    path : object
        What errors say.

    """

    def __init__(self, reader: Bag, path: object) -> None:
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
        field = topic.fields[0]
        for _, message in self._messages(topic):
            values = _numbers(message, field)
            if values is not None:
                return _names_of(message, field), len(values)
            if field not in STATE_FIELDS.get(topic.kind, ()) + COMMAND_FIELDS.get(topic.kind, ()):
                known = list(_number_fields(message))
                raise CtcError(f'{self._path}: {topic.name} has no numbers in {field}; it has in: '
                               f'{", ".join(known)}{near(field, known)}')
            break
        return (), 0

    def all_names(self, topic: SignalTopic) -> list[str]:
        """Return all joint names on a topic."""
        found: set[str] = set()
        for _, message in self._messages(topic):
            found.update(_names_of(message, topic.fields[0]))
        return sorted(found)

    def read(self, topic: SignalTopic, joints: Sequence[str]) -> Signal:
        """
        Return the values of some joints; messages without them are left out.

        Raises
        ------
        CtcError
            If messages have some of the joints only.

        """
        joints = tuple(joints)
        logged, stamps = array('q'), array('q')
        columns = [array('d') for _ in topic.fields]
        unknown = np.full(len(joints), np.nan)

        @cache
        def order(names: tuple[str, ...]) -> slice | list[int] | None:
            """Return where the joints are among some names; None if they are not there."""
            if not names or names == joints:
                return slice(None)
            if set(joints) <= set(names):
                return [names.index(x) for x in joints]
            if set(joints) & set(names):
                raise CtcError(f'{self._path}: {topic.name} has the joints {shortened(names)}; '
                               f'needed: each of {shortened(joints)}')
            return None
        for t, message in self._messages(topic):
            names = _names_of(message, topic.fields[0])
            rows = [_numbers(message, field) for field in topic.fields]
            picked = order(names)
            if rows[0] is None or picked is None:
                continue
            width = len(names or joints)
            for column, row in zip(columns, rows):
                column.frombytes((
                    unknown if row is None or len(row) != width else row[picked]).tobytes())
            stamp = getattr(getattr(message, 'header', None), 'stamp', None)
            stamps.append(stamp.sec * NANOSECONDS + stamp.nanosec if stamp else 0)
            logged.append(t)
        return Signal(np.array(logged), np.array(stamps), tuple(
            np.array(x).reshape(-1, len(joints)) for x in columns))

    def _messages(self, topic: SignalTopic) -> Iterator[tuple[int, Any]]:
        """Yield log time [ns] and message of a topic, without those that cannot be decoded."""
        self._reader.check_type(topic.connections[0])
        for _, t, data in self._reader.messages(topic.connections):
            try:
                message = self._reader.deserialize(data, topic.kind)
            except Exception:  # Of arbitrary bytes, decoders raise arbitrary exceptions.
                continue
            yield t, message


def _value(message: Any, path: str) -> Any:
    """Return what is in a field, `a.b.c`; in one below a sequence, a list. None without it."""
    try:
        return attrgetter(path)(message)
    except AttributeError:
        found = [message]
        for name in path.split('.'):
            parts = [y for x in found for y in (x if isinstance(x, list) else [x])]
            found = [getattr(x, name) for x in parts if hasattr(x, name)]
        return found or None


def _numbers(message: Any, field: str) -> Array | None:
    """Return the numbers in a field, shape (n,); None without any."""
    value = _value(message, field)
    if value is None:
        return None
    try:
        found = np.hstack(value) if isinstance(value, list) else np.atleast_1d(value)
        return found.astype(float, copy=False) if len(found) else None
    except (TypeError, ValueError):
        return None


def _names_of(message: Any, field: str) -> tuple[str, ...]:
    """Return the names that stand beside a field, or above it; empty for none."""
    if field == 'data':
        return tuple(_value(message, 'layout.dim.label') or ())
    parent = field
    while parent:
        parent = parent.rpartition('.')[0]
        for name in _NAMES:
            found = _value(message, f'{parent}.{name}' if parent else name)
            if found:
                return (found,) if isinstance(found, str) else tuple(found)
    return ()


def _number_fields(message: Any) -> Iterator[str]:
    """Yield the fields of a message that have numbers."""
    for item in dataclasses.fields(message):
        value = getattr(message, item.name)
        first = value[0] if isinstance(value, list) and value else value
        if dataclasses.is_dataclass(first):
            yield from (f'{item.name}.{x}' for x in _number_fields(first))
        elif isinstance(first, (int, float, np.ndarray)):
            yield item.name
