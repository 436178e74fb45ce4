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
The numbers of joints in the topics of a bag, as arrays: joint states and commanded torques.

A topic may be followed by a field: `/NAME/robot_state:desired_joint_state.effort`. Without one,
the fields of known types are taken.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
import dataclasses
from functools import cache
from operator import attrgetter
from typing import Any, NamedTuple

from ctc_chattering.bags.bag import Bag, nanoseconds
from ctc_chattering.errors import CtcError, near
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt
from rosbags.interfaces import Connection

JOINT_STATE, MULTI_ARRAY = 'sensor_msgs/msg/JointState', 'std_msgs/msg/Float64MultiArray'
TRAJECTORY_STATE = 'control_msgs/msg/JointTrajectoryControllerState'
_FRANKA_STATE = 'franka_msgs/msg/FrankaRobotState'
#: Fields of strings that name joints, as messages call them.
_NAMES = ('name', 'names', 'joint_names', 'dof_names', 'label')
#: Position, velocity and effort of the types that have joint states.
STATE_FIELDS: dict[str, tuple[str, ...]] = {
    JOINT_STATE: ('position', 'velocity', 'effort'),
    TRAJECTORY_STATE: tuple(f'feedback.{x}' for x in ('positions', 'velocities', 'effort')),
    _FRANKA_STATE: tuple(f'measured_joint_state.{x}' for x in ('position', 'velocity', 'effort')),
}
#: Torque of the types that have commands.
COMMAND_FIELDS: dict[str, tuple[str, ...]] = {
    MULTI_ARRAY: ('data',),
    TRAJECTORY_STATE: ('output.effort',),
    _FRANKA_STATE: ('desired_joint_state.effort',),
    JOINT_STATE: ('effort',),
}
_OR_FIELD = ', or --commands TOPIC:FIELD'


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

    def where(self, known: Any) -> Signal:
        """Return the messages that an index or a mask has."""
        return Signal(self.logged[known], self.stamps[known], tuple(x[known] for x in self.values))


class SignalTopic(NamedTuple):
    """A topic of one type in an open bag, with the fields to read; the first must be there."""

    bag: Bag
    name: str
    kind: str
    fields: tuple[str, ...]
    connections: tuple[Connection, ...]

    @property
    def is_late(self) -> bool:
        """Return whether a torque in it, reported by the robot, was in force before."""
        return self.kind != TRAJECTORY_STATE and 'State' in self.kind

    def __str__(self) -> str:
        """Return name, type and number of messages."""
        return f'{self.name} ({self.kind}, {sum(x.msgcount for x in self.connections)} messages)'

    def names(self) -> tuple[tuple[str, ...], int]:
        """Return the joint names in the first message, or none, and the number of values."""
        field = self.fields[0]
        for _, message in self.bag.read(self.connections):
            values = _numbers(message, field)
            if values is not None:
                return _names_of(message, field), len(values)
            if field not in STATE_FIELDS.get(self.kind, ()) + COMMAND_FIELDS.get(self.kind, ()):
                known = list(_number_fields(message))
                raise CtcError(f'{self.bag.path}: {self.name} has no numbers in {field}; it has '
                               f'in: {", ".join(known)}{near(field, known)}')
            break
        return (), 0

    def all_names(self) -> list[str]:
        """Return all joint names on a topic."""
        return sorted({name for _, message in self.bag.read(self.connections)
                       for name in _names_of(message, self.fields[0])})

    def read(self, joints: Sequence[str]) -> Signal:
        """Return the values of some joints; messages without each of them are left out."""
        joints = tuple(joints)
        logged, stamps = array('q'), array('q')
        columns = [array('d') for _ in self.fields]
        unknown = np.full(len(joints), np.nan)

        @cache
        def order(names: tuple[str, ...]) -> slice | list[int] | None:
            """Return where the joints are among some names; None if they are not there once."""
            if not names or names == joints:
                return slice(None)
            is_there = set(joints) <= set(names) and len(set(names)) == len(names)
            return [names.index(x) for x in joints] if is_there else None
        for t, message in self.bag.read(self.connections):
            names = _names_of(message, self.fields[0])
            rows = [_numbers(message, field) for field in self.fields]
            picked = order(names)
            if rows[0] is None or picked is None:
                continue
            width = len(names or joints)
            for column, row in zip(columns, rows):
                column.frombytes((
                    unknown if row is None or len(row) != width else row[picked]).tobytes())
            stamp = getattr(getattr(message, 'header', None), 'stamp', None)
            stamps.append(nanoseconds(stamp) if stamp else 0)
            logged.append(t)
        return Signal(np.array(logged), np.array(stamps), tuple(
            np.array(x).reshape(-1, len(joints)) for x in columns))


def signal_topics(bag: Bag, connections: Iterable[Connection],
                  kinds: Mapping[str, tuple[str, ...]], field: str = '') -> list[SignalTopic]:
    """Return the topics that have messages of some types, or, with a `field`, of any type."""
    found: dict[tuple[str, str], list[Connection]] = {}
    for x in connections:
        if x.msgcount and (field or x.msgtype in kinds):
            found.setdefault((x.topic, x.msgtype), []).append(x)
    return [SignalTopic(bag, name, kind, (field,) if field else kinds[kind], tuple(same))
            for (name, kind), same in sorted(found.items())]


def named_topic(bag: Bag, text: str, option: str, kinds: dict[str, tuple[str, ...]]
                ) -> SignalTopic | None:
    """
    Return the topic that an option names, or None if there is none of this name.

    Raises
    ------
    CtcError
        If several topics have it, or its type is of no use.

    """
    name, _, field = text.partition(':')
    same = [x for x in bag.named(name) if x.msgcount]
    found = signal_topics(bag, same, kinds, field)
    if same and not found:
        raise CtcError(f'{bag.path}: {same[0].topic} is of type {same[0].msgtype}; allowed: '
                       f'{", ".join(kinds)}{_OR_FIELD * (kinds is COMMAND_FIELDS)}')
    if len(found) > 1:
        raise CtcError(f'{bag.path}: several topics: {", ".join(map(str, found))}; name one: '
                       f'{option}')
    return found[0] if found else None


def missing_topic(bag: Bag, text: str, option: str, kinds: dict[str, tuple[str, ...]]
                  ) -> CtcError:
    """Return the error for a topic that is not in the bag."""
    name = text.partition(':')[0]
    fit = signal_topics(bag, bag.connections, kinds)
    said = f'; {option} may be: {", ".join(map(str, fit))}' if fit else (
        f'; no topic has a type that fits, such as {next(iter(kinds))}')
    return CtcError(f'{bag.path}: no message on {name}'
                    f'{near(name, [x.topic for x in bag.connections])}{said}')


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
