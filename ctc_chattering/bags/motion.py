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
The motion of a robot from a bag of any recorder: joint states and commanded torques.

`bags/reader.py` reads the runs of this package, with reference and law; here joint states are
enough. A topic may be followed by a field: `/NAME/robot_state:desired_joint_state.effort`. Without
one, the fields of known types are taken.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
import dataclasses
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

from ctc_chattering.bags.bag import Bag, BagTopics
from ctc_chattering.bags.command_times import answers
from ctc_chattering.bags.recording import Indices, RecordedMotion, Recording
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.control.controller import ControllerConfig, LAWS
from ctc_chattering.control.controller_config import SWITCHINGS
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, near, refused_as, shortened
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.topics import COMMANDS, JOINT_STATES, ROBOT_DESCRIPTION
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


#: Commands for each state from which on there must be two publishers.
_TOO_MANY = 1.5
#: Fewest messages for each state with a torque that the robot reports.
_TOO_FEW = 0.8
#: Periods after which a command is no longer held.
_HELD = 20
#: Difference from positions or velocities, as a part of their deviation, of what is no torque.
_LIKE_MOTION = 0.05
#: Most samples that are compared with these.
_COMPARED = 20_000


def read_motion(path: str | Path, joints: Sequence[str] = (), description: str = '',
                states: str = JOINT_STATES, commands: str = COMMANDS, model: str = ''
                ) -> RecordedMotion:
    """
    Return the motion that a bag of any recorder holds, for `identify`.

    Parameters
    ----------
    path : str or Path
        Directory of the bag.
    joints : sequence of str
        Joints in the order of the model, and of the commands if these have no names; empty for
        those of the controller of this package, of the names in the commands, or all movable
        joints of the description that are in the states.
    description : str
        Text of the URDF; empty for that in the bag.
    states, commands : str
        Topics of the joint states and of the commanded torques; without a slash in front, in any
        namespace. Behind a colon may be the field that has the numbers. In place of the defaults,
        the only topic that fits is taken.
    model : str
        As `identify` takes it, for a bag that names a class of yours.

    Returns
    -------
    RecordedMotion
        States and torques, the robot's description, and notes on what was chosen.

    Raises
    ------
    CtcError
        If there is no bag, it cannot be read, or `Recording.checked` refuses it.

    """
    path = Path(path)
    if len(set(joints)) < len(joints):
        twice = next(name for name, count in Counter(joints).items() if count > 1)
        raise CtcError(f'--joints: {twice} is given more than once')
    with closing(open_bag(path)) as reader, refused_as(f'{path}: damaged'):
        return _MotionTopics(reader, path).motion(joints, description, (states, commands), model)


