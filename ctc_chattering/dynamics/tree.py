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
M, C and G of a tree of bodies, compilable.

`compiled_model` calls it with an `Arm`, which `UrdfModel.bodies` makes. Plain Python has Pinocchio
(`urdf_model`) for the same terms, and takes this module for tests only.

Everything is in the frame of the base. A motion (ω, v) has the velocity v of the point at the
origin. The motion of joint i is S_i = (z, p x z), or (0, z) of a prismatic one, with the axis z
through p. All that joint j carries has the mass m, the first moment h and the inertia J about the
origin. P is its linear momentum, and W collects the velocity terms of rotation. For each body c
is the centre, ω the rate, and I the inertia about c (Echeandia & Wensing, *Numerical methods to
compute the Coriolis matrix and Christoffel symbols*, 2021)::

    W = Σ ½ (ω̂ I - I ω̂ - (I ω)^) + m ((c · dc) 1 - dc cᵀ),     P = Σ m dc                  (RB1)
    (K, L)   = (J ω + h x v, m v + ω x h)                       of S_j                       (RB2)
    (K', L') = the same of dS_j/dt, plus (W z, z x P)                                        (RB3)
    M_ij = S_i · (K, L),   C_ij = S_i · (K', L')                for i that carries j         (RB4)
    C_ji = (K, L) · dS_i/dt + (Wᵀ z_j + P x v_j) · z_i                                       (RB5)
    G_j  = -S_j · (h x g, m g)                                                               (RB6)

