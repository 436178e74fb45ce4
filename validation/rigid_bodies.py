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
Rigid-body dynamics of a tree of joints, independent of this package, as machine code.

All vectors are at the origin of the world and along its axes: a velocity is (w, v), with v that of
the point at the origin; a force is (moment about the origin, force). Pinocchio reads the URDF.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numba
import numpy as np
import numpy.typing as npt
import pinocchio as pin

Array = npt.NDArray[np.float64]
#: A function that is compiled once, and kept beside this file.
compiled = numba.njit(cache=True, error_model='numpy')


class Bodies(NamedTuple):
    """
    A tree of n moving bodies, one a joint.

    Attributes
    ----------
    parent : ndarray, shape (n,)
        Index of the body that carries the joint, -1 for the world.
    turn, place : ndarray, shape (n, 3, 3) and (n, 3)
        Pose of the joint in its parent at 0.
    axis : ndarray, shape (n, 3)
        Of the joint.
    slides : ndarray, shape (n,)
        1 for a prismatic joint, else 0.
    mass, centre, inertia : ndarray, shapes (n,), (n, 3), (n, 3, 3)
        Of the body: centre of mass, and inertia about it, along the axes of the joint.
    gravity : ndarray, shape (3,)
        [m/s²].
    more : ndarray, shape (n, n)
        Constant part of the mass matrix that no body has, such as that of the rotors.

    """

    parent: npt.NDArray[np.int64]
    turn: Array
    place: Array
    axis: Array
    slides: npt.NDArray[np.int64]
    mass: Array
    centre: Array
    inertia: Array
    gravity: Array
    more: Array


def bodies_of(urdf: str, joints: Sequence[str], gravity: float = 9.81,
              locked: Mapping[str, float] | None = None) -> Bodies:
    """Return the bodies of a URDF, in the order of `joints`; other joints are locked, at 0."""
    whole: Any = pin.buildModelFromXML(urdf)
    at = pin.neutral(whole)
    for name, value in (locked or {}).items():
        at[whole.joints[whole.getJointId(name)].idx_q] = value
    others = [k for k in range(1, whole.njoints) if whole.names[k] not in joints]
    model: Any = pin.buildReducedModel(whole, others, at)
    place = [model.getJointId(name) for name in joints]
    if sorted(place) != place:
        raise ValueError(f'{joints}: from the base on, please')
    index = {k: i for i, k in enumerate(place)}
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    kinds = [model.joints[k].shortname() for k in place]
    axes = [_axis(model, k) for k in place]
    return Bodies(
        np.array([index.get(model.parents[k], -1) for k in place]),
        np.array([model.jointPlacements[k].rotation for k in place]),
        np.array([model.jointPlacements[k].translation for k in place]), np.array(axes),
        np.array([int('P' in kind.removeprefix('JointModel')[0]) for kind in kinds]),
        np.array([model.inertias[k].mass for k in place]),
        np.array([model.inertias[k].lever for k in place]),
        np.array([model.inertias[k].inertia for k in place]),
        np.array([0.0, 0.0, -gravity]), np.zeros((len(place), len(place))))


#: Of the paper's arm, as `planar` has them.
PAPER = (8.77, 0.51, 0.76, 0.62, 7.6, 0.63)


def planar(a: float, b: float, c: float, d: float, g1: float, g2: float, gravity: float = 9.81
           ) -> Bodies:
    """
    Return bodies of two equal lengths with M and G of the paper; at 0 they hang.

    M11 = a + 2 b cos q2, M12 = c + b cos q2, M22 = d, and G = g (g1 sin q1 + g2 sin(q1 + q2),
    g2 sin(q1 + q2)). Two bodies have c = d; the rest of c is in `more`.
    """
    length = b / g2
    half = 0.5 * length
    mass = np.array([(g1 - g2 / half * length) / half, g2 / half])
    about = np.array([a - d - mass[1] * length ** 2, d]) - mass * half ** 2
    zero, down = np.zeros(2), np.array([0.0, 0.0, -1.0])
    return Bodies(
        np.array([-1, 0]), np.array([np.eye(3)] * 2), np.outer([0.0, length], down),
        np.outer([1.0, 1.0], [0.0, -1.0, 0.0]), zero.astype(int), mass,
        np.outer([half, half], down), about[:, None, None] * np.eye(3), gravity * down,
        (c - d) * (1.0 - np.eye(2)))


def _axis(model: Any, k: int) -> Array:
    """Return the axis of a joint, from its Jacobian in its own frame."""
    data = model.createData()
    columns = pin.computeJointJacobian(model, data, pin.neutral(model), k).reshape(6, model.nv)
    column = columns[:, model.idx_vs[k]]
    found: Array = column[:3] + column[3:]
    return found


@compiled
def add_cross(a: Array, b: Array, out: Array) -> None:
    """Add a x b."""
    out[0] += a[1] * b[2] - a[2] * b[1]
    out[1] += a[2] * b[0] - a[0] * b[2]
    out[2] += a[0] * b[1] - a[1] * b[0]


