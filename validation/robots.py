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

"""The robots of all studies, of descriptions and drawn, and how they may move."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

from ctc_chattering.trajectory.waypoints import Route
import numpy as np
import pinocchio as pin
from rigid_bodies import Array, Bodies, bodies_of, PAPER, planar
import urdfs

_UR = (0.0, -1.0, 1.0, -1.0, -1.5, 0.0)
_SIX = tuple(f'joint{i}' for i in range(1, 7))
_SEVEN = (*_SIX, 'joint7')
#: File, joints, centre of the motion [rad], and Coulomb friction [N·m], if any is drawn.
DESCRIBED: dict[str, tuple[str, tuple[str, ...], tuple[float, ...], tuple[float, ...]]] = {
    'panda': ('panda', urdfs.PANDA, (0.0, -0.4, 0.0, -1.8, 0.0, 1.8, 0.5), ()),
    'ur3': ('ur3_robot', urdfs.UR5, _UR, ()),
    'ur5': ('ur5_robot', urdfs.UR5, _UR, ()),
    'ur10': ('ur10_robot', urdfs.UR5, _UR, (10.0, 10.0, 6.0, 2.0, 2.0, 0.8)),
    'z1': ('z1', _SIX, (0.0, 1.4, -1.4, 0.0, 0.0, 0.0), (1.5, 2.0, 1.5, 0.8, 0.5, 0.4)),
    'kinova': ('kinova', tuple(f'j2s6s200_joint_{i}' for i in range(1, 7)),
               (0.0, 2.6, 1.6, 0.0, 1.0, 0.0), ()),
    'xarm7': ('xarm7', _SEVEN, (0.0, -0.3, 0.0, 1.2, 0.0, 1.0, 0.0),
              (2.0, 2.0, 1.5, 1.5, 0.8, 0.8, 0.3)),
    'baxter': ('baxter', tuple(f'left_{x}' for x in ('s0', 's1', 'e0', 'e1', 'w0', 'w1', 'w2')),
               (0.0, -0.4, 0.0, 1.0, 0.0, 0.6, 0.0), ())}


@dataclasses.dataclass(frozen=True)
class Arm:
    """
    A robot and how it may move.

    Attributes
    ----------
    joints : tuple of str, length n
    urdf : str
        Empty for the paper's arm.
    centre, amplitude : tuple of float, length n
        Of the motion [rad].
    friction : tuple of (float, float), length n
        Least and greatest Coulomb friction [N·m].
    resolution : float
        Of the encoders [rad].

    """

    joints: tuple[str, ...]
    urdf: str
    centre: tuple[float, ...]
    amplitude: tuple[float, ...]
    friction: tuple[tuple[float, float], ...]
    resolution: float = 1e-5

    @property
    def n(self) -> int:
        """Return the number of joints."""
        return len(self.joints)

    def bodies(self) -> Bodies:
        """Return the bodies that its lab believes."""
        return bodies_of(self.urdf, self.joints) if self.urdf else planar(*PAPER)

    def limits(self) -> tuple[Array, Array]:
        """Return the largest torques and velocities, shape (n,) each; 0 where there is none."""
        if not self.urdf:
            return np.zeros(self.n), np.zeros(self.n)
        model: Any = pin.buildModelFromXML(self.urdf)
        at = [model.joints[model.getJointId(x)].idx_v for x in self.joints]
        return model.effortLimit[at], model.velocityLimit[at]


@cache
def arm(name: str) -> Arm:
    """Return `two_link`, the paper's arm, `two_link_urdf`, one of `DESCRIBED` or `drawn1` etc."""
    if name == 'two_link':
        return Arm(('joint1', 'joint2'), '', (0.0, 0.0), (1.2, 1.5), ((5.0, 12.0),) * 2)
    if name == 'two_link_urdf':
        return Arm(urdfs.TWO_LINKS, urdfs.two_links(), (0.0, 0.0), (1.2, 1.5),
                   ((2.0, 6.0), (0.5, 3.0)))
    if name.startswith('drawn'):
        return Arm(('j0', 'j1', 'j2'), drawn(int(name.removeprefix('drawn'))), (0.0,) * 3,
                   (1.0,) * 3, ((1.0, 3.0), (0.6, 2.0), (0.3, 1.5)))
    file, joints, centre, friction = DESCRIBED[name]
    found = Arm(joints, urdfs.robot(file), centre, (0.7,) * len(joints),
                tuple((0.4 * x, 1.2 * x) for x in friction))
    if name == 'panda':
        return dataclasses.replace(
            found, amplitude=(0.8, 0.6, 0.8, 0.6, 0.8, 0.8, 1.0), resolution=1e-6,
            friction=(*[(1.0, 5.0)] * 4, *[(0.2, 1.0)] * 3))
    if name == 'ur5':
        return dataclasses.replace(found, amplitude=(0.8, 0.5, 0.7, 0.8, 0.8, 1.0),
                                   friction=(*[(2.0, 9.0)] * 3, *[(0.3, 2.0)] * 3))
    return found


