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
Recorded motion of a robot, from a bag.

`read_motion` reads joint states and commanded torques for `identify`. The user may name a topic,
and a field of it: `/NAME/robot_state:desired_joint_state.effort`. Without a field, that of the
known types is read. `bags/reader.py` reads the runs of this package, with reference and law.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
import dataclasses
from pathlib import Path
from typing import NamedTuple

from ctc_chattering.bags.bag import Bag
from ctc_chattering.bags.bag_files import count_dropped
from ctc_chattering.bags.command_matching import match_commands
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.bags.signals import Instants, JOINT_STATE, MULTI_ARRAY, Signal, SignalTopic
from ctc_chattering.configuration.topics import (
    COMMANDS,
    JOINT_STATES,
    PARAMETERS,
    ROBOT_DESCRIPTION,
)
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.control.laws.registry import LAWS, SWITCHINGS
from ctc_chattering.dynamics.registry import locked_positions
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import as_ctc_error, CtcError, shorten, suggest
from ctc_chattering.identification.recording import (
    find_joints,
    KEPT_VELOCITY_ROWS,
    RecordedMotion,
    Recording,
    RecordingError,
    RecordingFault,
)
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
import numpy as np
from rosbags.interfaces import Connection

#: Fields of a joint state.
STATE_FIELDS = ('position', 'velocity', 'effort')
#: Its torques are in force from the report on. Those of other types were in force before it.
_TRAJECTORY_STATE = 'control_msgs/msg/JointTrajectoryControllerState'


@dataclasses.dataclass(frozen=True)
class CommandLimits:
    """
    Limits of one controller's torque commands.

    Attributes
    ----------
    max_commands_per_state : float
        With more, commands must be even and smooth, else several publishers are assumed.
    min_quartile_step_ratio : float
        Least lower quartile of the steps between even commands, relative to the mean step.
    max_roughness : float
        Mean abs(c[k+1] - c[k]) over mean abs(c[k+2] - c[k]) of smooth commands. White noise of
        velocities that are differences gives 1.2.
    backward_step_periods : float
        A stamp this far before the one recorded before it is a backward step.
    max_backward_steps : int
        With more backward steps a clock was set back.
    min_reports_per_state : float
        Fewest torques for each state where the robot reports them. They are unknown in between.
    min_motion_difference : float
        Least mean difference from positions or velocities, relative to their deviation. Commands
        below it are copies of them.

    """

    max_commands_per_state: float = 1.5
    min_quartile_step_ratio: float = 0.5
    max_roughness: float = 1.5
    backward_step_periods: float = 20.0
    max_backward_steps: int = 20
    min_reports_per_state: float = 0.8
    min_motion_difference: float = 0.05


COMMAND_LIMITS = CommandLimits()
#: A joint that is not asked for may be this far from where the model locks it [rad or m].
_MAX_LOCK_ERROR = 0.02


class _RobotInBag(NamedTuple):
    """Controller's configuration and URDF in a bag."""

    controller: ControllerConfig | None
    description: str


