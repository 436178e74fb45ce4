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
The motion of a robot from a bag of any recorder: joint states and commanded torques as arrays.

A topic may be followed by a field: `/NAME/robot_state:desired_joint_state.effort`. Without one,
the fields of known types are taken. `bags/reader.py` reads the runs of this package, with
reference and law; here joint states are enough.
"""

from __future__ import annotations

from array import array
from ast import literal_eval
from collections.abc import Mapping, Sequence
from contextlib import closing
import dataclasses
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

from ctc_chattering.bags.bag import Bag
from ctc_chattering.bags.recording import (
    Answers,
    answers,
    Indices,
    RecordedMotion,
    Recording,
    VELOCITIES,
)
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.control.laws.registry import LAWS, SWITCHINGS
from ctc_chattering.dynamics.registry import locked_positions
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, near, refused_as, shortened
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS, nanoseconds
from ctc_chattering.ros.topics import COMMANDS, JOINT_STATES, PARAMETERS, ROBOT_DESCRIPTION
import numpy as np
import numpy.typing as npt
from rosbags.interfaces import Connection
import yaml

JOINT_STATE, MULTI_ARRAY = 'sensor_msgs/msg/JointState', 'std_msgs/msg/Float64MultiArray'
METADATA = 'metadata.yaml'
#: What a joint state has.
STATE_FIELDS = ('position', 'velocity', 'effort')
#: Reports of torques that are in force from then on; those of other types were in force before.
_TRAJECTORY_STATE = 'control_msgs/msg/JointTrajectoryControllerState'
#: Fields of strings that name joints, as messages call them.
_NAMES = ('name', 'names', 'joint_names', 'dof_names')
#: Commands for each state from which on they must be even and not to and fro, as those of one
#: publisher, and mean change from a command to the next over that to the one after it: noise of
#: velocities that are differences has 1.2.
_SEVERAL, _SMOOTH = 1.5, 1.5
#: Steps back of the stamps in the order of receipt, by so many periods, that are of a clock.
_BACK = 20
#: Fewest messages for each state with a torque that the robot reports.
_TOO_FEW = 0.8
#: Distance from where the model has it of a joint that is not asked for [rad or m].
_ELSEWHERE = 0.02
#: Difference from positions or velocities, as a part of their deviation, of what is no torque.
_LIKE_MOTION = 0.05


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

    def __str__(self) -> str:
        """Return name, type and number of messages."""
        return f'{self.name} ({self.kind}, {sum(x.msgcount for x in self.connections)} messages)'

    def names(self) -> tuple[tuple[str, ...], int]:
        """Return the joint names in the first message, or none, and the number of values."""
        field = self.fields[0]
        message = next(iter(self.bag.read(self.connections)), (0, None))[1]
        values = _numbers(message, field)
        if values is None:
            known = [x.name for x in dataclasses.fields(message)] if message else []
            raise CtcError(f'{self.bag.path}: {self.name} has no numbers in {field}; it has: '
                           f'{", ".join(known)}{near(field, known)}')
        return _names_of(message, field), len(values)

    def read(self, joints: tuple[str, ...]) -> Signal:
        """Return the values of some joints; messages without each of them are left out."""
        logged, stamps = array('q'), array('q')
        known: tuple[str, ...] = ()
        picked = np.zeros(0, int)
        columns = [array('d') for _ in self.fields]
        unknown = np.full(len(joints), np.nan)
        for t, message in self.bag.read(self.connections):
            names = _names_of(message, self.fields[0]) or joints
            if names != known:
                known, whole = names, set(joints) <= set(names) and len(set(names)) == len(names)
                picked = np.array([names.index(x) for x in joints] if whole else [], int)
            rows = [_numbers(message, field) for field in self.fields]
            if rows[0] is None or not len(picked):
                continue
            for column, row in zip(columns, rows):
                column.frombytes((
                    unknown if row is None or len(row) != len(names) else row.take(picked)
                    ).tobytes())
            stamp = getattr(getattr(message, 'header', None), 'stamp', None)
            stamps.append(nanoseconds(stamp) if stamp else 0)
            logged.append(t)
        return Signal(np.array(logged), np.array(stamps), tuple(
            np.frombuffer(x).reshape(-1, len(joints)) for x in columns))


def _topics(bag: Bag, name: str, kind: str, fields: tuple[str, ...]) -> list[SignalTopic]:
    """Return the topics with a name and a type; an empty one stands for all."""
    found: dict[tuple[str, str], list[Connection]] = {}
    for x in bag.named(name) if name else bag.connections:
        if x.msgcount and kind in ('', x.msgtype):
            found.setdefault((x.topic, x.msgtype), []).append(x)
    return [SignalTopic(bag, *key, fields, tuple(same)) for key, same in sorted(found.items())]


def _topic(bag: Bag, text: str, option: str, kind: str, fields: tuple[str, ...]) -> SignalTopic:
    """Return the topic that an option names; raise `CtcError` that names those that fit."""
    name, _, field = text.partition(':') if kind == MULTI_ARRAY else (text, '', '')
    found = _topics(bag, name, *(('', (field,)) if field else (kind, fields)))
    if len(found) > 1:
        raise CtcError(f'{bag.path}: several topics: {", ".join(map(str, found))}; give {option}')
    if not found:
        why = ', '.join(f'{x.name} is of type {x.kind}' for x in _topics(bag, name, '', ())) or (
            f'no message on {name}{near(name, [x.topic for x in bag.connections])}')
        fit = [*map(str, _topics(bag, '', kind, fields)), f'a topic of type {kind}']
        raise CtcError(f'{bag.path}: {why}; {option} may be: {", ".join(fit[:-1] or fit)}'
                       + ', or TOPIC:FIELD' * (kind == MULTI_ARRAY))
    return found[0]


def _beside(bag: Bag, topic: str, name: str) -> str:
    """Return the full name of the topic in the innermost namespace around another, else `name`."""
    namespace = topic
    while namespace:
        namespace = namespace.rpartition('/')[0]
        if bag.named(f'{namespace}/{name}'):
            return f'{namespace}/{name}'
    return name


_getter = cache(attrgetter)


def _value(message: Any, path: str) -> Any:
    """Return what is in a field, `a.b.c`; None without it."""
    try:
        return _getter(path)(message)
    except AttributeError:
        return None


def _numbers(message: Any, field: str) -> Array | None:
    """Return the numbers in a field, shape (n,); None without any."""
    value = _value(message, field)
    try:
        found = np.asarray(value, float).reshape(-1)
    except (TypeError, ValueError):
        return None
    return found if found.size and value is not None else None


def _names_of(message: Any, field: str) -> tuple[str, ...]:
    """Return the names that stand beside a field, or above it; empty for none."""
    if field == 'data':
        return tuple(x.label for x in _value(message, 'layout.dim') or ())
    while field:
        field = field.rpartition('.')[0]
        for name in _NAMES:
            found = _value(message, f'{field}.{name}' if field else name)
            if found:
                return (found,) if isinstance(found, str) else tuple(found)
    return ()


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
        those of the controller of this package, or all movable joints of the description that are
        in the states.
    description : str
        Text of the URDF; empty for that in the bag.
    states, commands : str
        Topics of the joint states and of the commanded torques; without a slash in front, in any
        namespace. Behind a colon may be the field that has the torques.
    model : str
        As `identify` takes it, for a bag that names a class of yours.

    Returns
    -------
    RecordedMotion
        States and torques, the robot's description, and notes on what was chosen.

    Raises
    ------
    CtcError
        If there is no bag, it cannot be read, a topic is not there, the commands are no torques of
        the joints, or `Recording.checked` refuses it.

    """
    path = Path(path)
    if len(set(joints)) < len(joints):
        raise CtcError(f'--joints: {shortened(joints)}: a joint is given more than once')
    with closing(open_bag(path)) as bag, refused_as(f'{path}: damaged'):
        # What the law was is of no use here.
        own = {'law': LAWS[0], 'switching': SWITCHINGS[0]}
        if model or description:
            own['model'] = model or 'urdf'
        source = _topic(bag, states, '--states', JOINT_STATE, STATE_FIELDS)
        node = _beside(bag, source.name, f'controller/{PARAMETERS}').removesuffix(
            f'/{PARAMETERS}')
        history = bag.parameters(node, ControllerConfig, own)
        controller = history[0][1] if history else None
        description = description or bag.description(f'{node}/{ROBOT_DESCRIPTION}') or (
            bag.description(_beside(bag, source.name, ROBOT_DESCRIPTION)))
        names = tuple(joints or (
            controller.joint_names if controller else _joints(source, description)))
        motion = source.read(names)
        if not len(motion.logged):
            known, _ = source.names()
            raise CtcError(
                f'{path}: no state has the joints {shortened(names)}; joints of the bag: '
                f'{", ".join(known)}{"".join(near(x, known) for x in names[:3])}')
        stamps = motion.stamps if np.ptp(motion.stamps) else motion.logged
        q, (dq, effort) = motion.values[0], map(_if_any, motion.values[1:])
        # All are not needed, and long series are large.
        dq = dq if dq is None or len(dq) <= VELOCITIES else dq[:VELOCITIES].copy()
        motion = motion._replace(values=(q,) if dq is None else (q, dq))
        notes = _left_out(source, names, description, locked_positions(
            controller.locked if controller else ())) if joints and description else []
        found = None
        try:
            topic = _topic(bag, commands, '--commands', MULTI_ARRAY, ('data',))
            found = _command(topic, names, motion, stamps)
        except CtcError as error:
            if commands != COMMANDS:
                raise
            if effort is None:
                raise CtcError(f'no torque: no effort in the states, and {error}') from None
            if _topics(bag, '', MULTI_ARRAY, ()):
                notes.append(f'no commands are used: {error}')
        without = [] if effort is None else [
            name for name, x in zip(names, effort.T) if not np.isfinite(x).any()]
        if without:
            notes.append(f'the effort is not used: there is none of {", ".join(without)}')
        recording = Recording(
            path.resolve().name, names, (stamps - stamps.min()) / NANOSECONDS, q, dq, effort,
            found.command if found else None, found.late if found else (0.0, 0.0),
            count_dropped(path, (source.name, commands.partition(':')[0])))
        return RecordedMotion(recording.checked(), description, controller, tuple(notes))


