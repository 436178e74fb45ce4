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

Commands have no stamps: which state one answers is found by the times at which a recorder received
both (`answers`). A controller answers each state once, after a time that changes little; what a
recorder adds to that is jitter. The stamps of the states show how unevenly the recorder received
them. In lockstep, where time goes as fast as the answers come, their order tells.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
import dataclasses
from functools import cache
from operator import attrgetter
from typing import Any, NamedTuple

from ctc_chattering.bags.bag import Bag, nanoseconds
from ctc_chattering.bags.recording import Indices
from ctc_chattering.errors import CtcError, near
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt
from rosbags.interfaces import Connection
from scipy.ndimage import median_filter  # type: ignore[import-untyped]

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


#: States over which the time between stamp and reception is taken.
_AROUND = 201
#: Part by which the time between states differs from that of their stamps in lockstep; commands
#: on each side over which their count is taken, and the part of those that are heard beside it
#: beyond which it is in doubt.
_PACED, _COUNTED, _DOUBTFUL = 0.02, 500, 0.2
#: Part of a period beyond which, from the usual time after a state, it is not sure which one is
#: answered; and part of the commands for which that does not matter.
_SURE, _NEGLIGIBLE = 0.35, 0.002
#: Least and most commands for each state that are answers to it, one for one.
_ANSWERS = (0.6, 1.45)
#: Length of the mean direction of the times after a state, on a circle, below which there is no
#: usual one.
_USUAL = 0.5
#: Periods after which a command is no longer held.
_HELD = 20


class Answers(NamedTuple):
    """
    Commands in the places of the states.

    Attributes
    ----------
    command : ndarray, shape (N, n)
        In force after each state [N·m], nan where it is unknown.
    late : tuple of (float, float)
        Samples by which they may be later than they stand here, at least and at most.
    own : ndarray of bool, shape (N,)
        Whether it answers this state, and not one before.

    """

    command: Array
    late: tuple[float, float]
    own: npt.NDArray[np.bool_]


def answers(values: Array, times: Indices, stamps: Indices, received: Indices) -> Answers:
    """
    Return the commands in the places of the states that they answer.

    Parameters
    ----------
    values : ndarray, shape (M, n)
        Commands [N·m].
    times : ndarray, shape (M,)
        At which they were received [ns].
    stamps, received : ndarray, shape (N,)
        Stamps of the states, and times at which they were received, in this order [ns].

    """
    if (np.diff(times) < 0).any():
        order = np.argsort(times, kind='stable')
        values, times = values[order], times[order]
    raw = np.searchsorted(received, times, side='right') - 1
    if not _in_real_time(stamps, received):
        return _counted(values, raw, stamps)
    if _twice(raw) <= _NEGLIGIBLE:
        return placed(values, raw, stamps, 0.0)
    ahead = (received - received[0]) - (stamps - stamps[0]).astype(float)
    expected = np.maximum.accumulate((stamps - stamps[0]) + median_filter(
        ahead, min(_AROUND, len(ahead)), mode='nearest'))
    period = max(float(np.median(np.diff(expected))), 1.0)
    at = (times - received[0]).astype(float)
    before = np.searchsorted(expected, at, side='right') - 1
    phase = (at - expected[np.maximum(before, 0)]) / period % 1.0
    mean = np.exp(2j * np.pi * phase).mean()
    ratio = len(times) / len(received)
    if abs(mean) >= _USUAL and _ANSWERS[0] < ratio < _ANSWERS[1]:
        usual = float(np.angle(mean) / (2.0 * np.pi)) % 1.0
        middle = at - (usual - 0.5) * period
        which = np.searchsorted(expected, middle) - 1
        after = (middle - expected[np.maximum(which, 0)]) / period
        unsure = float((np.abs((after % 1.0) - 0.5) > _SURE).mean())
        # What answers a state that is not in the recording is none to the one before it.
        which = np.where(after > 1.0, -1, which)
        return placed(values, _apart(which, after, len(received)), stamps, unsure)
    return _counted(values, raw, stamps)