def read_motion(
        path: str | Path,
        joints: Sequence[str] = (),
        description: str = '',
        states: str = JOINT_STATES,
        commands: str = COMMANDS,
        model: str = '') -> RecordedMotion:
    """
    Return the motion in a bag, for `identify`.

    Parameters
    ----------
    path : str or Path
        Directory of the bag.
    joints : sequence of str
        Joints in the order of the model, and of commands without names. By default those of this
        package's controller, or all movable joints of the description that are in the states.
    description : str
        Text of the URDF. An empty one stands for that in the bag.
    states, commands : str
        Topics of the joint states and of the commanded torques. A topic without a slash in front
        may be in any namespace. A colon and the torques' field may follow.
    model : str
        As `identify` takes it, for a bag that names a class of yours.

    Returns
    -------
    RecordedMotion
        States and torques, the robot's description, and notes on what was chosen.

    Raises
    ------
    CtcError
        If there is no bag, it cannot be read, a topic is missing, the commands are no torques of
        the joints, or `Recording.checked` refuses it.

    """
    path = Path(path)
    if len(set(joints)) < len(joints):
        raise RecordingError(
            RecordingFault.JOINTS,
            f'--joints: {shorten(joints)}: a joint is given more than once')
    with closing(open_bag(path)) as bag, as_ctc_error(f'{path}: damaged'):
        state_topic = _choose_topic(bag, states, '--states', JOINT_STATE, STATE_FIELDS)
        robot = _read_robot(bag, state_topic.name, description, model)
        names = tuple(joints)
        if not names and robot.controller:
            names = robot.controller.joint_names
        if not names:
            names = find_joints(path, robot.description, state_topic.read_layout().joints)
        signal = state_topic.read(names)
        if not len(signal.logged):
            recorded = state_topic.read_layout().joints
            hints = ''.join(suggest(x, recorded) for x in names[:3])
            raise RecordingError(
                RecordingFault.JOINTS,
                f'{path}: no state has the joints {shorten(names)}; joints of the bag: '
                f'{", ".join(recorded)}{hints}')
        stamps = signal.stamps if np.ptp(signal.stamps) else signal.logged
        q, dq, effort = signal.values
        command_name, _, _ = commands.partition(':')
        recording = Recording(
            path.resolve().name,
            names,
            (stamps - stamps.min()) / NANOSECONDS,
            q,
            None if _is_unused(dq) else dq[:KEPT_VELOCITY_ROWS].copy(),
            None if _is_unused(effort) else effort,
            dropped=count_dropped(path, (state_topic.name, command_name)))
        notes: list[str] = []
        if joints and robot.description:
            notes += _note_misplaced_joints(state_topic, names, robot)
        try:
            command_topic = _choose_topic(bag, commands, '--commands', MULTI_ARRAY, ('data',))
            recording = _add_commands(command_topic, recording, signal.logged, stamps)
        except CtcError as error:
            if commands != COMMANDS:
                raise
            if recording.effort is None:
                fault = RecordingFault.TORQUE
                if isinstance(error, RecordingError):
                    fault = error.fault
                raise RecordingError(
                    fault, f'no torque: no effort in the states, and {error}') from None
            if _find_topics(bag, '', MULTI_ARRAY, ()):
                notes.append(f'no commands are used: {error}')
        notes += _note_missing_effort(recording)
        return RecordedMotion(
            recording.checked(),
            robot.description,
            robot.controller,
            tuple(notes))


# Topics and the robot.

def _find_topics(
        bag: Bag,
        name: str,
        message_type: str,
        fields: tuple[str, ...]) -> list[SignalTopic]:
    """
    Return the topics of a name and a type.

    An empty name or type stands for all. Topics without messages are left out.
    """
    connections: dict[tuple[str, str], list[Connection]] = {}
    for x in bag.named(name) if name else bag.connections:
        if x.msgcount and message_type in ('', x.msgtype):
            connections.setdefault((x.topic, x.msgtype), []).append(x)
    return [SignalTopic(bag, *key, fields, tuple(same))
            for key, same in sorted(connections.items())]


def _choose_topic(
        bag: Bag,
        text: str,
        option: str,
        message_type: str,
        fields: tuple[str, ...]) -> SignalTopic:
    """
    Return the topic that an option names.

    If there is none, `CtcError` names those that fit.
    """
    may_have_field = message_type == MULTI_ARRAY
    name, _, field = text.partition(':') if may_have_field else (text, '', '')
    if field:
        topics = _find_topics(bag, name, '', (field,))
    else:
        topics = _find_topics(bag, name, message_type, fields)
    if len(topics) == 1:
        return topics[0]
    if topics:
        names = ', '.join(map(str, topics))
        raise RecordingError(
            RecordingFault.TOPIC,
            f'{bag.path}: several topics: {names}; give {option}')
    other_types = _find_topics(bag, name, '', ())
    reason = ', '.join(f'{x.name} is of type {x.message_type}' for x in other_types)
    if not reason:
        existing = [x.topic for x in bag.connections]
        reason = f'no message on {name}{suggest(name, existing)}'
    suitable = [str(x) for x in _find_topics(bag, '', message_type, fields)]
    allowed = ', '.join(suitable) or f'a topic of type {message_type}'
    if may_have_field:
        allowed += ', or TOPIC:FIELD'
    raise RecordingError(
        RecordingFault.TOPIC,
        f'{bag.path}: {reason}; {option} may be: {allowed}')


