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

`CompiledArm` runs `set_terms` and `set_mass_and_bias` with an `Arm`, which `UrdfModel.bodies`
makes. Uncompiled runs use Pinocchio (`urdf_model`) for the same terms. Only tests call this module
in plain Python.

Everything is in the frame of the base. A motion (ω, v) has the velocity v of the point at the
origin. The motion of joint i is S_i = (z, p x z), or (0, z) for a prismatic joint, with the
axis z through p. All that joint j carries has the mass m, the first moment h and the inertia J
about the origin. P is its linear momentum, and W collects the velocity terms of rotation. For each
body c is the centre, ω the rate with the skew matrix ω̂, also written ( )^, and I the inertia
about c (Echeandia & Wensing, *Numerical methods to compute the Coriolis matrix and Christoffel
symbols*, 2021)::

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
from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import function, record, replaced, rotated
from ctc_chattering.compiled.records import element_of
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt

#: Row of a vector, below the three of a matrix.
_VECTOR = 3


@dataclasses.dataclass
class Arm:
    """
    Numbers of a tree of n bodies, parents first.

    The frame of a body is at its joint, with the axis of the joint along z.
    """

    #: Acceleration of gravity, downwards [m/s²].
    gravity: float
    #: Body that carries each body, n for the base, shape (n,).
    parent: npt.NDArray[np.int64]
    #: 1 for a prismatic joint, else 0, shape (n,).
    prismatic: npt.NDArray[np.int8]
    #: Index in q, M, C and G of the joint of each body, shape (n,).
    joint: npt.NDArray[np.int64]
    #: Axes of the body at position 0 in the frame of the parent, a row each, shape (n, 3, 3).
    axes: Array
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


class BodyScratch:
    """
    Scratch memory for `n` joints, in the frame of the base.

    Body n is the base, which does not move. Its sums are not read. A matrix has a vector as its
    fourth row.
    """

    def __init__(self, n: int) -> None:

        def bodies(*shape: int) -> Array:
            return np.zeros((n + 1, *shape))

        #: Axes x, y and z of each body, and its origin.
        self.frame = bodies(4, 3)
        self.frame[n, :3] = np.eye(3)
        #: `Spatial`: motion S of each joint, dS/dt, and motion of each body.
        self.joint = bodies(2, 3)
        self.joint_rate = bodies(2, 3)
        self.twist = bodies(2, 3)
        self.acceleration = bodies(2, 3)
        #: `Spatial` force on a body, then on all it carries.
        self.force = bodies(2, 3)
        #: Mass of a body, then of all it carries.
        self.mass = bodies()
        #: Inertia and first moment, in the same way.
        self.inertia = bodies(4, 3)
        #: W and P, in the same way.
        self.coupling = bodies(4, 3)
        #: Matrices of the body that is being processed.
        self.body = np.zeros((2, 3, 3))
        #: State of the joints, shape (n,).
        self.q = np.zeros(n)
        self.dq = np.zeros(n)
        #: M, C, and C dq + G at the state.
        self.M = np.zeros((n, n))
        self.C = np.zeros((n, n))
        self.bias = np.zeros(n)


@record
class Spatial(NamedTuple):
    """Angular and linear part of a motion, momentum or force."""

    angular: Array
    linear: Array


@function
def read(pairs: Array, i: int) -> Spatial:
    """Return the `Spatial` of a body."""
    pair = element_of(pairs, i)
    return Spatial(pair[0], pair[1])


@function
def write(pairs: Array, i: int, angular: Array, linear: Array) -> None:
    """Set the `Spatial` of a body."""
    pair = element_of(pairs, i)
    pair[0] = angular
    pair[1] = linear


@function
def add_product(total: float, x: Array, y: Array) -> Any:
    """Return `total` plus x · y, term by term."""
    terms = x * y
    return total + terms[0] + terms[1] + terms[2]


@function
def motion_dot_force(motion: Spatial, force: Spatial) -> Any:
    """Return the product of a motion and a force."""
    angular = add_product(0.0, motion.angular, force.angular)
    return add_product(angular, motion.linear, force.linear)


@function
def add_cross(total: Any, x: Array, y: Array) -> Array:
    """Return `total` plus x × y, term by term."""
    yzx = rotated(x)
    zxy = rotated(rotated(y))
    subtrahend = rotated(yzx) * rotated(y)
    result: Array = total + yzx * zxy - subtrahend
    return result


@function
def add_rows(total: Any, matrix: Array, x: Array) -> Array:
    """Return `total` plus the sum of rows times x."""
    first = total + x[0] * matrix[0]
    second = first + x[1] * matrix[1]
    third: Array = second + x[2] * matrix[2]
    return third


