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
enough.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from ctc_chattering.bags.bag import Bag
from ctc_chattering.bags.recording import Indices, RecordedMotion, Recording
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.bags.signals import (
    answers,
    COMMAND_FIELDS,
    JOINT_STATE,
    missing_topic,
    MULTI_ARRAY,
    named_topic,
    placed,
    Signal,
    signal_topics,
    SignalTopic,
    STATE_FIELDS,
)
from ctc_chattering.control.controller import ControllerConfig, LAWS
from ctc_chattering.control.controller_config import SWITCHINGS
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, near, refused_as, shortened
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.topics import COMMANDS, JOINT_STATES, ROBOT_DESCRIPTION
import numpy as np

#: What a name says of values that are no commanded torques.
_OTHERS = ('position', 'velocity', 'acceleration', 'external', 'gripper', 'measured')
#: Commands for each state from which on there must be two publishers.
_TOO_MANY = 1.5
#: Fewest messages for each state with a torque that the robot reports.
_TOO_FEW = 0.8
#: Difference from positions or velocities, as a part of their deviation, of what is no torque.
_LIKE_MOTION = 0.05


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
    with closing(open_bag(path)) as bag, refused_as(f'{path}: damaged'):
        notes: list[str] = []
        # What the law was is of no use here.
        own = {'law': LAWS[0], 'switching': SWITCHINGS[0]}
        if model or description:
            own['model'] = model or 'urdf'
        history = bag.parameters('controller', ControllerConfig, own)
        controller = history[0][1] if history else None
        description = description or bag.description() or bag.description(ROBOT_DESCRIPTION)
        source = _states(bag, states, notes)
        orders = named_topic(bag, commands, '--commands', COMMAND_FIELDS)
        if orders is None and commands != COMMANDS:
            raise missing_topic(bag, commands, '--commands', COMMAND_FIELDS)
        names = tuple(joints or (controller.joint_names if controller else
                                 _joints(source, orders, description)))
        motion = source.read(names)
        if not len(motion.logged):
            known = source.all_names()
            raise CtcError(
                f'{path}: no state has the joints {shortened(names)}; joints of the bag: '
                f'{", ".join(known)}{"".join(near(x, known) for x in names[:3])}')
        orders = orders or _only_command(source, names, notes)
        found = _command(orders, names, motion, notes) if orders else None
        times = motion.stamps if np.ptp(motion.stamps) else motion.logged
        q, dq, effort = motion.values
        has_effort = np.isfinite(effort).any(axis=0).reshape(-1).tolist()
        if any(has_effort) and not all(has_effort):
            without = ', '.join(name for name, has in zip(names, has_effort) if not has)
            notes.append(f'the effort is not used: there is none of {without}')
        recording = Recording(
            path.resolve().name, names, (times - times[0]) / NANOSECONDS, q, _if_any(dq),
            _if_any(effort), *(found or ()))
        return RecordedMotion(recording.checked(), description, controller, tuple(notes))


def _states(bag: Bag, text: str, notes: list[str]) -> SignalTopic:
    """Return the topic of the joint states."""
    if ':' in text:
        raise CtcError(f'--states: {text} is not allowed; allowed: a topic without a field')
    found = named_topic(bag, text, '--states', STATE_FIELDS)
    if found is None:
        fit = signal_topics(bag, bag.connections, STATE_FIELDS) if text == JOINT_STATES else []
        fit = [x for x in fit if x.kind == JOINT_STATE] or fit
        if len(fit) != 1:
            raise missing_topic(bag, text, '--states', STATE_FIELDS)
        (found,) = fit
        notes.append(f'joint states are those of {found}')
    return found


def _only_command(states: SignalTopic, joints: tuple[str, ...], notes: list[str]
                  ) -> SignalTopic | None:
    """Return the only topic that may have the commands; None if there is none, or several."""
    fit = [x for x in signal_topics(states.bag, states.bag.connections, COMMAND_FIELDS)
           if _may_command(x, states, joints)]
    if len(fit) == 1:
        notes.append(f'no message on {COMMANDS}; commands are those of {fit[0]}')
        return fit[0]
    if fit:
        notes.append(f'no message on {COMMANDS}, and no commands are used; they may be those of '
                     f'{" or ".join(map(str, fit))}: --commands TOPIC')
    return None


