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

"""Joint states and torques of the robots that people have, each in its own messages."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
import sqlite3
from typing import Any

from ctc_chattering.bags.motion import read_motion
from ctc_chattering.bags.recording import RecordedMotion
from ctc_chattering.errors import CtcError
from identified_robots import record, Recorded
from motion_bags import joint_state, messages_of, torques, write
import numpy as np
import pytest
from robot_messages import FRANKA_STATE, franka_state, lbr_state, STORE, trajectory_state
from rosbags.rosbag2 import StoragePlugin

Messages = Sequence[tuple[str, int, Any]]
ORDERS = '/forward_effort_controller/commands'


@cache
def made() -> Recorded:
    return record('two_link', 1, 1.0)


def messages(**fields: Any) -> list[tuple[str, int, Any]]:
    """Return joint states and commands."""
    x = made().recording
    fields = {'q': x.q, 'dq': x.dq, 'effort': None, 'command': x.command, **fields}
    return messages_of(x.t, x.joints, **fields)


def moved(found: Messages, **topics: str) -> list[tuple[str, int, Any]]:
    """Return messages on other topics: states=, commands=."""
    names = {'/joint_states': topics.get('states', '/joint_states'),
             '/effort_controller/commands': topics.get('commands', ORDERS)}
    return [(names[topic], t, message) for topic, t, message in found]


def read(path: Path, found: Messages, *joints: str, **more: Any) -> RecordedMotion:
    return read_motion(write(path / 'bag', found, typestore=STORE), joints, **more)


def test_commands_on_another_topic_are_those_that_the_user_names(tmp_path: Path) -> None:
    three = [('/gripper', t, torques(np.zeros(3))) for t in range(3)]
    both = [*three, *moved(messages(labels=False)), *(
        x for x in moved(messages(labels=False), commands='/other/commands')
        if x[0] == '/other/commands')]
    with pytest.raises(CtcError, match=(
            rf'no torque: .* effort_controller/commands.*; --commands may be: {ORDERS} .*1001 mess'
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


def test_without_commands_the_effort_is_taken_and_said(tmp_path: Path) -> None:
    found = read(tmp_path, moved(messages(effort=made().recording.command, labels=False)))
    assert found.recording.command is None and found.recording.effort is not None
    (note,) = found.notes
    assert f'--commands may be: {ORDERS} (std_msgs/msg/Float64MultiArray, 1001' in note


def test_positions_are_no_torques(tmp_path: Path) -> None:
    x = made().recording
    found = moved(messages(effort=x.command, command=x.q + 1e-4, labels=False),
                  commands='/targets')
    with pytest.raises(CtcError, match='commands on /targets are positions, no torques'):
        read(tmp_path, found, commands='/targets')


REPORTS = '/joint_trajectory_controller/controller_state'
TORQUES = f'{REPORTS}:output.effort'


def trajectory_bag(every: int = 1, effort: bool = True) -> Messages:
    """Return what a joint_trajectory_controller publishes, recorded 3 ms late."""
    x = made().recording
    assert x.dq is not None and x.command is not None
    states = messages(effort=x.command, command=None)
    reports = [(REPORTS, t + 3_000_000, trajectory_state(
        t, x.joints[::-1], x.q[k, ::-1], x.dq[k, ::-1],
        x.command[k, ::-1] if effort else None))
        for k, (_, t, _) in enumerate(states) if k % every == 0]
    return sorted([*states, *reports], key=lambda y: y[1])


def test_a_decimated_state_of_the_controller_beside_its_commands_changes_nothing(
        tmp_path: Path) -> None:
    """Check a bag of our own controller in which another recorder has ``~/controller_state``."""
    reports = [('/controller/controller_state', *x[1:]) for x in trajectory_bag(every=10)
               if x[0].endswith('controller_state')]
    found = read(tmp_path, sorted([*messages(), *reports], key=lambda x: x[1]))
    assert found.recording.command == pytest.approx(made().recording.command, abs=0.0)
    assert found.notes == ()


def test_output_of_a_trajectory_controller_by_its_stamps(tmp_path: Path) -> None:
    found = read(tmp_path, trajectory_bag(), commands=TORQUES)
    assert found.recording.command == pytest.approx(made().recording.command)


def test_a_trajectory_controller_has_no_torques_or_too_few(tmp_path: Path) -> None:
    with pytest.raises(CtcError, match=r'no numbers in output\.effort'):
        read(tmp_path / 'a', trajectory_bag(effort=False), commands=TORQUES)
    with pytest.raises(CtcError, match=r'51 torques on .* for 1001 states: .*state_publish_rate'):
        read(tmp_path / 'b', trajectory_bag(every=20), commands=TORQUES)


PANDA = '/franka_robot_state_broadcaster/robot_state'


def panda_bag() -> tuple[Messages, tuple[str, ...], Any]:
    """Return messages of a Franka robot with the joints of a random walk, names, and torques."""
    rng = np.random.default_rng(1)
    names = tuple(f'fr3_joint{k}' for k in range(1, 8))
    q, dq, tau = (np.cumsum(rng.normal(size=(400, 7)), axis=0) for _ in range(3))
    found: list[tuple[str, int, Any]] = []
    for k in range(400):
        t = 10 ** 9 + k * 10 ** 6
        found += [('/franka/joint_states', t, joint_state(t, names, q[k], dq[k], 2.0 * tau[k])),
                  (PANDA, t, franka_state(t, names, q[k], dq[k], 2.0 * tau[k], tau[k]))]
    return found, names, tau


def test_the_state_of_a_franka_robot(tmp_path: Path) -> None:
    """The desired torque of a state is the one that was answered to the state before."""
    found, names, tau = panda_bag()
    motion = read(tmp_path, found, states='/franka/joint_states',
                  commands=f'{PANDA}:desired_joint_state.effort')
    assert motion.recording.joints == names
    assert motion.recording.effort == pytest.approx(2.0 * tau)
    assert motion.recording.command is not None
    assert motion.recording.command[:-1] == pytest.approx(tau[1:])


def test_a_field_of_any_message(tmp_path: Path) -> None:
    q, tau = np.random.default_rng(1).normal(size=(2, 300, 7))
    names = tuple(f'lbr_A{k}' for k in range(1, 8))
    found: list[tuple[str, int, Any]] = []
    for k in range(300):
        t = 10 ** 9 + k * 10 ** 6
        found += [('/lbr/joint_states', t, joint_state(t, names, q[k], None, 3.0 * tau[k])),
                  ('/lbr/state', t + 1000, lbr_state(t, q[k], 3.0 * tau[k], tau[k]))]
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


def test_a_bag_without_definitions_says_so(tmp_path: Path) -> None:
    """The sqlite3 of ROS 2 Humble and before has none."""
    found, _, _ = panda_bag()
    path = write(tmp_path / 'bag', found, StoragePlugin.SQLITE3, STORE)
    topics = {'states': '/franka/joint_states', 'commands': f'{PANDA}:desired_joint_state.effort'}
    assert read_motion(path, **topics).recording.command is not None
    with sqlite3.connect(path / 'bag.db3') as database:
        database.execute('DELETE FROM message_definitions')
    with pytest.raises(CtcError, match=f'no definition of {FRANKA_STATE}, .*--storage mcap'):
        read_motion(path, **topics)


def test_a_type_that_cannot_be_used(tmp_path: Path) -> None:
    x = made().recording
    other = [('/joint_states', t, torques(x.q[0])) for t in range(2)]
    with pytest.raises(CtcError, match='/joint_states is of type std_msgs/msg/Float64MultiArray;'):
        read(tmp_path / 'a', other)
    # Of two types on one topic the one that fits is taken.
    found = read(tmp_path / 'b', [*other, *messages()])
    assert found.recording.q == pytest.approx(x.q)


def test_grippers_and_namespaces(tmp_path: Path) -> None:
    x = made().recording
    arm = messages()
    fingers = [('/joint_states', t + 1, joint_state(t, ('finger',), x.q[0, :1], None, None))
               for topic, t, _ in arm if topic == '/joint_states']
    found = read(tmp_path / 'a', sorted([*arm, *fingers], key=lambda y: y[1]), *x.joints)
    assert found.recording.q == pytest.approx(x.q)
    assert found.recording.command == pytest.approx(x.command)
    left, right = ([(f'/{name}{topic}', t, message) for topic, t, message in arm]
                   for name in ('left', 'right'))
    with pytest.raises(CtcError, match=r'several topics: /left/joint_states .*--states'):
        read(tmp_path / 'b', [*left, *right])
    found = read_motion(tmp_path / 'b' / 'bag', states='/left/joint_states',
                        commands='/left/effort_controller/commands')
    assert found.recording.q == pytest.approx(x.q)


def test_an_effort_of_some_joints_is_not_used(tmp_path: Path) -> None:
    effort = made().run.tau.copy()
    effort[:, 1] = np.nan
    found = read(tmp_path, messages(effort=effort))
    assert found.recording.effort is None
    assert found.notes == ('the effort is not used: there is none of joint2',)


def test_typos_in_joints(tmp_path: Path) -> None:
    with pytest.raises(CtcError, match=r'--joints: joint1, joint2, joint1: .* more than once'):
        read(tmp_path, messages(), 'joint1', 'joint2', 'joint1')
    many = tuple(f'jiont{k}' for k in range(10 ** 5))
    with pytest.raises(CtcError, match=r'100000 in all.*did you mean joint1\?') as error:
        read_motion(tmp_path / 'bag', many)
    assert len(str(error.value)) < 600


@pytest.mark.parametrize('compression', ['message', 'file', 'storage'])
def test_compressed_bags(tmp_path: Path, compression: str) -> None:
    found = read_motion(write(tmp_path / 'bag', messages(), compression=compression))
    assert found.recording.command == pytest.approx(made().recording.command)