class _MotionTopics(BagTopics):
    """The topics of a bag with the motion of any robot."""

    def motion(self, joints: Sequence[str], description: str, topics: tuple[str, str], model: str
               ) -> RecordedMotion:
        """Return the motion; arguments as `read_motion` has them."""
        self._signals = Signals(self._reader, self.path)
        self._notes: list[str] = []
        self._late = (0.0, 0.0)
        # What the law was is of no use here.
        own = {'law': LAWS[0], 'switching': SWITCHINGS[0]}
        if model or description:
            own['model'] = model or 'urdf'
        history = self.parameters('controller', ControllerConfig, own)
        controller = history[0][1] if history else None
        description = (description or self.description()
                       or self.description(ROBOT_DESCRIPTION))
        states = self._states(topics[0])
        orders = self._signals.named(topics[1], '--commands', COMMAND_FIELDS)
        if orders is None and topics[1] != COMMANDS:
            raise self._signals.missing(topics[1], '--commands', COMMAND_FIELDS)
        names = tuple(joints) or self._joints(controller, states, orders, description)
        motion = self._signals.read(states, names)
        if not len(motion.logged):
            known = self._signals.all_names(states)
            raise CtcError(
                f'{self.path}: no state has the joints {shortened(names)}; joints of the bag: '
                f'{", ".join(known)}{"".join(near(x, known) for x in names[:3])}')
        if orders is None:
            orders = self._only_command(names, states)
        command = self._command(names, motion, orders) if orders else None
        return RecordedMotion(self._recording(names, motion, command).checked(), description,
                              controller, tuple(self._notes))

    def _states(self, text: str) -> SignalTopic:
        """Return the topic of the joint states."""
        if ':' in text:
            raise CtcError(f'--states: {text} is not allowed; allowed: a topic without a field')
        found = self._signals.named(text, '--states', STATE_FIELDS)
        if found is None:
            fit = self._signals.topics(STATE_FIELDS) if text == JOINT_STATES else []
            fit = [x for x in fit if x.kind == JOINT_STATE] or fit
            if len(fit) != 1:
                raise self._signals.missing(text, '--states', STATE_FIELDS)
            (found,) = fit
            self._notes.append(f'joint states are those of {found}')
        return found

    def _only_command(self, names: tuple[str, ...], states: SignalTopic) -> SignalTopic | None:
        """Return the only topic that may have the commands; None if there is none, or several."""
        fit = [x for x in self._signals.topics(COMMAND_FIELDS)
               if self._signals.may_command(x, names, states)]
        if len(fit) == 1:
            self._notes.append(f'no message on {COMMANDS}; commands are those of {fit[0]}')
            return fit[0]
        if fit:
            self._notes.append(f'no message on {COMMANDS}, and no commands are used; they may be '
                               f'those of {" or ".join(map(str, fit))}: --commands TOPIC')
        return None

    def _joints(self, controller: ControllerConfig | None, states: SignalTopic,
                orders: SignalTopic | None, description: str) -> tuple[str, ...]:
        """Return the joints where none are asked for."""
        if controller is not None:
            return tuple(controller.joint_names)
        in_states, _ = self._signals.names(states)
        labels, count = self._signals.names(orders) if orders else ((), 0)
        if labels and set(labels) <= set(in_states):
            return labels
        found = tuple(name for name in Tree(description).movable
                      if name in in_states) if description else in_states
        if count and not labels and count != len(found):
            raise CtcError(
                f'{self.path}: {count} commanded torques for {len(found)} joints, '
                f'{", ".join(found)}; name them in the order of the commands: --joints')
        return found

    def _recording(self, names: tuple[str, ...], motion: Signal, command: Array | None
                   ) -> Recording:
        """Return the recording."""
        times = motion.stamps
        if not np.ptp(times):
            times = motion.logged
        q, dq, effort = motion.values
        known = np.isfinite(effort).any(axis=0).reshape(-1).tolist()
        if any(known) and not all(known):
            without = ', '.join(name for name, has in zip(names, known) if not has)
            self._notes.append(f'the effort is not used: there is none of {without}')
        return Recording(self.path.resolve().name, names, (times - times[0]) / NANOSECONDS, q,
                         _if_any(dq), _if_any(effort), command, self._late)

    def _command(self, names: tuple[str, ...], motion: Signal, topic: SignalTopic) -> Array | None:
        """Return the torque commanded in answer to each state, shape (N, n), nan for unknown."""
        found = self._signals.read(topic, names)
        known = np.isfinite(found.values[0]).all(axis=1)
        values = found.values[0] if known.all() else found.values[0][known]
        count = len(motion.logged)
        if not len(values):
            labels, width = self._signals.names(topic)
            if width:
                self._notes.append(f'commands are not used: {topic} has no torques of all of '
                                   f'{shortened(names)}, but {width} of {shortened(labels)}')
            return None
        if len(values) > _TOO_MANY * count:
            raise CtcError(f'{self.path}: {len(values)} commands on {topic.name} for {count} '
                           'states: are there two publishers of commands?')
        is_report = topic.kind != MULTI_ARRAY
        if is_report and len(values) < _TOO_FEW * count:
            raise CtcError(
                f'{self.path}: {len(values)} torques on {topic.name} for {count} states: a torque '
                'that is reported less often than the state is not known between; raise its rate '
                '(state_publish_rate), or record what it is made from')
        stamps, logged = found.stamps[known], found.logged[known]
        if is_report and _overlap(stamps, motion.stamps):
            times, at = stamps, motion.stamps
        elif not is_report:
            stamps = motion.stamps if np.ptp(motion.stamps) else motion.logged
            answered = answers(values, logged, stamps, motion.logged)
            self._late = answered.late
            return self._checked(answered.command, motion, topic)
        else:
            times, at = logged, motion.logged
        if topic.is_late:  # What is reported with a state was in force before it.
            times = times - int(np.median(np.diff(at)))
        return self._checked(_in_force(values, times, at), motion, topic)

    def _checked(self, command: Array, motion: Signal, topic: SignalTopic) -> Array:
        """Return commands; raise `CtcError` if they are positions or velocities."""
        some = slice(None, None, len(command) // _COMPARED + 1)
        for values, what in zip((x[some] for x in motion.values[:2]), ('positions', 'velocities')):
            known = np.isfinite(command[some]).all(axis=1) & np.isfinite(values).all(axis=1)
            difference = np.abs(command[some][known] - values[known])
            if known.any() and (difference.mean(axis=0)
                                < _LIKE_MOTION * values[known].std(axis=0)).any():
                raise CtcError(f'{self.path}: the commands on {topic.name} are {what}, no torques')
        return command


def _in_force(values: Array, times: Indices, at: Indices) -> Array:
    """Return the value in force at the end of the period that each state begins, nan if old."""
    if (np.diff(times) < 0).any():
        order = np.argsort(times, kind='stable')
        values, times = values[order], times[order]
    period = int(np.median(np.diff(at)))
    until = np.append(at[1:], at[-1] + period)
    last = np.searchsorted(times, until) - 1
    found = values[np.maximum(last, 0)]
    age = at - times[np.maximum(last, 0)]
    found[(last < 0) | (age > _HELD * period)] = np.nan
    return found


def _overlap(a: Indices, b: Indices) -> bool:
    """Return whether two series of stamps are of one clock."""
    both = min(a.max(), b.max()) - max(a.min(), b.min())
    return bool(a.min() > 0 and both > 0.5 * (b.max() - b.min()))


def _if_any(values: Array) -> Array | None:
    """Return values, or None if they are nowhere finite, or 0 throughout."""
    known = np.isfinite(values)
    return values if (known & (values != 0.0)).any() else None