def _may_command(topic: SignalTopic, states: SignalTopic, joints: tuple[str, ...]) -> bool:
    """Return whether a topic may have the commanded torques of some joints."""
    name = topic.name.lower()
    if any(x in name for x in _OTHERS) or (topic.kind == JOINT_STATE and (
            topic.name == states.name or not ('desired' in name or 'command' in name))):
        return False
    names, count = topic.names()
    return count == len(names or joints) and (not names or set(joints) <= set(names))


def _joints(states: SignalTopic, orders: SignalTopic | None, description: str
            ) -> tuple[str, ...]:
    """Return the joints where none are asked for."""
    in_states, _ = states.names()
    labels, count = orders.names() if orders else ((), 0)
    if labels and set(labels) <= set(in_states):
        return labels
    found = tuple(name for name in Tree(description).movable
                  if name in in_states) if description else in_states
    if count and not labels and count != len(found):
        raise CtcError(
            f'{states.bag.path}: {count} commanded torques for {len(found)} joints, '
            f'{", ".join(found)}; name them in the order of the commands: --joints')
    return found


def _command(topic: SignalTopic, names: tuple[str, ...], motion: Signal, notes: list[str]
             ) -> tuple[Array, tuple[float, float]] | None:
    """Return the torques commanded in answer to the states, and by how much they may be late."""
    found = topic.read(names)
    found = found.where(np.isfinite(found.values[0]).all(axis=1))
    values, count = found.values[0], len(motion.logged)
    if not len(values):
        labels, width = topic.names()
        if width:
            notes.append(f'commands are not used: {topic} has no torques of all of '
                         f'{shortened(names)}, but {width} of {shortened(labels)}')
        return None
    if len(values) > _TOO_MANY * count:
        raise CtcError(f'{topic.bag.path}: {len(values)} commands on {topic.name} for {count} '
                       'states: are there two publishers of commands?')
    is_report = topic.kind != MULTI_ARRAY
    if is_report and len(values) < _TOO_FEW * count:
        raise CtcError(
            f'{topic.bag.path}: {len(values)} torques on {topic.name} for {count} states: a '
            'torque that is reported less often than the state is not known between; raise its '
            'rate (state_publish_rate), or record what it is made from')
    if is_report:
        is_stamped = _overlap(found.stamps, motion.stamps)
        times, at = (found.stamps, motion.stamps) if is_stamped else (found.logged, motion.logged)
        if topic.is_late:  # What is reported with a state was in force before it.
            times = times - int(np.median(np.diff(at)))
        order = np.argsort(times, kind='stable')
        which = np.searchsorted(at, times[order], side='right') - 1
        command, late, _ = placed(values[order], which, at, 0.0)
    else:
        stamps = motion.stamps if np.ptp(motion.stamps) else motion.logged
        command, late, _ = answers(values, found.logged, stamps, motion.logged)
    for row, what in zip(motion.values[:2], ('positions', 'velocities')):
        known = np.isfinite(command).all(axis=1) & np.isfinite(row).all(axis=1)
        difference = np.abs(command[known] - row[known])
        if known.any() and (difference.mean(axis=0) < _LIKE_MOTION * row[known].std(axis=0)).any():
            raise CtcError(
                f'{topic.bag.path}: the commands on {topic.name} are {what}, no torques')
    return command, late


def _overlap(a: Indices, b: Indices) -> bool:
    """Return whether two series of stamps are of one clock."""
    both = min(a.max(), b.max()) - max(a.min(), b.min())
    return bool(a.min() > 0 and both > 0.5 * (b.max() - b.min()))


def _if_any(values: Array) -> Array | None:
    """Return values, or None if they are nowhere finite, or 0 throughout."""
    known = np.isfinite(values)
    return values if (known & (values != 0.0)).any() else None