def _in_real_time(stamps: Indices, received: Indices) -> bool:
    """Return whether states are received as fast as their stamps go on."""
    wall, theirs = (np.diff(x[::_AROUND].astype(float)) for x in (received, stamps))
    return not len(wall) or bool(
        np.median(np.abs(wall - theirs)) <= _PACED * np.median(np.abs(theirs)))


def _counted(values: Array, raw: Indices, stamps: Indices) -> Answers:
    """
    Return commands by their order, as in lockstep, where each state follows an answer.

    So it does not matter how long these take. What a recorder hears too late, or not at all,
    moves one by the median over those around it.
    """
    numbers = _sample_numbers(stamps)
    count = np.arange(len(raw))
    ahead = np.where(raw < 0, -1, numbers[np.maximum(raw, 0)]) - count
    ends = tuple(int(np.median(x)) for x in (ahead[:_AROUND], ahead[-_AROUND:]))
    usual = median_filter(np.pad(ahead, _COUNTED, constant_values=ends), 2 * _COUNTED + 1
                          )[_COUNTED:-_COUNTED]
    place = count + usual
    which = np.searchsorted(numbers, place)
    lost = (place < 0) | (numbers[np.minimum(which, len(numbers) - 1)] != place)
    beside = [float((x > 0).mean()) for x in (usual - ahead, ahead - usual)]
    # Where commands are missing, it is not sure which ones.
    unsure = sum(beside) if np.ptp(usual) else 0.0
    before, after = (1.0 if x > _DOUBTFUL else unsure for x in beside)
    return placed(values, np.where(lost, -1, which), stamps, before, after)


def _sample_numbers(stamps: Indices) -> Indices:
    """Return the number of each state, counting those that were not recorded."""
    step = np.diff(stamps)
    period = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    found: Indices = np.concatenate(([0], np.cumsum(np.clip(np.rint(step / period), 1, _HELD))
                                     )).astype(int)
    return found


def _twice(which: Indices) -> float:
    """Return for which part of all commands there is another one in their place."""
    return float((np.diff(which) == 0).mean()) if len(which) > 1 else 0.0


def _apart(which: Indices, after: Array, count: int) -> Indices:
    """Return the places of commands, those of two in one place moved to a free one beside it."""
    found: Indices = which.copy()
    taken = np.bincount(found[found >= 0], minlength=count + 1)
    for k in np.flatnonzero((np.diff(which) == 0) & (which[1:] >= 0)).tolist():
        place = int(which[k])
        first = after[k] + after[k + 1] < 1.0
        for free, mine in ((place - 1, k), (place + 1, k + 1))[::1 if first else -1]:
            if 0 <= free < count and not taken[free]:
                found[mine] = free
                taken[free], taken[place] = 1, taken[place] - 1
                break
    return found


def placed(values: Array, which: Indices, stamps: Indices, before: float,
           after: float | None = None) -> Answers:
    """
    Return for each state its command, or the one before if it has none.

    Parameters
    ----------
    values : ndarray, shape (M, n)
        Commands [N·m].
    which : ndarray, shape (M,)
        State that each answers; none outside of their range.
    stamps : ndarray, shape (N,)
        Of the states [ns].
    before, after : float
        Part of the commands that may answer the state before, and the one after; the same
        without the second.

    """
    count = len(stamps)
    last = np.full(count, -1)
    inside = (which >= 0) & (which < count)
    np.maximum.at(last, which[inside], np.flatnonzero(inside))
    own = last >= 0
    last = np.maximum.accumulate(last)
    found = values[np.maximum(last, 0)].astype(float, copy=False)
    samples = _sample_numbers(stamps)
    age = samples - samples[np.clip(which[np.maximum(last, 0)], 0, count - 1)]
    known = (last >= 0) & (age <= _HELD)
    found[~known] = np.nan
    # Where a command was not recorded, one that is older stands in its place.
    older = float(age[known].mean()) if known.any() else 0.0
    less, more = (x if x > _NEGLIGIBLE else 0.0
                  for x in (before, before if after is None else after))
    return Answers(found, (-less - (older if older > _NEGLIGIBLE else 0.0), more), own)