C is that of Christoffel's symbols. C dq + G alone follows from Newton and Euler: the force that
moves each body, added up over all that a joint carries.
"""

from __future__ import annotations

import dataclasses
from math import cos, sin
from typing import Any

from ctc_chattering.compiled.compilable import function
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt


@dataclasses.dataclass
class Arm:
    """
    Numbers of a tree of bodies, or the two-link arm.

    A tree has n bodies, parents first. The frame of a body is at its joint, with the axis of the
    joint along z.
    """

    #: True for the two-link arm, which is in closed form and has no bodies.
    closed: bool
    #: Acceleration of gravity, downwards [m/s²].
    gravity: float
    #: Factor of M, C and G of the two-link arm. A tree has it in its masses.
    scale: float
    #: Body that carries each body, -1 for the base, shape (n,).
    parent: npt.NDArray[np.int64]
    #: True for a prismatic joint, shape (n,).
    prismatic: npt.NDArray[np.bool_]
    #: Index in q, M, C and G of the joint of each body, shape (n,).
    joint: npt.NDArray[np.int64]
    #: Frame of the body at position 0 in that of the parent, shape (n, 3, 3).
    rotation: Array
    #: The same frame's origin, shape (n, 3) [m].
    offset: Array
    #: Shape (n,) [kg].
    mass: Array
    #: Centre of mass in the frame of the body, shape (n, 3) [m].
    center: Array
    #: Inertia about the centre in the frame of the body, symmetric, shape (n, 3, 3) [kg·m²].
    inertia: Array
    #: Inertia of each joint's rotor, on the diagonal of M alone, shape (n,) [kg·m²].
    rotor: Array

    @classmethod
    def two_link(cls, gravity: float, scale: float) -> Arm:
        """Return the two-link arm."""
        zeros = np.zeros(2)
        indices = np.zeros(2, np.int64)
        rows = np.zeros((2, 3))
        squares = np.zeros((2, 3, 3))
        return cls(
            closed=True,
            gravity=gravity,
            scale=scale,
            parent=indices,
            prismatic=np.zeros(2, np.bool_),
            joint=indices,
            rotation=squares,
            offset=rows,
            mass=zeros,
            center=rows,
            inertia=squares,
            rotor=zeros,
        )


@dataclasses.dataclass
class BodyScratch:
    """
    Scratch memory, in the frame of the base.

    Arrays have a row for each body. The last row, the parent -1, is the base, which does not
    move. Its sums are not read. A vector of six is an angular part, then a linear one.
    """

    #: Shape (n + 1, 3, 3).
    rotation: Array
    #: Shape (n + 1, 3).
    origin: Array
    #: Motion S of each joint, shape (n + 1, 6).
    joint: Array
    #: dS/dt, shape (n + 1, 6).
    joint_rate: Array
    #: Shape (n + 1, 6).
    twist: Array
    #: Shape (n + 1, 6).
    acceleration: Array
    #: Of a body, then of all it carries, shape (n + 1,).
    mass: Array
    #: First moment, shape (n + 1, 3).
    moment: Array
    #: Shape (n + 1, 3, 3).
    inertia: Array
    #: W, shape (n + 1, 3, 3).
    coupling: Array
    #: P, shape (n + 1, 3).
    momentum: Array
    #: Moment and force on a body, shape (n + 1, 6).
    force: Array
    #: (K, L) and (K', L') of the body in hand, shape (6,).
    unit_momentum: Array
    unit_momentum_rate: Array
    #: I of the body in hand, shape (3, 3).
    central_inertia: Array
    #: Centre of the body in hand, shape (3,).
    center: Array
    #: A vector in hand, shape (3,).
    vector: Array
    #: State of the joints, shape (n,).
    q: Array
    dq: Array
    #: Terms of (1) at the state, shapes (n, n) and (n,).
    M: Array
    C: Array
    #: C dq + G.
    bias: Array


def body_scratch(n: int) -> BodyScratch:
    """Return scratch for `n` joints."""

    def rows(*shape: int) -> Array:
        return np.zeros((n + 1, *shape))

    scratch = BodyScratch(
        rotation=rows(3, 3),
        origin=rows(3),
        joint=rows(6),
        joint_rate=rows(6),
        twist=rows(6),
        acceleration=rows(6),
        mass=rows(),
        moment=rows(3),
        inertia=rows(3, 3),
        coupling=rows(3, 3),
        momentum=rows(3),
        force=rows(6),
        unit_momentum=np.zeros(6),
        unit_momentum_rate=np.zeros(6),
        central_inertia=np.zeros((3, 3)),
        center=np.zeros(3),
        vector=np.zeros(3),
        q=np.zeros(n),
        dq=np.zeros(n),
        M=np.zeros((n, n)),
        C=np.zeros((n, n)),
        bias=np.zeros(n),
    )
    scratch.rotation[-1] = np.eye(3)
    return scratch


@function
def product(x: Array, y: Array) -> Any:
    """Return x · y of vectors of three."""
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@function
def add_product(total: float, x: Array, y: Array) -> Any:
    """Return `total` plus x · y, term by term."""
    return total + x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@function
def power(motion: Array, force: Array) -> Any:
    """Return the product of a motion and a force."""
    return add_product(product(motion, force), motion[3:], force[3:])


@function
def add_to(x: Array, y: Array) -> None:
    """Add y to x."""
    for a in range(len(x)):
        x[a] += y[a]


@function
def cross(x: Array, y: Array, a: int) -> Any:
    """Return element a of x × y."""
    b = (a + 1) % 3
    c = (a + 2) % 3
    return x[b] * y[c] - x[c] * y[b]


@function
def add_cross(total: float, x: Array, y: Array, a: int) -> Any:
    """Return `total` plus element a of x × y."""
    b = (a + 1) % 3
    c = (a + 2) % 3
    return total + x[b] * y[c] - x[c] * y[b]


@function
def point_inertia(mass: float, center: Array, a: int, b: int) -> Any:
    """Return element (a, b) of m ((c · c) 1 - c cᵀ)."""
    if a != b:
        return -(mass * center[a] * center[b])
    y = center[(a + 1) % 3]
    z = center[(a + 2) % 3]
    return mass * (y * y + z * z)


@function
def set_momentum(s: BodyScratch, i: int, motion: Array, out: Array) -> None:
    """Set (K, L) of (RB2) of a motion."""
    moment = s.moment[i]
    rate = motion[:3]
    velocity = motion[3:]
    for a in range(3):
        out[a] = add_cross(product(s.inertia[i, a], rate), moment, velocity, a)
        out[3 + a] = add_cross(s.mass[i] * velocity[a], rate, moment, a)


@function
def place(arm: Arm, q: Array, s: BodyScratch) -> None:
    """Set rotations, origins and joint motions S."""
    for i in range(len(arm.parent)):
        x = q[arm.joint[i]]
        R = s.rotation[i]
        origin = s.origin[i]
        parent_rotation = s.rotation[arm.parent[i]]
        parent_origin = s.origin[arm.parent[i]]
        for a in range(3):
            origin[a] = add_product(parent_origin[a], parent_rotation[a], arm.offset[i])
            for b in range(3):
                R[a, b] = product(parent_rotation[a], arm.rotation[i, :, b])
        z = R[:, 2]
        S = s.joint[i]
        if arm.prismatic[i]:
            for a in range(3):
                origin[a] += x * z[a]
                S[a] = 0.0
                S[3 + a] = z[a]
        else:
            c = cos(x)
            d = sin(x)
            for a in range(3):
                x_axis = R[a, 0]
                y_axis = R[a, 1]
                R[a, 0] = c * x_axis + d * y_axis
                R[a, 1] = c * y_axis - d * x_axis
                S[a] = z[a]
                S[3 + a] = cross(origin, z, a)


@function
def weigh(arm: Arm, s: BodyScratch) -> None:
    """Set mass, first moment and inertia of all bodies."""
    c = s.center
    row = s.vector
    for i in range(len(arm.parent)):
        R = s.rotation[i]
        m = arm.mass[i]
        s.mass[i] = m
        for a in range(3):
            c[a] = add_product(s.origin[i, a], R[a], arm.center[i])
            s.moment[i, a] = m * c[a]
        for a in range(3):
            for b in range(3):
                row[b] = product(R[a], arm.inertia[i, b])
            for b in range(a, 3):  # R I Rᵀ, about the origin.
                element = product(row, R[b]) + point_inertia(m, c, a, b)
                s.inertia[i, a, b] = s.inertia[i, b, a] = element


@function
def move(arm: Arm, dq: Array, s: BodyScratch) -> None:
    """Set twists of bodies and dS/dt of joints."""
    for i in range(len(arm.parent)):
        S = s.joint[i]
        twist = s.twist[i]
        rate = twist[:3]
        velocity = twist[3:]
        for a in range(6):
            twist[a] = S[a] * dq[arm.joint[i]] + s.twist[arm.parent[i], a]
        for a in range(3):
            s.joint_rate[i, a] = cross(rate, S[:3], a)
            s.joint_rate[i, 3 + a] = add_cross(
                cross(rate, S[3:], a), velocity, S[:3], a
            )


@function
def couple(arm: Arm, s: BodyScratch) -> None:
    """Set W and P of (RB1) of every body."""
    I = s.central_inertia  # noqa: E741
    c = s.center
    for i in range(len(arm.parent)):
        m = s.mass[i]
        h = s.moment[i]
        W = s.coupling[i]
        P = s.momentum[i]
        rate = s.twist[i, :3]
        inverse_mass = 1.0 / m if m else 0.0
        for a in range(3):
            c[a] = inverse_mass * h[a]
            P[a] = add_cross(m * s.twist[i, 3 + a], rate, h, a)
        for a in range(3):
            for b in range(a, 3):
                I[a, b] = I[b, a] = s.inertia[i, a, b] - point_inertia(m, c, a, b)
        for a in range(3):
            W[a, a] = cross(rate, I[a], a) + product(c, P) - P[a] * c[a]
            for b in range(a + 1, 3):
                # ω̂ I - I ω̂ is symmetric, (I ω)^ is skew.
                symmetric = 0.5 * add_cross(cross(rate, I[b], a), rate, I[a], b)
                skew = 0.5 * product(I[3 - a - b], rate)
                if b - a == 2:
                    skew = -skew
                W[a, b] = symmetric + skew - P[a] * c[b]
                W[b, a] = symmetric - skew - P[b] * c[a]


@function
def gather_mass(arm: Arm, s: BodyScratch, i: int) -> None:
    """Add mass, moment and inertia to those of the parent."""
    parent = arm.parent[i]
    s.mass[parent] += s.mass[i]
    add_to(s.moment[parent], s.moment[i])
    for a in range(3):
        add_to(s.inertia[parent, a], s.inertia[i, a])


@function
def gather_velocity_terms(arm: Arm, s: BodyScratch, i: int) -> None:
    """Add W and P to those of the parent."""
    parent = arm.parent[i]
    add_to(s.momentum[parent], s.momentum[i])
    for a in range(3):
        add_to(s.coupling[parent, a], s.coupling[i, a])


@function
def fill_mass(arm: Arm, s: BodyScratch, j: int, M: Array) -> None:
    """
    Set row and column of a joint in M by (RB4).

    `unit_momentum` is then (K, L) of the joint.
    """
    column = arm.joint[j]
    set_momentum(s, j, s.joint[j], s.unit_momentum)
    i = j
    while i >= 0:
        row = arm.joint[i]
        M[row, column] = M[column, row] = power(s.joint[i], s.unit_momentum)
        i = arm.parent[i]
    M[column, column] += arm.rotor[j]


@function
def mass_matrix(arm: Arm, s: BodyScratch, M: Array) -> None:
    """Set M, after `place` and `weigh`."""
    M[:] = 0.0
    for j in range(len(arm.parent) - 1, -1, -1):
        fill_mass(arm, s, j, M)
        gather_mass(arm, s, j)


@function
def evaluate(
    arm: Arm, q: Array, dq: Array, s: BodyScratch, M: Array, C: Array, G: Array
) -> None:
    """Set M, C and G by (RB4) to (RB6)."""
    place(arm, q, s)
    weigh(arm, s)
    move(arm, dq, s)
    couple(arm, s)
    momentum_rate = s.unit_momentum_rate
    turning = s.vector
    M[:] = 0.0
    C[:] = 0.0
    for j in range(len(arm.parent) - 1, -1, -1):
        W = s.coupling[j]
        P = s.momentum[j]
        z = s.joint[j, :3]
        velocity = s.joint[j, 3:]
        column = arm.joint[j]
        fill_mass(arm, s, j, M)
        set_momentum(s, j, s.joint_rate[j], momentum_rate)
        for a in range(3):
            # (K', L') of (RB3), and Wᵀ z + P x v of (RB5).
            momentum_rate[a] += product(W[a], z)
            momentum_rate[3 + a] += cross(z, P, a)
            turning[a] = add_cross(product(W[:, a], z), P, velocity, a)
        # (RB6), with g along -z.
        G[column] = arm.gravity * (cross(z, s.moment[j], 2) + velocity[2] * s.mass[j])
        i = j
        while i >= 0:
            row = arm.joint[i]
            S = s.joint[i]
            # (RB5), then (RB4).
            C[column, row] = add_product(
                power(s.joint_rate[i], s.unit_momentum), turning, S
            )
            C[row, column] = power(S, momentum_rate)
            i = arm.parent[i]
        gather_mass(arm, s, j)
        gather_velocity_terms(arm, s, j)


@function
def bias(arm: Arm, s: BodyScratch, dq: Array, out: Array) -> None:
    """
    Set C dq + G.

    It comes after `place`, `weigh` and `move`, and before `mass_matrix`.
    """
    n = len(arm.parent)
    momentum = s.unit_momentum
    # The base accelerates upwards in place of gravity.
    s.acceleration[n, 5] = arm.gravity
    for i in range(n):
        rate = s.twist[i, :3]
        velocity = s.twist[i, 3:]
        force = s.force[i]
        for a in range(6):
            s.acceleration[i, a] = (
                s.joint_rate[i, a] * dq[arm.joint[i]] + s.acceleration[arm.parent[i], a]
            )
        # Rate of the momentum: that of the acceleration, plus twist x momentum.
        set_momentum(s, i, s.twist[i], momentum)
        set_momentum(s, i, s.acceleration[i], force)
        for a in range(3):
            force[a] += add_cross(
                cross(rate, momentum[:3], a), velocity, momentum[3:], a
            )
            force[3 + a] += cross(rate, momentum[3:], a)
    for i in range(n - 1, -1, -1):
        out[arm.joint[i]] = power(s.joint[i], s.force[i])
        add_to(s.force[arm.parent[i]], s.force[i])
