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

"""Joint states and torques are read from bags of any recorder, or refused in clear words."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
import sqlite3
from typing import Any

from ctc_chattering.errors import CtcError
from ctc_chattering.identification.bag_motion import read_motion
from ctc_chattering.identification.recording import RecordedMotion, RecordingFault
from identified_robots import record, Recorded
import motion_bags
from motion_bags import header, joint_state, messages_of, point, STORE, torques, write
import numpy as np
import pytest
from refusals import refused
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import get_types_from_msg
import urdfs

Messages = Sequence[tuple[str, int, Any]]
COMMANDS, ORDERS = '/effort_controller/commands', '/forward_effort_controller/commands'


@cache
def made() -> Recorded:
    return record('two_link', 1, 0.5)


def messages(**fields: Any) -> list[tuple[str, int, Any]]:
    """Return joint states and commands."""
    x = made().recording
    fields = {'q': x.q, 'dq': x.dq, 'effort': None, 'command': x.command, **fields}
    return messages_of(x.t, x.joints, **fields)


def moved(found: Messages, commands: str = ORDERS) -> list[tuple[str, int, Any]]:
    """Return messages with the commands on another topic."""
    return [(commands if topic == COMMANDS else topic, t, message) for topic, t, message in found]


def by_time(*found: tuple[str, int, Any]) -> Messages:
    return sorted(found, key=lambda x: x[1])


def read(path: Path, found: Messages, *joints: str, **more: Any) -> RecordedMotion:
    return read_motion(write(path / 'bag', found), joints, **more)


def test_other_order_and_further_joints(tmp_path: Path) -> None:
    wanted = made().recording
    found = read(tmp_path, messages(order=(1, 0), extra=('finger', 'thumb')), *wanted.joints)
    assert found.recording.joints == wanted.joints
    assert found.recording.q == pytest.approx(wanted.q)
    assert found.recording.dq == pytest.approx(wanted.dq)
    assert found.recording.command == pytest.approx(wanted.command)
    assert found.recording.effort is None
    assert (found.controller, found.description) == (None, '')


def test_commands_without_names_are_in_the_order_of_joints(tmp_path: Path) -> None:
    found = messages(labels=False, extra=('finger',), command=made().run.tau[:, ::-1])
    with refused(RecordingFault.JOINTS):
        read(tmp_path, found)
    motion = read_motion(tmp_path / 'bag', ('joint2', 'joint1')).recording
    assert motion.q == pytest.approx(made().recording.q[:, ::-1])
    assert motion.command == pytest.approx(made().run.tau[:, ::-1])
    with refused(RecordingFault.JOINTS):
        read_motion(tmp_path / 'bag', ('joint2',))
    with refused(RecordingFault.JOINTS):
        read_motion(tmp_path / 'bag', description=urdfs.two_links())
    named = read(tmp_path / 'named', messages(), 'joint2').recording
    assert named.command == pytest.approx(made().run.tau[:, 1:])


def test_joints_are_those_of_the_description(tmp_path: Path) -> None:
    x = made().recording
    found = read(tmp_path, messages_of(
        x.t, urdfs.TWO_LINKS, x.q, None, x.command, None, extra=('finger',),
        urdf=urdfs.two_links()))
    assert found.recording.joints == urdfs.TWO_LINKS
    assert found.description == urdfs.two_links()
    assert found.recording.dq is None
    assert found.recording.effort == pytest.approx(x.command)


@pytest.mark.parametrize('moves', [True, False])
def test_an_unused_joint_that_moves_is_noted(tmp_path: Path, moves: bool) -> None:
    """The model has it fixed at 0."""
    x = made().recording
    path = write(tmp_path / 'bag', messages_of(
        x.t, urdfs.TWO_LINKS, x.q * [moves, 1.0], None, None, x.command, urdf=urdfs.two_links()))
    found = read_motion(path, urdfs.TWO_LINKS[1:]).notes
    assert len(found) == moves and all(f'{urdfs.TWO_LINKS[0]} is none of --joints: it is at'
                                       in note and 'fixed at 0' in note for note in found)


def test_an_effort_of_zeros_or_of_some_joints_is_none(tmp_path: Path) -> None:
    some = made().run.tau.copy()
    some[:, 1] = np.nan
    for name, value in (('zeros', 0.0 * some[:, :1] + [0.0, 0.0]), ('some', some)):
        found = read(tmp_path / name, messages(effort=value))
        assert found.recording.effort is None
    assert found.notes == ('the effort is not used: there is none of joint2',)


def test_unsuitable_bags_are_refused(tmp_path: Path) -> None:
    x = made().recording
    with refused(RecordingFault.TOPIC):
        read(tmp_path / 'empty', messages_of(
            x.t[:0], x.joints, x.q, None, None, None, urdf=urdfs.two_links()))
    with pytest.raises(CtcError, match=r'no state has the joints elbow; '
                                       r'joints of the bag: joint1, joint2$'):
        read(tmp_path, messages(), 'elbow')
    bag = tmp_path / 'bag'
    with refused(RecordingFault.JOINTS):
        read_motion(bag, ('joint1', 'elbow'))
    with refused(RecordingFault.JOINTS):
        read_motion(bag, ('joint1', 'joint2', 'joint1'))
    many = tuple(f'jiont{k}' for k in range(10 ** 5))
    with pytest.raises(CtcError, match=r'100000 in all.*did you mean joint1\?') as error:
        read_motion(bag, many)
    assert len(str(error.value)) < 600
    with refused(RecordingFault.TOPIC):
        read(tmp_path / 'idle', messages(command=None))
    q = x.q.copy()
    q[300] = np.nan
    with refused(RecordingFault.STATES):
        read(tmp_path / 'nan', messages(q=q))
    other = [('/joint_states', t, torques(x.q[0])) for t in range(2)]
    with refused(RecordingFault.TOPIC):
        read(tmp_path / 'type', other)
    # Of two types on one topic the one that fits is taken.
    assert read(tmp_path / 'both', [*other, *messages()]).recording.q == pytest.approx(x.q)


def test_two_publishers_of_commands(tmp_path: Path) -> None:
    x = made().recording
    twice = [y for z in messages() for y in [z] * (1 + (z[0] == COMMANDS))]
    with refused(RecordingFault.SOURCES):
        read(tmp_path / 'commands', twice)
    # Those of another controller, half a period later.
    others = [(COMMANDS, t + 500_000, torques(message.data + 1.0, x.joints))
              for topic, t, message in messages() if topic == COMMANDS]
    with refused(RecordingFault.SOURCES):
        read(tmp_path / 'others', by_time(*messages(), *others))


@pytest.mark.parametrize('storage', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize('stamps', [True, False])
def test_a_clock_that_is_set_back(tmp_path: Path, storage: StoragePlugin, stamps: bool) -> None:
    """Of robot and recorder, or of the recorder alone: log times run back, too."""
    found = []
    for topic, t, message in messages():
        back = 150_370_000 * (t > 1.25e9)
        if stamps and topic == '/joint_states':
            message.header = header(t - back)
        found.append((topic, t - back, message))
    path = write(tmp_path / 'bag', found, storage)
    with pytest.raises(CtcError, match='clock'):
        read_motion(path, made().recording.joints)


def test_commands_four_times_as_frequent_as_states_are_averaged(tmp_path: Path) -> None:
    """Between two states all of them are in force, one after the other."""
    t: Any = 1e-3 * np.arange(1000)
    fine = (t[:, None] + 0.25e-3 * np.arange(4)).ravel()
    tau = 20.0 * np.stack((np.sin(3.0 * fine), np.cos(4.0 * fine)), axis=1)
    # Of velocities that are differences of positions, which is much from sample to sample.
    tau += np.diff(np.random.default_rng(2).normal(size=(4001, 2)), axis=0)
    q = np.sin(np.stack((t, 2.0 * t), axis=1))
    found = read(tmp_path, by_time(
        *messages_of(t, ('joint1', 'joint2'), q, None, None, None),
        *((COMMANDS, round(1e9 * (1.0 + at)) + 50_000, torques(row))
          for at, row in zip(fine, tau)))).recording
    assert found.command == pytest.approx(tau.reshape(1000, 4, 2).mean(axis=1))
    assert found.late[0] <= 0.0 and found.late[1] >= 0.25


def test_a_torque_that_is_no_longer_commanded_is_not_known(tmp_path: Path) -> None:
    command = made().recording.command
    found = read(tmp_path, [x for x in messages() if not (
        x[0] == COMMANDS and 1.2e9 < x[1] < 1.4e9)]).recording.command
    assert found is not None and command is not None
    assert found[:200] == pytest.approx(command[:200])
    assert np.isnan(found[230:395]).all()
    assert found[401:] == pytest.approx(command[401:])


# The robots that people have, each with its own topics and messages.

def test_the_user_names_another_topic_of_commands(tmp_path: Path) -> None:
    bare = messages(labels=False)
    both = [*[('/gripper', t, torques(np.zeros(3))) for t in range(3)], *moved(bare), *(
        x for x in moved(bare, '/other/commands') if x[0] == '/other/commands')]
    with pytest.raises(CtcError, match=(
            rf'no torque: .* effort_controller/commands.*; --commands may be: {ORDERS} .*501 mess'
            r'.*, /gripper .*, /other/commands .*, or TOPIC:FIELD')):
        read(tmp_path, both)
    path = tmp_path / 'bag'
    found = read_motion(path, commands='/other/commands')
    assert found.recording.command == pytest.approx(made().recording.command)
    assert found.notes == ()
    with pytest.raises(CtcError, match=r'did you mean /other/commands\?; --commands may be: '
                                       rf'{ORDERS} .*, /other/commands \('):
        read_motion(path, commands='/othr/commands')
    with pytest.raises(CtcError, match=r'did you mean /joint_states\?; --states may be: /j'):
        read_motion(path, states='/joint_sates')


def test_without_commands_the_effort_is_used_with_a_note(tmp_path: Path) -> None:
    found = read(tmp_path, moved(messages(effort=made().recording.command, labels=False)))
    assert found.recording.command is None and found.recording.effort is not None
    (note,) = found.notes
    assert f'--commands may be: {ORDERS} (std_msgs/msg/Float64MultiArray, 501' in note


def test_positions_are_no_torques(tmp_path: Path) -> None:
    x = made().recording
    found = moved(messages(effort=x.command, command=x.q + 1e-4, labels=False), '/targets')
    with refused(RecordingFault.TORQUE):
        read(tmp_path, found, commands='/targets')


def test_grippers_and_namespaces(tmp_path: Path) -> None:
    x = made().recording
    arm = messages()
    fingers = [('/joint_states', t + 1, joint_state(t, ('finger',), x.q[0, :1], None, None))
               for topic, t, _ in arm if topic == '/joint_states']
    found = read(tmp_path / 'a', by_time(*arm, *fingers), *x.joints)
    assert found.recording.q == pytest.approx(x.q)
    assert found.recording.command == pytest.approx(x.command)
    left, right = ([(f'/{name}{topic}', t, message) for topic, t, message in arm]
                   for name in ('left', 'right'))
    with refused(RecordingFault.TOPIC):
        read(tmp_path / 'b', [*left, *right])
    found = read_motion(tmp_path / 'b' / 'bag', states='/left/joint_states',
                        commands='/left/effort_controller/commands')
    assert found.recording.q == pytest.approx(x.q)


def test_a_gripper_whose_joints_only_mimic_others_is_refused(
        tmp_path: Path) -> None:
    x = made().recording
    urdf = urdfs.two_links()
    for joint in urdfs.TWO_LINKS:
        urdf = urdf.replace(f'<joint name="{joint}" type="revolute">',
                            f'<joint name="{joint}" type="revolute"><mimic joint="drive"/>')
    assert urdf.count('<mimic') == 2
    with refused(RecordingFault.JOINTS):
        read(tmp_path, messages_of(x.t, urdfs.TWO_LINKS, x.q, None, x.command, None, urdf=urdf))


REPORTS, TRAJECTORY_STATE = ('/joint_trajectory_controller/controller_state',
                             'control_msgs/msg/JointTrajectoryControllerState')
TORQUES = f'{REPORTS}:output.effort'
PANDA, PANDA_STATE = ('/franka_robot_state_broadcaster/robot_state',
                      'franka_msgs/msg/FrankaRobotState')
LBR_STATE = 'lbr_fri_idl/msg/LBRState'
#: What is read of messages that ROS does not bring along, and a field before and behind it.
for _name, _text in {
        TRAJECTORY_STATE: 'std_msgs/Header header\nstring[] joint_names\n'
                          'trajectory_msgs/JointTrajectoryPoint error\n'
                          'trajectory_msgs/JointTrajectoryPoint output\nfloat64 scaling',
        PANDA_STATE: 'std_msgs/Header header\nbool[7] collision\n'
                     'sensor_msgs/JointState measured_joint_state\n'
                     'sensor_msgs/JointState desired_joint_state\nuint8 robot_mode',
        LBR_STATE: 'int8 session_state\nfloat64[7] measured_torque\n'
                   'float64[7] commanded_torque\nuint32 time_stamp_sec'}.items():
    STORE.register(get_types_from_msg(_text, _name))


def trajectory_bag(every: int = 1, effort: bool = True) -> Messages:
    """Return what a joint_trajectory_controller publishes, recorded 3 ms late."""
    x = made().recording
    assert x.command is not None
    return by_time(*messages(effort=x.command, command=None), *(
        (REPORTS, t + 3_000_000, motion_bags.made(
            TRAJECTORY_STATE, header=header(t), joint_names=list(x.joints[::-1]), scaling=1.0,
            error=point(0, x.q[k]), output=point(0, None, None, None, (
                x.command[k, ::-1] if effort else None))))
        for k, (_, t, _) in enumerate(messages(command=None)) if k % every == 0))


def test_output_of_a_trajectory_controller_by_its_stamps(tmp_path: Path) -> None:
    found = read(tmp_path, trajectory_bag(), commands=TORQUES)
    assert found.recording.command == pytest.approx(made().recording.command)
    with pytest.raises(CtcError, match=r'no numbers in output\.effort'):
        read(tmp_path / 'a', trajectory_bag(effort=False), commands=TORQUES)
    with refused(RecordingFault.TORQUE):
        read(tmp_path / 'b', trajectory_bag(every=20), commands=TORQUES)


def test_an_order_of_the_file_that_contradicts_the_stamps_changes_nothing(tmp_path: Path) -> None:
    dice, x = np.random.default_rng(3), made().recording
    found = read(tmp_path, by_time(*(
        (topic, t + int(dice.integers(15_000_000)), message)
        for topic, t, message in trajectory_bag())), commands=TORQUES).recording
    assert found.t == pytest.approx(x.t)
    assert found.q == pytest.approx(x.q)
    assert found.effort == pytest.approx(x.command)
    assert found.command == pytest.approx(x.command)


def test_of_two_robots_the_parameters_beside_the_states_are_taken(tmp_path: Path) -> None:
    """Those in the namespace of the states, not those of all controllers together."""
    found = []
    for name, offset in (('left', 0.0), ('right', 5.0)):
        urdf = urdfs.two_links().replace('<robot name="', f'<robot name="{name}')
        found += [(f'/{name}{topic}', t, message) for topic, t, message in messages(
            q=made().recording.q + offset, urdf=urdf)]
    path = write(tmp_path / 'bag', found)
    joints = made().recording.joints
    for name, offset in (('left', 0.0), ('right', 5.0)):
        motion = read_motion(path, joints, states=f'/{name}/joint_states',
                             commands=f'/{name}{COMMANDS}')
        assert f'<robot name="{name}' in motion.description
        assert motion.recording.q == pytest.approx(made().recording.q + offset)


def test_the_state_of_a_franka_robot(tmp_path: Path) -> None:
    """
    The desired torque of a state is the one that was answered to the state before.

    The sqlite3 of ROS 2 Humble and before has no definitions of messages.
    """
    names = tuple(f'fr3_joint{k}' for k in range(1, 8))
    q, dq, tau = np.cumsum(np.random.default_rng(1).normal(size=(3, 400, 7)), axis=1)
    found: list[tuple[str, int, Any]] = []
    for k in range(400):
        t = 10 ** 9 + k * 10 ** 6
        measured, desired = (joint_state(t, names, q[k], dq[k], x * tau[k]) for x in (2.0, 1.0))
        found += [('/franka/joint_states', t, measured), (PANDA, t, motion_bags.made(
            PANDA_STATE, header=header(t), collision=np.zeros(7, bool), robot_mode=2,
            measured_joint_state=measured, desired_joint_state=desired))]
    topics = {'states': '/franka/joint_states', 'commands': f'{PANDA}:desired_joint_state.effort'}
    path = write(tmp_path / 'bag', found, StoragePlugin.SQLITE3)
    motion = read_motion(path, **topics)
    assert motion.recording.joints == names
    assert motion.recording.effort == pytest.approx(2.0 * tau)
    assert motion.recording.command is not None
    assert motion.recording.command[:-1] == pytest.approx(tau[1:])
    with sqlite3.connect(path / 'bag.db3') as database:
        database.execute('DELETE FROM message_definitions')
    with pytest.raises(CtcError, match=f'the bag does not define {PANDA_STATE}, .*--storage mcap'):
        read_motion(path, **topics)


def test_a_field_of_any_message(tmp_path: Path) -> None:
    q, tau = np.random.default_rng(1).normal(size=(2, 300, 7))
    names = tuple(f'lbr_A{k}' for k in range(1, 8))
    found: list[tuple[str, int, Any]] = []
    for k in range(300):
        t = 10 ** 9 + k * 10 ** 6
        found += [('/lbr/joint_states', t, joint_state(t, names, q[k], None, 3.0 * tau[k])),
                  ('/lbr/state', t + 1000, motion_bags.made(
                      LBR_STATE, session_state=4, measured_torque=3.0 * tau[k],
                      commanded_torque=tau[k], time_stamp_sec=1))]
    with pytest.raises(CtcError, match=r'/lbr/state is of type lbr_fri_idl/msg/LBRState; .*'
                                       '--commands may be: .*TOPIC:FIELD'):
        read(tmp_path, found, commands='/lbr/state')
    path = tmp_path / 'bag'
    with pytest.raises(CtcError, match=r'no numbers in comanded_torque; it has: .*session_state'
                                       r'.*did you mean commanded_torque\?'):
        read_motion(path, commands='/lbr/state:comanded_torque')
    motion = read_motion(path, commands='/lbr/state:commanded_torque')
    assert motion.recording.command is not None
    assert motion.recording.command[:-2] == pytest.approx(tau[1:-1])