def count_dropped(path: Path, topics: Sequence[str]) -> int:
    """Return how many messages on topics the recorder of this package counted as lost."""
    try:
        content = yaml.safe_load((path / METADATA).read_text(encoding='utf-8'))
        notes = content['rosbag2_bagfile_information'].get('custom_data') or {}
        counts = dict(literal_eval(notes.get('dropped', '{}')))
        return sum(int(count) for name, count in counts.items()
                   if any(name.endswith(topic) for topic in topics))
    except (OSError, ValueError, TypeError, KeyError, SyntaxError, yaml.YAMLError):
        return 0  # Of a bag without metadata, or of another recorder.


def _joints(states: SignalTopic, description: str) -> tuple[str, ...]:
    """Return the joints where none are asked for."""
    in_states, _ = states.names()
    movable = Tree(description).movable if description else in_states
    found = tuple(name for name in movable if name in in_states)
    if not found:
        described = f'the joints {shortened(movable)}' if movable else (
            'no joint that moves by itself: fixed joints, joints that mimic others, and their '
            'leaders are left out')
        raise CtcError(f'{states.bag.path}: the description has {described}; the states have '
                       f'{shortened(in_states)}')
    return found


def _left_out(states: SignalTopic, names: tuple[str, ...], description: str,
              locked: Mapping[str, float]) -> list[str]:
    """Return which joints that are not asked for are elsewhere than the model has them."""
    known, _ = states.names()
    others = tuple(x for x in Tree(description).movable if x in known and x not in names)
    ends = [(x, q.min(), q.max(), locked.get(x, 0.0)) for x, q in zip(
        others, states.read(others).values[0].T)] if others else []
    return [f'{name} is none of --joints: it is at {low:.3g} to {high:.3g} in the bag, and fixed '
            f'at {at:g} in the model' for name, low, high, at in ends
            if max(at - low, high - at) > _ELSEWHERE]