def _read_robot(bag: Bag, state_topic: str, description: str, model: str) -> _RobotInBag:
    """
    Return configuration and description of the robot.

    They are those in the innermost namespace around the states.
    """
    # Only the joints and the model matter, not the law.
    replacements = {'law': LAWS[0], 'switching': SWITCHINGS[0]}
    if model or description:
        replacements['model'] = model or 'urdf'
    parameters = _name_beside(bag, state_topic, f'controller/{PARAMETERS}')
    node = parameters.removesuffix(f'/{PARAMETERS}')
    history = bag.parameters(node, ControllerConfig, replacements)
    description = (
        description or bag.description(f'{node}/{ROBOT_DESCRIPTION}')
        or bag.description(_name_beside(bag, state_topic, ROBOT_DESCRIPTION)))
    return _RobotInBag(history[0][1] if history else None, description)


def _name_beside(bag: Bag, topic: str, name: str) -> str:
    """
    Return a topic's name in the innermost namespace around another.

    Without such a topic, `name` is returned.
    """
    namespace = topic
    while namespace:
        namespace = namespace.rpartition('/')[0]
        if bag.named(f'{namespace}/{name}'):
            return f'{namespace}/{name}'
    return name


# Joints and states.

def _note_misplaced_joints(
        states: SignalTopic,
        names: tuple[str, ...],
        robot: _RobotInBag) -> Iterator[str]:
    """Note unused joints that are not where the model locks them."""
    candidates = set(states.read_layout().joints).difference(names)
    movable = Tree(robot.description).movable
    unused = tuple(x for x in movable if x in candidates)
    if not unused:
        return
    locked = locked_positions(robot.controller.locked if robot.controller else ())
    for name, q in zip(unused, states.read(unused).values[0].T):
        low, high = q.min(), q.max()
        position = locked.get(name, 0.0)
        if max(position - low, high - position) > _MAX_LOCK_ERROR:
            yield (f'{name} is none of --joints: it is at {low:.3g} to {high:.3g} in the '
                   f'bag, and fixed at {position:g} in the model')


def _note_missing_effort(recording: Recording) -> Iterator[str]:
    """Note joints without an effort, where others have one."""
    if recording.effort is None:
        return
    is_missing = ~np.isfinite(recording.effort)
    missing = [x for x, column in zip(recording.joints, is_missing.T) if column.all()]
    if missing:
        yield f'the effort is not used: there is none of {", ".join(missing)}'


def _is_unused(values: Array) -> bool:
    """Return whether values are nowhere finite, or 0 throughout."""
    return not (np.isfinite(values) & (values != 0.0)).any()


# Commanded torques.