@function
def mirror(matrix: Array) -> None:
    """Make a matrix symmetric, from its upper triangle."""
    matrix[1] = replaced(matrix[1], 0, matrix[0][1])
    bottom = replaced(matrix[2], 0, matrix[0][2])
    matrix[2] = replaced(bottom, 1, matrix[1][2])


@function
def gather(sums: Array, i: int, parent: int) -> None:
    """Add the rows of a body to those of its parent."""
    total = element_of(sums, parent)
    rows = element_of(sums, i)
    for a in range(sums.shape[1]):
        total[a] = total[a] + rows[a]


@function
def point_inertia(mass: float, center: Array, a: int) -> Array:
    """Return row a of m ((c · c) 1 - c cᵀ)."""
    squares = rotated(center * center)
    diagonal = mass * (squares + rotated(squares))
    row = -(mass * center[a] * center)
    return replaced(row, a, diagonal[a])


@function
def momentum_of(s: BodyScratch, i: int, motion: Spatial) -> Spatial:
    """Return (K, L) of (RB2) of a motion."""
    inertia = element_of(s.inertia, i)
    moment = inertia[_VECTOR]
    angular = add_rows(0.0, inertia, motion.angular)
    linear = s.mass[i] * motion.linear
    return Spatial(
        add_cross(angular, moment, motion.linear),
        add_cross(linear, motion.angular, moment),
    )


@function
def set_frames(arm: Arm, q: Array, s: BodyScratch) -> None:
    """Set frames, and joint motions S."""
    for i in range(len(arm.parent)):
        frame = element_of(s.frame, i)
        parent = element_of(s.frame, arm.parent[i])
        described = element_of(arm.axes, i)
        x = q[arm.joint[i]]
        for a in range(3):
            frame[a] = add_rows(0.0, parent, described[a])
        z = frame[2]
        offset = element_of(arm.offset, i)
        origin = add_rows(parent[_VECTOR], parent, offset)
        if arm.prismatic[i]:
            origin = origin + x * z
            write(s.joint, i, z - z, z)
        else:
            c_x = cos(x)
            s_x = sin(x)
            x_axis = c_x * frame[0] + s_x * frame[1]
            frame[1] = c_x * frame[1] - s_x * frame[0]
            frame[0] = x_axis
            write(s.joint, i, z, add_cross(0.0, origin, z))
        frame[_VECTOR] = origin


@function
def set_inertias(arm: Arm, s: BodyScratch) -> None:
    """Set mass, first moment and inertia of all bodies."""
    turned = element_of(s.body, 0)
    for i in range(len(arm.parent)):
        m = arm.mass[i]
        frame = element_of(s.frame, i)
        described = element_of(arm.inertia, i)
        inertia = element_of(s.inertia, i)
        center = element_of(arm.center, i)
        c = add_rows(frame[_VECTOR], frame, center)
        s.mass[i] = m
        inertia[_VECTOR] = m * c
        for a in range(3):
            turned[a] = add_rows(0.0, frame, described[a])
        for a in range(3):  # R I Rᵀ, about the origin.
            row = turned[0, a] * frame[0]
            row = row + turned[1, a] * frame[1]
            row = row + turned[2, a] * frame[2]
            inertia[a] = row + point_inertia(m, c, a)
        mirror(inertia)


@function
def set_twists(arm: Arm, dq: Array, s: BodyScratch) -> None:
    """Set twists of bodies and dS/dt of joints."""
    for i in range(len(arm.parent)):
        S = read(s.joint, i)
        parent = read(s.twist, arm.parent[i])
        speed = dq[arm.joint[i]]
        rate = speed * S.angular + parent.angular
        velocity = speed * S.linear + parent.linear
        write(s.twist, i, rate, velocity)
        angular = add_cross(0.0, rate, S.angular)
        linear = add_cross(0.0, rate, S.linear)
        write(s.joint_rate, i, angular, add_cross(linear, velocity, S.angular))


@function
def set_coupling(arm: Arm, s: BodyScratch) -> None:
    """Set W and P of (RB1) of every body."""
    unit = element_of(s.frame, len(arm.parent))
    I = element_of(s.body, 0)  # noqa: E741
    turned = element_of(s.body, 1)
    for i in range(len(arm.parent)):
        m = s.mass[i]
        inertia = element_of(s.inertia, i)
        h = inertia[_VECTOR]
        W = element_of(s.coupling, i)
        twist = read(s.twist, i)
        rate = twist.angular
        inverse_mass = 1.0 / m if m else 0.0
        c = inverse_mass * h
        P = add_cross(m * twist.linear, rate, h)
        W[_VECTOR] = P
        for a in range(3):
            point = point_inertia(m, c, a)
            I[a] = inertia[a] - point
        mirror(I)
        for a in range(3):
            turned[a] = add_cross(0.0, rate, I[a])
        for a in range(3):
            # ω̂ I - I ω̂ is symmetric.
            diagonal = add_product(0.0, c, P)
            row = turned[a] + diagonal
            for b in range(a + 1, 3):
                twice = add_cross(turned[b][a], rate, I[a])
                row = replaced(row, b, 0.5 * twice[b])
            W[a] = row
        mirror(W)
        momentum = add_rows(0.0, I, rate)
        spin = 0.5 * momentum
        for a in range(3):
            skew = add_cross(0.0, spin, unit[a])
            W[a] = W[a] + skew - P[a] * c