def _command(topic: SignalTopic, names: tuple[str, ...], motion: Signal, stamps: Indices
             ) -> Answers:
    """Return the torques commanded in answer to the states; raise `CtcError` if they are none."""
    found = topic.read(names)
    complete = np.isfinite(found.values[0]).all(axis=1)
    found = found if complete.all() else found.where(complete)
    values, count = found.values[0], len(motion.logged)
    if not len(values):
        labels, width = topic.names()
        raise CtcError(f'{topic.bag.path}: {width} commanded torques for {len(names)} joints, '
                       f'{shortened(names)}; name those of the commands, in their order: --joints'
                       + f' {shortened(labels)}' * bool(labels))
    times, received = found.logged, motion.logged
    if (np.diff(stamps) < -_BACK * np.median(np.diff(np.sort(stamps)))).sum() > _BACK:
        raise CtcError(f'{topic.bag.path}: stamps of the states run to and fro in the order in '
                       'which they were recorded: was the clock of the recorder set back, or are '
                       'there two publishers of joint states? Record it again')
    if topic.kind != MULTI_ARRAY:
        if len(values) < _TOO_FEW * count:
            raise CtcError(
                f'{topic.bag.path}: {len(values)} torques on {topic.name} for {count} states: a '
                'torque is not known between its reports; raise their rate (state_publish_rate)')
        if found.stamps[0] < stamps[-1] and stamps[0] < found.stamps[-1]:  # Of one clock.
            times, received = found.stamps, stamps
        if topic.kind != _TRAJECTORY_STATE:
            times = times - int(np.median(np.diff(received)))
    if len(values) > _SEVERAL * count:
        step, (one, two) = np.diff(times), (
            np.abs(values[k:] - values[:-k]).mean(axis=0) for k in (1, 2))
        if np.percentile(step, 25.0) < 0.5 * step.mean() or (one > _SMOOTH * two).any():
            raise CtcError(f'{topic.bag.path}: {len(values)} commands for {count} states, uneven '
                           'or to and fro: two publishers of commands? If not, record more states')
    order = np.argsort(stamps, kind='stable')
    answered = answers(values, times, stamps[order], received[order]).where(np.argsort(order))
    for row, what in zip(motion.values, ('positions', 'velocities')):
        command = answered.command[:len(row)]
        known = np.isfinite(command).all(axis=1) & np.isfinite(row).all(axis=1)
        if known.any() and any(
                np.abs(x[known] - y[known]).mean() < _LIKE_MOTION * y[known].std()
                for x, y in zip(command.T, row.T)):
            raise CtcError(
                f'{topic.bag.path}: the commands on {topic.name} are {what}, no torques')
    return answered


def _if_any(values: Array) -> Array | None:
    """Return values, or None if they are nowhere finite, or 0 throughout."""
    known = np.isfinite(values)
    return values if (known & (values != 0.0)).any() else None