def _add_commands(
        topic: SignalTopic,
        recording: Recording,
        logged: Instants,
        stamps: Instants) -> Recording:
    """
    Return a recording with the torques commanded for its states.

    Parameters
    ----------
    topic : SignalTopic
        Commands, or reports of them.
    recording : Recording
        Recording without commands.
    logged, stamps : ndarray of int, shape (N,)
        Log times and stamps of the states [ns].

    Raises
    ------
    CtcError
        If they are no torques of the joints, or come from several publishers.

    """
    joints = recording.joints
    commands = topic.read(joints).select_finite()
    values = commands.values[0]
    if not len(values):
        layout = topic.read_layout()
        option = ' '.join(filter(None, ('--joints', shorten(layout.joints))))
        raise RecordingError(
            RecordingFault.JOINTS,
            f'{topic.bag.path}: {layout.width} commanded torques for {len(joints)} joints, '
            f'{shorten(joints)}; name those of the commands, in their order: {option}')
    period = np.median(np.diff(np.sort(stamps)))
    longest = COMMAND_LIMITS.backward_step_periods * period
    is_backward = np.diff(stamps) < -longest
    if is_backward.sum() > COMMAND_LIMITS.max_backward_steps:
        raise RecordingError(
            RecordingFault.CLOCK,
            f'{topic.bag.path}: the stamps of the states go backwards {is_backward.sum()} times. '
            'Either the clock of the recorder was set back, or two publishers send joint states. '
            'Record again with one publisher and a steady clock')
    times, received = commands.logged, logged
    if topic.message_type != MULTI_ARRAY:
        times, received = _time_reports(topic, commands, logged, stamps)
    _check_one_publisher(topic.bag.path, values, times, len(stamps))
    order = np.argsort(stamps, kind='stable')
    answers = match_commands(values, times, stamps[order], received[order])
    command = answers.command[np.argsort(order)]
    for motion, quantity in ((recording.q, 'positions'), (recording.dq, 'velocities')):
        if motion is not None and _repeats(command[:len(motion)], motion):
            raise RecordingError(
                RecordingFault.TORQUE,
                f'{topic.bag.path}: the commands on {topic.name} are {quantity}, no torques')
    return dataclasses.replace(recording, command=command, late=answers.late)


def _time_reports(
        topic: SignalTopic,
        reports: Signal,
        logged: Instants,
        stamps: Instants) -> tuple[Instants, Instants]:
    """Return times of reports and of states on one clock [ns]."""
    count, states = len(reports.logged), len(stamps)
    if count < COMMAND_LIMITS.min_reports_per_state * states:
        raise RecordingError(
            RecordingFault.TORQUE,
            f'{topic.bag.path}: {count} torques on {topic.name} for {states} states: a '
            'torque is not known between its reports; raise their rate (state_publish_rate)')
    times, received = reports.logged, logged
    stamps_overlap = reports.stamps[0] < stamps[-1] and stamps[0] < reports.stamps[-1]
    if stamps_overlap:  # They are of one clock.
        times, received = reports.stamps, stamps
    if topic.message_type != _TRAJECTORY_STATE:
        times = times - int(np.median(np.diff(received)))
    return times, received


def _check_one_publisher(path: Path, values: Array, times: Instants, states: int) -> None:
    """
    Raise `CtcError` if several publishers sent the commands.

    There are then many for each state, uneven or to and fro.
    """
    if len(values) <= COMMAND_LIMITS.max_commands_per_state * states:
        return
    step = np.diff(times)
    shortest = COMMAND_LIMITS.min_quartile_step_ratio * step.mean()
    change = np.abs(values[1:] - values[:-1]).mean(axis=0)
    double_change = np.abs(values[2:] - values[:-2]).mean(axis=0)
    is_rough = (change > COMMAND_LIMITS.max_roughness * double_change).any()
    if np.percentile(step, 25.0) < shortest or is_rough:
        raise RecordingError(
            RecordingFault.SOURCES,
            f'{path}: {len(values)} commands for {states} states come unevenly, or go to and fro. '
            'Two publishers seem to send commands. Stop one, or record more states')


def _repeats(command: Array, motion: Array) -> bool:
    """Return whether commands copy a joint's motion."""
    is_known = np.isfinite(command).all(axis=1)
    is_known &= np.isfinite(motion).all(axis=1)
    if not is_known.any():
        return False
    command = command[is_known]
    motion = motion[is_known]
    difference = np.abs(command - motion).mean(axis=0)
    smallest = COMMAND_LIMITS.min_motion_difference * motion.std(axis=0)
    return bool((difference < smallest).any())
