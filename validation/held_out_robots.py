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

"""Robots of the held-out conditions, with motions that they can do; nothing is of the package."""

from __future__ import annotations

from functools import cache
import importlib.metadata
from pathlib import Path
from typing import NamedTuple

from independent_arm import Arm, equations
import numpy as np
import pinocchio as pin
from rigid_bodies import Array, Bodies, bodies_of
import urdfs

#: Of the paper's arm, as `Arm.numbers` has them.
PAPER = np.array([8.77, 0.51, 0.76, 0.62, 7.6, 0.63, 9.81])
#: Its largest torques [N·m] and velocities [rad/s].
_PAPER_EFFORT, _PAPER_SPEED = (600.0, 120.0), (6.0, 6.0)
_BAXTER = tuple(f'left_{x}' for x in ('s0', 's1', 'e0', 'e1', 'w0', 'w1', 'w2'))
#: File, joints and centre of the motion [rad] of each robot.
_ROBOTS: dict[str, tuple[str, tuple[str, ...], tuple[float, ...]]] = {
    'two_link': ('', ('joint1', 'joint2'), (np.pi, np.pi / 2)),
    'panda': ('panda', urdfs.PANDA, (0.0, -0.4, 0.0, -1.8, 0.0, 1.8, 0.5)),
    'ur3': ('ur3_robot', urdfs.UR5, (0.0, -1.0, 1.0, -1.0, -1.5, 0.0)),
    'ur5': ('ur5_robot', urdfs.UR5, (0.0, -1.0, 1.0, -1.0, -1.5, 0.0)),
    'ur10': ('ur10_robot', urdfs.UR5, (0.0, -1.0, 1.0, -1.0, -1.5, 0.0)),
    'z1': ('z1', tuple(f'joint{i}' for i in range(1, 7)), (0.0, 1.4, -1.4, 0.0, 0.0, 0.0)),
    'kinova': ('kinova', tuple(f'j2s6s200_joint_{i}' for i in range(1, 7)),
               (0.0, 2.6, 1.6, 0.0, 1.0, 0.0)),
    'xarm7': ('xarm7', tuple(f'joint{i}' for i in range(1, 8)),
              (0.0, -0.3, 0.0, 1.2, 0.0, 1.0, 0.0)),
    'baxter': ('baxter', _BAXTER, (0.0, -0.4, 0.0, 1.0, 0.0, 0.6, 0.0))}
NAMES = tuple(_ROBOTS)
#: Span of a window in which a change of torque is counted as a rate [s].
_WINDOW = 0.05


class Robot(NamedTuple):
    """A robot as its lab knows it; tuples have a number for each joint."""

    name: str
    urdf: str
    joints: tuple[str, ...]
    centre: tuple[float, ...]
    effort: tuple[float, ...]
    speed: tuple[float, ...]

    @property
    def n(self) -> int:
        """Return the number of joints."""
        return len(self.joints)


@cache
def robot(name: str) -> Robot:
    """Return a robot by its name."""
    file, joints, centre = _ROBOTS[name]
    if not file:
        return Robot(name, '', joints, centre, _PAPER_EFFORT, _PAPER_SPEED)
    files = importlib.metadata.files('example-robot-data') or []
    found = next(x for x in files if x.name == f'{file}.urdf' and 'collision' not in x.name)
    urdf = Path(str(found.locate())).read_text(encoding='utf-8')
    model = pin.buildModelFromXML(urdf)
    at = [model.joints[model.getJointId(x)].idx_v for x in joints]
    return Robot(name, urdf, joints, centre, tuple(model.effortLimit[at].tolist()),
                 tuple(model.velocityLimit[at].tolist()))


@cache
def nominal(name: str) -> tuple[Bodies, Array]:
    """Return the bodies and numbers that a robot's lab believes, as `Arm` has them."""
    known = robot(name)
    if known.urdf:
        return bodies_of(known.urdf, known.joints), np.zeros(0)
    empty, vector = np.zeros((2, 3, 3)), np.zeros((2, 3))
    return Bodies(np.full(2, -1), empty, vector, vector, np.zeros(2, np.int64), np.zeros(2),
                  vector, empty, np.zeros(3), np.zeros((2, 2))), PAPER


class Path3(NamedTuple):
    """A motion at its samples; q, dq and ddq have the shape (N, n)."""

    q: Array
    dq: Array
    ddq: Array
    #: Intervals in which it rests, shape (k, 2) [s].
    rest: Array


def sinusoid(t: Array, centre: Array, size: Array, frequency: Array, phase: Array) -> Path3:
    """Return sinusoids of each joint."""
    w = 2.0 * np.pi * frequency
    angle = np.outer(t, w) + phase
    return Path3(centre + size * np.sin(angle), size * w * np.cos(angle),
                 -size * w * w * np.sin(angle), np.zeros((0, 2)))


def trapezoids(t: Array, centre: Array, size: Array, move: float, stop: float) -> Path3:
    """Return moves to and fro of `move` [s], a third of it for each ramp, with stops between."""
    cycle = move + stop
    k = np.floor(t / cycle)
    s, ramp = np.minimum(t - k * cycle, move) / move, 1.0 / 3.0
    peak = 1.0 / (1.0 - ramp)
    early, late = s < ramp, s >= 1.0 - ramp
    way = np.where(early, 0.5 * peak / ramp * s * s, np.where(
        late, 1.0 - 0.5 * peak / ramp * (1.0 - s) ** 2, peak * (s - 0.5 * ramp)))
    speed = np.where(early, peak / ramp * s, np.where(late, peak / ramp * (1.0 - s), peak))
    moves = t - k * cycle < move
    push = np.where(moves, np.where(early, peak / ramp, np.where(late, -peak / ramp, 0.0)), 0.0)
    sign = np.where(k % 2 == 0, 1.0, -1.0)
    starts = np.arange(0.0, t[-1], cycle)
    return Path3(
        centre + np.outer(sign * (2.0 * way - 1.0), size),
        np.outer(sign * np.where(moves, 2.0 * speed / move, 0.0), size),
        np.outer(sign * 2.0 * push / move ** 2, size),
        np.array([[x + move + 0.3, x + cycle] for x in starts]))


def begun(path: Path3, t: Array, start: Array, duration: float) -> Path3:
    """Return a motion that begins smoothly at a position: q = (1 - σ) start + σ path."""
    s = np.minimum(t / duration, 1.0)[:, np.newaxis]
    a, da = s ** 3 * (10.0 - 15.0 * s + 6.0 * s * s), 30.0 * (s * (1.0 - s)) ** 2 / duration
    dda = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / duration ** 2
    gap = path.q - start
    return Path3(start + a * gap, da * gap + a * path.dq,
                 dda * gap + 2.0 * da * path.dq + a * path.ddq, path.rest)


def needed(arm: Arm, t: Array, path: Path3) -> tuple[Array, Array]:
    """Return the largest torque without friction, and its largest rate over 50 ms."""
    n, every = path.q.shape[1], max(int(0.01 / (t[1] - t[0])), 1)
    mass, bias, torques = np.zeros((n, n)), np.zeros(n), []
    for k in range(0, len(t), every):
        equations(arm, path.q[k], path.dq[k], mass, bias)
        torques.append(mass @ path.ddq[k] + bias)
    tau, span = np.array(torques), max(int(_WINDOW / (every * (t[1] - t[0]))), 1)
    change = np.abs(tau[span:] - tau[:-span]).max(axis=0) / _WINDOW
    return np.abs(tau).max(axis=0), change
