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
Joint limits of a URDF.

Motions are checked against them before they begin: position, velocity and acceleration.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import inf
from typing import NamedTuple

from ctc_chattering.dynamics.registry import DescribedConfig
from ctc_chattering.dynamics.urdf_parser import Joint, Tree
from ctc_chattering.errors import CtcError
from ctc_chattering.trajectory.buffer import Point

#: Excess that counts as none: of a position [rad or m], else as a share of the limit.
TOLERANCE = 1e-3
#: What follows rad or m in the unit of each quantity, in the order of a point.
_PER_TIME = {'position': '', 'velocity': '/s', 'acceleration': '/s²'}


class JointLimits(NamedTuple):
    """Lower and upper limits of one joint."""

    name: str
    #: ``rad`` or ``m``; no limit is -inf or inf.
    unit: str = 'rad'
    position: tuple[float, float] = -inf, inf
    velocity: tuple[float, float] = -inf, inf
    acceleration: tuple[float, float] = -inf, inf
    #: True for a joint that turns endlessly.
    continuous: bool = False

    def violation(self, quantity: str, values: Sequence[float]) -> str:
        """Describe how far values exceed a limit, if they do."""
        lower, upper = getattr(self, quantity)
        lowest = min(values)
        highest = max(values)
        excess, value, limit, side = max(
            (highest - upper, highest, upper, 'above its upper'),
            (lower - lowest, lowest, lower, 'below its lower'))
        scale = 1.0 if quantity == 'position' else abs(limit)
        if not excess > TOLERANCE * scale:
            return ''
        unit = self.unit + _PER_TIME[quantity]
        return (f'{self.name}: {quantity} {value:.4g} {unit}, '
                f'{excess:.3g} {side} limit of {limit:.4g}')


def read_limits(urdf: str, joint_names: Sequence[str]) -> list[JointLimits]:
    """
    Return the limits that a URDF gives joints.

    Parameters
    ----------
    urdf : str
        Text of the URDF.
    joint_names : sequence of str, length n
        Joints in the order of the vectors. One that the URDF does not have is not limited.

    Raises
    ------
    CtcError
        If the text is no URDF, or limits of these joints contradict themselves.

    """
    tree = Tree(urdf)
    tree.check_limits(joint_names)
    joints = map(tree.joints.get, joint_names)
    return list(map(_joint_limits, joint_names, joints))


def _joint_limits(name: str, joint: Joint | None) -> JointLimits:
    if joint is None:
        return JointLimits(name)
    return JointLimits(
        name,
        joint.position_unit,
        joint.position,
        (-joint.velocity, joint.velocity),
        (-joint.acceleration, joint.acceleration),
        joint.continuous)


def limit_speed(limits: Sequence[JointLimits], speed: float) -> list[JointLimits]:
    """Return limits with a lower speed [rad/s or m/s]."""
    slower = []
    for joint in limits:
        lower, upper = joint.velocity
        velocity = max(lower, -speed), min(upper, speed)
        slower.append(joint._replace(velocity=velocity))
    return slower


def describe_violations(limits: Sequence[JointLimits], points: Iterable[Point]) -> str:
    """
    Describe which limits points exceed.

    The text has joints, quantities and amounts, and is empty if points exceed no limit.

    Parameters
    ----------
    limits : sequence of JointLimits, length n
        In the order of the vectors.
    points : iterable of (position, velocity, acceleration)
        Each of shape (n,) or empty.

    """
    violations = []
    for quantity, rows in zip(_PER_TIME, zip(*points)):
        columns = zip(*filter(len, rows))
        for joint, values in zip(limits, columns):
            violations.append(joint.violation(quantity, values))
    return '; '.join(filter(None, violations))


def check_limits(motion: str, limits: Sequence[JointLimits], points: Iterable[Point]) -> None:
    """Raise `CtcError` if points of a motion exceed limits."""
    text = describe_violations(limits, points)
    if text:
        raise CtcError(f'{motion} is beyond the limits of the description: {text}')


def continuous_joints(config: DescribedConfig, limits: Sequence[JointLimits] | None
                      ) -> tuple[bool, ...]:
    """
    Return which joints turn endlessly, shape (n,).

    Parameters
    ----------
    config : DescribedConfig
        Parameters, which may name such joints.
    limits : sequence of JointLimits, length n, or None
        Limits of the joints of `config`, if there is a description of the robot.

    """
    described = [joint.continuous for joint in limits or ()]
    return config.which_are_continuous(described)