@compiled
def placed(bodies: Bodies, q: Array, motion: Array, first: Array, inertia: Array) -> None:
    """
    Write axes and inertias for positions q.

    `motion`, shape (n, 6), has (w, v) of each joint at unit speed; `first`, shape (n, 3), the
    mass times the centre, and `inertia`, shape (n, 3, 3), that about the origin, of each body.
    """
    n = len(q)
    turn, place = np.empty((n, 3, 3)), np.empty((n, 3))
    local, own, centre = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for i in range(n):
        p = bodies.parent[i]
        axis = bodies.axis[i]
        c, s = (1.0, 0.0) if bodies.slides[i] else (np.cos(q[i]), np.sin(q[i]))
        x, y, z = axis[0], axis[1], axis[2]
        local[0, 0], local[0, 1], local[0, 2] = (
            c + x * x * (1 - c), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s)
        local[1, 0], local[1, 1], local[1, 2] = (
            y * x * (1 - c) + z * s, c + y * y * (1 - c), y * z * (1 - c) - x * s)
        local[2, 0], local[2, 1], local[2, 2] = (
            z * x * (1 - c) - y * s, z * y * (1 - c) + x * s, c + z * z * (1 - c))
        for a in range(3):
            for b in range(3):
                own[a, b] = 0.0
                for k in range(3):
                    own[a, b] += bodies.turn[i, a, k] * local[k, b]
        for a in range(3):
            place[i, a] = bodies.place[i, a] if p < 0 else place[p, a]
            for b in range(3):
                turn[i, a, b] = own[a, b] if p < 0 else 0.0
                if p >= 0:
                    for k in range(3):
                        turn[i, a, b] += turn[p, a, k] * own[k, b]
                    place[i, a] += turn[p, a, b] * bodies.place[i, b]
        along = motion[i]
        for a in range(3):
            along[a] = 0.0
            for b in range(3):
                along[a] += turn[i, a, b] * axis[b]
        if bodies.slides[i]:
            for a in range(3):
                along[3 + a], along[a] = along[a], 0.0
                place[i, a] += along[3 + a] * q[i]
        else:
            along[3:] = 0.0
            add_cross(place[i], along[:3], along[3:])
        for a in range(3):
            centre[a] = place[i, a]
            for b in range(3):
                centre[a] += turn[i, a, b] * bodies.centre[i, b]
                own[a, b] = 0.0
                for k in range(3):
                    own[a, b] += turn[i, a, k] * bodies.inertia[i, k, b]
        m, square = bodies.mass[i], 0.0
        for a in range(3):
            first[i, a] = m * centre[a]
            square += centre[a] * centre[a]
        for a in range(3):
            for b in range(3):
                value = -m * centre[a] * centre[b] + (m * square if a == b else 0.0)
                for k in range(3):
                    value += own[a, k] * turn[i, b, k]
                inertia[i, a, b] = value


@compiled
def times(mass: float, first: Array, inertia: Array, v: Array, out: Array) -> None:
    """Write the inertia of a body times a velocity v, shape (6,)."""
    for a in range(3):
        out[a] = inertia[a, 0] * v[0] + inertia[a, 1] * v[1] + inertia[a, 2] * v[2]
    out[0] += first[1] * v[5] - first[2] * v[4]
    out[1] += first[2] * v[3] - first[0] * v[5]
    out[2] += first[0] * v[4] - first[1] * v[3]
    out[3] = mass * v[3] - first[1] * v[2] + first[2] * v[1]
    out[4] = mass * v[4] - first[2] * v[0] + first[0] * v[2]
    out[5] = mass * v[5] - first[0] * v[1] + first[1] * v[0]


@compiled
def dynamics(bodies: Bodies, q: Array, dq: Array, matrix: Array, bias: Array) -> None:
    """Write M(q), shape (n, n), and C dq + G, shape (n,)."""
    n = len(q)
    motion, first = np.empty((n, 6)), np.empty((n, 3))
    inertia, mass = np.empty((n, 3, 3)), bodies.mass.copy()
    placed(bodies, q, motion, first, inertia)
    v, acc, force = np.zeros((n, 6)), np.zeros((n, 6)), np.empty((n, 6))
    step, moved = np.empty(6), np.empty(6)
    for i in range(n):
        p = bodies.parent[i]
        for a in range(6):
            v[i, a] = (v[p, a] if p >= 0 else 0.0) + motion[i, a] * dq[i]
            step[a] = motion[i, a] * dq[i]
            acc[i, a] = acc[p, a] if p >= 0 else (-bodies.gravity[a - 3] if a > 2 else 0.0)
        add_cross(v[i, :3], step[:3], acc[i, :3])
        add_cross(v[i, :3], step[3:], acc[i, 3:])
        add_cross(v[i, 3:], step[:3], acc[i, 3:])
        times(mass[i], first[i], inertia[i], acc[i], force[i])
        times(mass[i], first[i], inertia[i], v[i], moved)
        add_cross(v[i, :3], moved[:3], force[i, :3])
        add_cross(v[i, 3:], moved[3:], force[i, :3])
        add_cross(v[i, :3], moved[3:], force[i, 3:])
    for i in range(n - 1, -1, -1):
        p = bodies.parent[i]
        bias[i] = np.dot(motion[i], force[i])
        times(mass[i], first[i], inertia[i], motion[i], moved)
        for j in range(i + 1):
            matrix[i, j] = 0.0
        j = i
        while j >= 0:
            matrix[i, j] = np.dot(motion[j], moved)
            j = bodies.parent[j]
        for j in range(i + 1):
            matrix[i, j] += bodies.more[i, j]
            matrix[j, i] = matrix[i, j]
        if p >= 0:
            mass[p] += mass[i]
            for a in range(6):
                force[p, a] += force[i, a]
            for a in range(3):
                first[p, a] += first[i, a]
                for b in range(3):
                    inertia[p, a, b] += inertia[i, a, b]
