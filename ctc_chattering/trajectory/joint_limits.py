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

"""Limits of position, velocity and acceleration, and those that a URDF gives its joints."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import inf
from typing import NamedTuple

from ctc_chattering.dynamics.registry import DescribedConfig
from ctc_chattering.dynamics.urdf_parser import Joint, Tree
from ctc_chattering.errors import CtcError
from ctc_chattering.trajectory.buffer import Point

#: What may be beyond a limit unnoticed: of position [rad or m], else as a share of the limit.
TOLERANCE = 1e-3
#: Names and units of position, velocity and acceleration.
_QUANTITIES = (('position', ''), ('velocity', '/s'), ('acceleration', '/s²'))


class JointLimits(NamedTuple):
    """Limits of one joint: least and greatest value of each quantity; ∓inf where there is none."""

    name: str
    #: ``rad`` or ``m``.
    unit: str = 'rad'
    position: tuple[float, float] = -inf, inf
    velocity: tuple[float, float] = -inf, inf
    acceleration: tuple[float, float] = -inf, inf


class LimitSet:
    """
    Limits of some joints.

    Parameters
    ----------
    joints : sequence of JointLimits
        In the order of the vectors.

    """

    def __init__(self, joints: Sequence[JointLimits]) -> None:
        self.joints = list(joints)

    def excess(self, points: Iterable[Point]) -> str:
        """
        Return what is beyond the limits, by joint, quantity and amount; empty if nothing is.

        Parameters
        ----------
        points : iterable of (position, velocity, acceleration)
            Each of shape (n,) or empty.

        """
        points = list(points)
        found = []
        for k, (quantity, per) in enumerate(_QUANTITIES):
            rows = [point[k] for point in points if point[k]]
            for joint, values in zip(self.joints, zip(*rows)):
                low, high = getattr(joint, quantity)
                least, most = min(values), max(values)
                beyond, value, limit, side = max(
                    (most - high, most, high, 'above its upper'),
                    (low - least, least, low, 'below its lower'))
                if beyond > TOLERANCE * (1.0 if quantity == 'position' else abs(limit)):
                    found.append(f'{joint.name}: {quantity} {value:.4g} {joint.unit}{per}, '
                                 f'{beyond:.3g} {side} limit of {limit:.4g}')
        return '; '.join(found)

    def slower(self, velocity: float) -> LimitSet:
        """Return the same with at most this speed of every joint [rad/s or m/s]."""
        return LimitSet([joint._replace(velocity=(
            max(joint.velocity[0], -velocity), min(joint.velocity[1], velocity)))
            for joint in self.joints])


class DescribedLimits(LimitSet):
    """
    Limits that a URDF gives some joints.

    Parameters
    ----------
    urdf : str
        Text of the URDF.
    joint_names : sequence of str
        Joints in the order of the vectors; one that the URDF does not have is not limited.

    Attributes
    ----------
    continuous : tuple of bool, shape (n,)
        Which joints turn endlessly.

    Raises
    ------
    CtcError
        If the text is no URDF, or limits of these joints contradict themselves.

    """

    def __init__(self, urdf: str, joint_names: Sequence[str]) -> None:
        tree = Tree(urdf)
        tree.check_limits(joint_names)
        described = tree.joints
        super().__init__([_limits_of(name, described.get(name)) for name in joint_names])
        self.continuous = tuple(
            name in described and described[name].continuous for name in joint_names)


def continuous_joints(config: DescribedConfig, description: str) -> tuple[bool, ...]:
    """
    Return which joints turn endlessly, by parameters and the robot's description, shape (n,).

    Parameters
    ----------
    config : DescribedConfig
        The parameters.
    description : str
        Text of the URDF; empty for none.

    Raises
    ------
    CtcError
        As `DescribedLimits` does.

    """
    return config.which_are_continuous(
        DescribedLimits(description, config.joint_names).continuous if description else ())


def _limits_of(name: str, joint: Joint | None) -> JointLimits:
    """Return the limits of a joint of a URDF; none without one."""
    return JointLimits(name) if joint is None else JointLimits(
        name, joint.position_unit, joint.position,
        (-joint.velocity, joint.velocity), (-joint.acceleration, joint.acceleration))


def check_limits(what: str, limits: LimitSet, points: Iterable[Point]) -> None:
    """Raise `CtcError` if points are beyond the limits, and say by how much."""
    text = limits.excess(points)
    if text:
        raise CtcError(f'{what} is beyond the limits of the description: {text}')
