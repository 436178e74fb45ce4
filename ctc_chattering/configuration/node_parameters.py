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
Parameters of the executables, one class each.

The nodes, `ctc` and `parameter_file` read them here.
"""

from __future__ import annotations

import dataclasses
from math import inf

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.parameters import (
    Config,
    LEAST,
    Parameter,
    parameter,
    PerJoint,
    Strings,
    unit_text,
)
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig


@dataclasses.dataclass(frozen=True)
class NodeConfig(Config):
    """The parameter that all nodes of the loop have."""

    wait_for: Strings = parameter(
        ('',), 'Nodes that must subscribe before the first message; bringup sets it.',
        read_only=True)


@dataclasses.dataclass(frozen=True)
class PlantNodeConfig(NodeConfig, PlantConfig):
    """Parameters of the plant node."""

    hold_at: float = parameter(
        0.0, 'Time at which simulated time stops in lockstep, before the first state at or after '
        'it; 0 for no stop.', 's')
    command_timeout: float = parameter(
        0.02, 'Longest time without a command in real time, at least three control periods. '
        'After it the torque is 0 and the brakes hold until the next command. Above 1/Kv the '
        'motion may diverge.', 's',
        minimum=LEAST)
    least_angle: float = parameter(
        inf, 'Smallest position of continuous joints in joint_states, whose positions then stay '
        'within one turn. Drivers use -3.14159 or 0; .inf for positions that count turns.', 'rad',
        minimum=-inf, read_only=True)


@dataclasses.dataclass(frozen=True)
class ControllerNodeConfig(NodeConfig, ControllerConfig):
    """Parameters of the controller node."""

    state_timeout: float = parameter(
        0.02, 'Longest time without a state in real time, at least three control periods. After '
        'it, or after such a gap between stamps, the law restarts.',
        's', minimum=LEAST, read_only=True)
    predicted_periods: int = parameter(
        5, 'Largest number of periods without a state in real time that a torque for the '
        'predicted state answers, until state_timeout; 0 for no prediction.', maximum=100)
    least_answered: float = parameter(
        0.05, 'Smallest share of the states of the last second that must be answered within a '
        'control period in real time. Below it the torques end until ~/reset. It is also '
        'measured for a second before the first torque. 0 for no check.', minimum=0.0, maximum=1.0)
    reference_timeout: float = parameter(
        0.1, 'Time for which a late reference continues at its last velocity before it stands '
        'still.', 's',
        read_only=True)
    restart_duration: float = parameter(
        2.0, "Time over which the desired motion returns from the robot's position to the "
        'reference after 0.1 s without a torque; 0 for no return motion.', 's')
    enabled: bool = parameter(
        True, 'Send torques from the start. The service ~/enable changes it.', read_only=True)


@dataclasses.dataclass(frozen=True)
class ReferenceNodeConfig(NodeConfig, ReferenceConfig):
    """Parameters of the reference node."""

    horizon: float = parameter(
        0.5, 'Time by which the motion is published ahead.', 's', minimum=0.01, maximum=60.0,
        read_only=True)
    action_name: str = parameter(
        'follow_joint_trajectory', 'Name of the action control_msgs/FollowJointTrajectory under '
        '~/, which is served where control_msgs is installed.', read_only=True)
    action_monitor_rate: float = parameter(
        20.0, 'Rate of the feedback of a goal.', 'Hz', minimum=LEAST)
    path_tolerance: PerJoint = parameter(
        0.0, 'Largest position error of a goal on its way; 0 for any.', 'rad')
    goal_tolerance: PerJoint = parameter(
        0.0, 'Largest position error of a goal at its end; 0 for any.', 'rad')
    stopped_velocity_tolerance: float = parameter(
        0.01, 'Largest velocity error of a goal at its end; 0 for any.', 'rad/s')
    goal_time: float = parameter(
        0.0, 'Time after the end of a goal by which its tolerances are met; 0 for any.', 's')


@dataclasses.dataclass(frozen=True)
class RecorderConfig(Config):
    """Parameters of the recorder node."""

    bag: str = parameter('bag', 'Directory to create for the bag.', read_only=True)


@dataclasses.dataclass(frozen=True)
class BringupConfig(Config):
    """Parameters of bringup."""

    events: Strings = parameter(
        ('',), 'Changes of parameters during the run, each "time node parameter value" with the '
        'time in s.',
        read_only=True)


#: The parameters of each executable.
NODES: dict[str, type[Config]] = {
    'plant': PlantNodeConfig, 'controller': ControllerNodeConfig,
    'reference': ReferenceNodeConfig, 'recorder': RecorderConfig, 'bringup': BringupConfig}
#: Parameters by which bringup, the live page and tests drive the nodes. No user sets them.
_INTERNAL = ('wait_for', 'hold_at', 'compiled')
#: The nodes of the control loop, with the parameters that concern a simulation.
LOOP: dict[str, type[Config]] = {
    'plant': PlantConfig, 'controller': ControllerConfig, 'reference': ReferenceConfig}
#: Description of each node for its --help.
NODE_DESCRIPTIONS = {
    'plant': 'Simulate the robot. It receives torques and publishes joint states.',
    'controller': 'Control the robot. Each joint state is answered with torques.',
    'reference': 'Publish the desired motion in advance.',
    'recorder': 'Record every message of the graph in a bag.'}


def parameter_table() -> str:
    """Return all parameters as a table in Markdown."""
    nodes: dict[Parameter, list[str]] = {}
    for node, config in NODES.items():
        for spec in config.parameters().values():
            if spec.name not in _INTERNAL:
                nodes.setdefault(spec, []).append(node)
    rows = [('parameter', 'nodes', 'allowed', 'default', 'unit', 'while running', 'meaning'),
            ('---',) * 7]
    for spec, names in nodes.items():
        rows.append((
            f'`{spec.name}`', ', '.join(names), spec.allowed.replace('|', '\\|'),
            f'`{_default_text(spec.default)}`', unit_text(spec.unit),
            '' if spec.read_only else 'yes', spec.meaning))
    return '\n'.join(f'| {" | ".join(row)} |' for row in rows)


def _default_text(value: object) -> str:
    """Return a default as a file has it."""
    text = str(list(value) if isinstance(value, tuple) else value) or "''"
    return text.replace('inf', '.inf')
