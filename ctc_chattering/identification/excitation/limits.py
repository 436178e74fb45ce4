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

"""What is asked of a motion that excites a robot, and the limits that it must keep."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from math import inf, isfinite
from typing import ClassVar

from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import Config, parameter
from ctc_chattering.trajectory.joint_limits import JointLimits
import numpy as np

#: Part of a joint's range that is left free at each end.
_MARGIN = 0.05
#: Without a limit: velocity [rad/s or m/s], and acceleration by velocity [1/s].
_VELOCITY, _ACCELERATION = 1.0, 4.0
#: Amplitude of the slow reversals as a part of the room beside the centre.
_SLOW = 0.4


@dataclasses.dataclass(frozen=True)
class ExcitationConfig(Config):
    """What is asked of the motion."""

    title: ClassVar[str] = 'excitation'

    joint_names: tuple[str, ...] = parameter(
        'joint_names', 'str[]', ('joint1', 'joint2'), 'Joints of the motion.')
    duration: float = parameter(
        'duration', 'float', 60.0, 'Time from the start of the motion to its end.', unit='s',
        minimum=0.0, exclusive=True, maximum=3600.0)
    start: tuple[float, ...] = parameter(
        'start', 'float[]', 0.0, 'Position from which the robot comes.', unit='rad', shape='n')
    center: tuple[float, ...] = parameter(
        'center', 'float[]', 0.0, 'Position about which the joints move.', unit='rad', shape='n')
    position_range: tuple[float, ...] = parameter(
        'position_range', 'float[]', 0.8, 'Greatest distance from the centre.', unit='rad',
        minimum=0.0, exclusive=True, shape='n')
    velocity_scale: float = parameter(
        'velocity_scale', 'float', 0.5,
        'Part of the limits of velocity and acceleration in the description to use.', minimum=0.0,
        exclusive=True, maximum=1.0)
    velocity_limit: tuple[float, ...] = parameter(
        'velocity_limit', 'float[]', inf, 'In place of that part; inf for it.', unit='rad/s',
        minimum=0.0, exclusive=True, infinite=True, shape='n')
    acceleration_limit: tuple[float, ...] = parameter(
        'acceleration_limit', 'float[]', inf, 'In place of that part; inf for it.', unit='rad/s^2',
        minimum=0.0, exclusive=True, infinite=True, shape='n')
    poses: int = parameter(
        'poses', 'int', 3, 'Number of poses with slow reversals.', minimum=1, maximum=100)
    clearance: float = parameter(
        'clearance', 'float', 0.02, 'Distance that links keep from each other.', unit='m',
        minimum=0.001, maximum=1.0)


@dataclasses.dataclass(frozen=True)
class Bounds:
    """
    What the motion keeps, each of shape (n,).

    Attributes
    ----------
    center, room : ndarray
        Centre, and greatest distance from it [rad].
    velocity, acceleration : ndarray
        Greatest magnitudes [rad/s, rad/s²].

    """

    center: Array
    room: Array
    velocity: Array
    acceleration: Array

    @property
    def slow(self) -> Array:
        """Amplitude of the slow reversals, shape (n,) [rad]."""
        return _SLOW * self.room


def bounds_of(config: ExcitationConfig, limits: Sequence[JointLimits]) -> Bounds:
    """
    Return what a motion must keep.

    Parameters
    ----------
    config : ExcitationConfig
        What is asked for.
    limits : sequence of JointLimits, length n
        Of the description, in the order of its joints.

    Raises
    ------
    ParameterError
        If the centre or the start is not within the limits, or a limit that is asked for is above
        that of the description.

    """
    room, velocity, acceleration = [], [], []
    for i, joint in enumerate(limits):
        low, high = joint.position
        if not low <= config.start[i] <= high:
            raise ParameterError(f'start of {joint.name}', config.start[i],
                                 f'{low:.4g} to {high:.4g} {joint.unit}, its limits')
        margin = _MARGIN * (high - low) if isfinite(high - low) else 0.0
        low, high, center = low + margin, high - margin, config.center[i]
        if not low < center < high:
            raise ParameterError(
                f'center of {joint.name}', center,
                f'more than {low:.4g} and less than {high:.4g} {joint.unit}, its limits less '
                f'{_MARGIN:.0%} of the range at each end')
        room.append(min(config.position_range[i], center - low, high - center))
        velocity.append(_limit(config, 'velocity', i, joint, _VELOCITY))
        acceleration.append(_limit(config, 'acceleration', i, joint, _ACCELERATION * velocity[i]))
    return Bounds(np.array(config.center), *map(np.array, (room, velocity, acceleration)))


def _limit(config: ExcitationConfig, quantity: str, i: int, joint: JointLimits, default: float
           ) -> float:
    """Return the limit of velocity or acceleration that joint `i` must keep."""
    name = f'{quantity}_limit'
    wanted: float = getattr(config, name)[i]
    described: float = getattr(joint, quantity)[1]
    if wanted == inf:
        return config.velocity_scale * described if described < inf else default
    if wanted > described:
        raise ParameterError(f'{name} of {joint.name}', wanted,
                             f'at most {described:g}, that of the description')
    return wanted
