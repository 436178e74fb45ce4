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

"""Robots of a description: the example node of MuJoCo, and descriptions that come on a topic."""

from __future__ import annotations

import sys

from ctc_chattering.configuration import parameter_file
from ctc_chattering.launch.child_process import Child
from faults import Diagnostics, ERROR
from mujoco_plant import simulated_by_mujoco
import numpy as np
from processes import CONFIG, probe
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_messages import COMMANDS, MS, ns
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from urdfs import link, two_links, ur5

pytestmark = pytest.mark.ros
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DESCRIPTION = 'robot_description'
EXAMPLE = CONFIG.parent / 'examples' / 'mujoco_plant.py'
ARM = ['-p', 'model:=urdf', '-p', 'joint_names:=[a,b]']


def test_the_example_node_of_mujoco_is_a_robot() -> None:
    """
    Every fourth sample is there once, and the motion is the one that the oracle of the tests has.

    The controller comes later than the first state, which is repeated. What it publishes fits into
    the histories of writer and reader, however late this process takes it.
    """
    file, urdf = CONFIG / 'friction.yaml', CONFIG / 'two_link.urdf'
    arguments = ('--params-file', str(file), '-p', 'model:=urdf', '-p', f'description:={urdf}')
    law = {'switching': 'implicit_observer', 'state_decimation': 4}
    start = {'duration': 0.5, 'initial_position': [3.1, 1.5]}

    with probe() as it:
        states = it.listen(JointState, 'joint_states')
        tracking = it.listen(JointState, 'controller/tracking')
        robot = Child('mujoco', [
            sys.executable, str(EXAMPLE), '--ros-args', *arguments, *(
                x for name, value in start.items() for x in ('-p', f'plant:{name}:={value}'))],
            it.lines.append)
        it.children.append(robot)
        it.until(lambda: len(states) > 1, 'the first state, which is repeated')
        it.start('controller', *arguments, *(
            x for name, value in law.items() for x in ('-p', f'{name}:={value}')))
        Diagnostics(it).next('controller')  # It knows all that we listen to, and can go on.
        it.start('reference', *arguments)
        it.until(lambda: robot.status is not None and len(tracking) == 126, 'the end')
        assert robot.status == 0, it.lines
    assert [ns(m.header.stamp) for m in tracking] == [k * MS for k in range(0, 501, 4)]
    described = {'model': 'urdf', 'description': str(urdf)}
    run = simulated_by_mujoco(parameter_file.load(
        file, {'/**': described, 'plant': start, 'controller': law})).run
    error = run.q_d - run.q
    np.testing.assert_allclose([m.position[2:] for m in tracking], error[::4], atol=1e-9)


def test_a_description_that_comes_later_and_is_wrong_at_first() -> None:
    """All wait for it and say so once; what is refused is named, and the next one taken."""
    massless = two_links().replace(link('lower', 1.5, (0, 0, -0.25), (0.05, 0.05, 0.01)),
                                   link('lower'))
    assert massless != two_links()
    with probe() as it:
        reports = Diagnostics(it)
        commands = it.listen(Float64MultiArray, COMMANDS)
        told = it.listen(String, f'controller/{DESCRIPTION}', LATCHED)
        # So fast that the limits are always reached; in lockstep, so that no delay makes a motion
        # with such torques diverge.
        it.start('controller', *ARM)
        it.start('plant', *ARM, '-p', 'initial_position:=[0.2, -0.3]', '-p', 'pacing:=lockstep')
        it.start('reference', '-p', 'joint_names:=[a,b]', '-p', 'amplitude:=[1.5, 0.5]',
                 '-p', 'frequency:=[6.0, 6.0]')
        nodes = ('controller', 'plant')
        for node in nodes:
            report = reports.until(node, lambda r: r.level == ERROR, 'the error')
            assert report.message == f'waiting for {DESCRIPTION}'
        topic = it.node.create_publisher(String, DESCRIPTION, LATCHED)
        for text, words in (
                ('', ['model urdf needs']), ('<robot', ['the description is not XML']),
                (ur5(), ["joint_names: ['a', 'b'] is not allowed", 'shoulder_pan_joint']),
                (massless, ['M is singular', 'moved by b '])):
            topic.publish(String(data=text))
            for node in nodes:
                it.until(lambda: any(
                    x.startswith(f'[{node}] [ERROR]') and f']: {DESCRIPTION}: ' in x
                    and all(word in x for word in words) for x in it.lines), words[0])
        assert commands == told == []
        topic.publish(String(data=two_links()))
        it.until(lambda: len(commands) > 100, 'torques')
        for node in nodes:
            reports.until(node, lambda r: r.message.startswith('running'), 'health')
            mine = [x for x in it.lines if x.startswith(f'[{node}]')]
            assert len([x for x in mine if x.endswith(f': waiting for {DESCRIPTION}')]) == 1
            assert len([x for x in mine if f'{DESCRIPTION} has come' in x]) == 1
        assert [m.data for m in told] == [two_links()]

        # Its limits bound the torques, 40 N·m and none, until there are others.
        def greatest(joint: int) -> float:
            return max((abs(m.data[joint]) for m in commands[-400:]), default=0.0)
        it.until(lambda: greatest(0) == 40.0, 'the limit of the description')
        assert it.set('controller', 'effort_limit', [55.0, 3.0]).successful
        commands.clear()
        it.until(lambda: (greatest(0), greatest(1)) == (55.0, 3.0), 'the other limits')
        assert not any('Traceback' in line for line in it.lines)
