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

"""The parameters by which controller and plant name their model of the robot."""

from __future__ import annotations

import dataclasses

from ctc_chattering.parameters import Config, parameter

#: Values of the parameter ``model``, besides classes.
MODELS = ('two_link', 'urdf')


@dataclasses.dataclass(frozen=True)
class RobotConfig(Config):
    """Joints and model; the base of the configurations that have a model."""

    joint_names: tuple[str, ...] = parameter(
        'joint_names', 'str[]', ('joint1', 'joint2'),
        'Joints, in the order of gains and torques.', read_only=True)
    model: str = parameter(
        'model', 'str', 'two_link',
        'Robot model, or your own: docs/robots.md.', choices=MODELS, own=True, read_only=True)
    description: str = parameter(
        'description', 'str', '',
        'Model urdf: file of the robot, a path or package://NAME/PATH; empty for the topic '
        'robot_description.', read_only=True)
    locked: tuple[str, ...] = parameter(
        'locked', 'str[]', ('',),
        'Positions of joints not in joint_names, each "name position"; default 0.',
        shape='any', read_only=True)
    gravity: float = parameter(
        'gravity', 'float', 9.81, 'Acceleration of gravity in G.', unit='m/s^2', minimum=0.0,
        read_only=True)
    compiled: bool = parameter(
        'compiled', 'bool', True,
        'Use the machine code of `ctc compile` where it is available.',
        read_only=True)