def drawn(seed: int) -> str:
    """Return an arm of three joints `j0` to `j2`, one perhaps prismatic, drawn at random."""
    rng = np.random.default_rng((seed, 6))
    slides = int(rng.integers(6))
    parts = [urdfs.link('base')]
    for i in range(3):
        axis = rng.normal(size=3) if rng.random() < 0.5 else np.eye(3)[rng.integers(3)]
        axis /= np.linalg.norm(axis)
        mass, length = rng.uniform(0.8, 4.0), rng.uniform(0.2, 0.5)
        inertia = mass * length ** 2 * rng.uniform(0.08, 0.12, 3)
        centre = rng.uniform(-0.4, 0.4, 3) * length
        parts += [urdfs.link(f'l{i}', mass, tuple(centre), tuple(inertia)), urdfs.joint(
            f'j{i}', 'prismatic' if i == slides else 'revolute', f'l{i - 1}' if i else 'base',
            f'l{i}', ' '.join(map(str, axis)),
            ' '.join(map(str, rng.uniform(-0.5, 0.5, 3) * length * 2.0)),
            '<limit lower="-3" upper="3" effort="300" velocity="2.5"/>')]
    return urdfs.urdf(parts)


def motion(robot: Arm, duration: float, seed: int) -> Route:
    """Return waypoints from rest: five harmonics, then slow reversals of every joint."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration + 0.025, 0.05)
    centre, amplitude = np.array(robot.centre), np.array(robot.amplitude)
    n = len(centre)
    q = np.zeros((len(t), n))
    late = _blend((t - 0.6 * duration) / 4.0)
    for i in range(n):
        sizes, phases = rng.normal(size=5), rng.uniform(0.0, 2.0 * np.pi, 5)
        fast = sum(size / k * np.sin(0.2 * np.pi * k * t + phase)
                   for k, (size, phase) in enumerate(zip(sizes, phases), 1))
        slow = 0.25 * np.sin(2.0 * np.pi * (0.07 + 0.02 * i) * t + i)
        q[:, i] = amplitude[i] * ((1.0 - late) * fast / np.abs(fast).max() + late * slow)
    q *= _blend(t / 3.0)[:, None]
    q += centre
    dq = np.asarray(np.gradient(q, 0.05, axis=0, edge_order=2))
    dq[0] = 0.0
    ddq = np.asarray(np.gradient(dq, 0.05, axis=0, edge_order=2))
    ddq[0] = 0.0
    points = [tuple(tuple(row.tolist()) for row in rows) for rows in zip(q, dq, ddq)]
    return Route(robot.joints, [round(x * 1e9) for x in t], points)  # type: ignore[arg-type]


def _blend(s: Array) -> Array:
    s = np.clip(s, 0.0, 1.0)
    found: Array = s ** 3 * (10.0 - 15.0 * s + 6.0 * s * s)
    return found