@function
def gather_mass(arm: Arm, s: BodyScratch, i: int) -> None:
    """Add mass, moment and inertia to those of the parent."""
    parent = arm.parent[i]
    s.mass[parent] += s.mass[i]
    gather(s.inertia, i, parent)


@function
def fill_mass(arm: Arm, s: BodyScratch, j: int, M: Array) -> Spatial:
    """Set row and column of a joint in M by (RB4), and return (K, L)."""
    column = arm.joint[j]
    momentum = momentum_of(s, j, read(s.joint, j))
    i = j
    while i < len(arm.parent):
        row = arm.joint[i]
        S = read(s.joint, i)
        M[row, column] = M[column, row] = motion_dot_force(S, momentum)
        i = arm.parent[i]
    M[column, column] += arm.rotor[j]
    return momentum


@function
def set_terms(arm: Arm, s: BodyScratch, terms: Any) -> int:
    """Set M, C and G of a `StateTerms` by (RB4) to (RB6)."""
    set_frames(arm, terms.q, s)
    set_inertias(arm, s)
    set_twists(arm, terms.dq, s)
    set_coupling(arm, s)
    M = terms.M
    C = terms.C
    M[:] = 0.0
    C[:] = 0.0
    for j in range(len(arm.parent) - 1, -1, -1):
        W = element_of(s.coupling, j)
        P = W[_VECTOR]
        S = read(s.joint, j)
        z = S.angular
        column = arm.joint[j]
        # (RB6), with g along -z.
        moment = element_of(s.inertia, j)[_VECTOR]
        tilting = add_cross(0.0, z, moment)
        lifting = S.linear[2] * s.mass[j]
        terms.G[column] = arm.gravity * (tilting[2] + lifting)
        momentum = fill_mass(arm, s, j, M)
        # (K', L') of (RB3), and Wᵀ z + P x v of (RB5).
        spin = z
        for a in range(3):
            spin = replaced(spin, a, add_product(0.0, W[a], z))
        rate = momentum_of(s, j, read(s.joint_rate, j))
        drift = add_cross(0.0, z, P)
        rate = Spatial(rate.angular + spin, rate.linear + drift)
        turning = add_rows(0.0, W, z)
        turning = add_cross(turning, P, S.linear)
        i = j
        while i < len(arm.parent):
            row = arm.joint[i]
            S = read(s.joint, i)
            # (RB5), then (RB4).
            linear = motion_dot_force(read(s.joint_rate, i), momentum)
            C[column, row] = add_product(linear, turning, S.angular)
            C[row, column] = motion_dot_force(S, rate)
            i = arm.parent[i]
        gather_mass(arm, s, j)
        gather(s.coupling, j, arm.parent[j])
    return 0


@function
def set_mass_and_bias(arm: Arm, s: BodyScratch) -> int:
    """Set M and C dq + G of a scratch."""
    n = len(arm.parent)
    set_frames(arm, s.q, s)
    set_inertias(arm, s)
    set_twists(arm, s.dq, s)
    # The base accelerates upwards in place of gravity.
    s.acceleration[n, 1, 2] = arm.gravity
    for i in range(n):
        twist = read(s.twist, i)
        S_rate = read(s.joint_rate, i)
        parent = read(s.acceleration, arm.parent[i])
        speed = s.dq[arm.joint[i]]
        acceleration = Spatial(
            S_rate.angular * speed + parent.angular,
            S_rate.linear * speed + parent.linear,
        )
        write(s.acceleration, i, acceleration.angular, acceleration.linear)
        # Rate of the momentum: that of the acceleration, plus twist x momentum.
        momentum = momentum_of(s, i, twist)
        force = momentum_of(s, i, acceleration)
        angular = add_cross(0.0, twist.angular, momentum.angular)
        angular = add_cross(angular, twist.linear, momentum.linear)
        linear = add_cross(0.0, twist.angular, momentum.linear)
        write(s.force, i, force.angular + angular, force.linear + linear)
    s.M[:] = 0.0
    for i in range(n - 1, -1, -1):
        S = read(s.joint, i)
        s.bias[arm.joint[i]] = motion_dot_force(S, read(s.force, i))
        gather(s.force, i, arm.parent[i])
        fill_mass(arm, s, i, s.M)
        gather_mass(arm, s, i)
    return 0
