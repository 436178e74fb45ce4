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
M, C and G of a tree of bodies, from placements and inertias: what compiled code has.

Plain Python has Pinocchio (`urdf_model`), and takes this for tests only.

Everything is in the frame of the base. A motion (ω, v) has the velocity v of the point at the
origin; the motion of joint i is S_i = (z, p x z), or (0, z) of a prismatic one, with the axis z
through p. Of all that joint j carries, m, h and J are the mass, the first moment and the inertia
about the origin, P the linear momentum, and W collects the velocity terms of rotation. With the
velocity of each body's centre c, its rate ω and its inertia I about c (Echeandia & Wensing,
*Numerical methods to compute the Coriolis matrix and Christoffel symbols*, 2021)::

    W = Σ ½ (ω̂ I - I ω̂ - (I ω)^) + m ((c · dc) 1 - dc cᵀ),     P = Σ m dc                  (RB1)
    (K, L)   = (J ω + h x v, m v + ω x h)                       of S_j                       (RB2)
    (K', L') = the same of dS_j/dt, plus (W z, z x P)                                        (RB3)
    M_ij = S_i · (K, L),   C_ij = S_i · (K', L')                for i that carries j         (RB4)
    C_ji = (K, L) · dS_i/dt + (Wᵀ z_j + P x v_j) · z_i                                       (RB5)
    G_j  = -S_j · (h x g, m g)                                                               (RB6)

C is that of Christoffel's symbols. C dq + G alone is found by Newton and Euler: the force that
moves each body, added up over what a joint carries.
"""

from __future__ import annotations

import dataclasses
from math import cos, sin

from ctc_chattering.compiled.compilable import function
from ctc_chattering.dynamics.urdf_model import Arm
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Row and column of the six elements of an inertia that is kept.
_ROW, _COLUMN = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)


@dataclasses.dataclass
class BodyScratch:
    """
    Scratch of the dynamics of a tree, all in the frame of the base and about its origin.

    Vectors of 3 are rows: position, angular part, linear part. The last row, the parent -1, is the
    base, which does not move; what is added up there is not read.
    """

    #: Rotation (n + 1, 3, 3) and origin of every body.
    rotation: Array
    origin: Array
    #: Motion of each joint (6), its rate of change (6), twist (6) and acceleration (6).
    joint: Array
    joint_rate: Array
    twist: Array
    acceleration: Array
    #: Mass, first moment, inertia (6: xx, yy, zz, xy, xz, yz), of a body, then of all it carries.
    mass: Array
    moment: Array
    inertia: Array
    #: Velocity terms of the Coriolis matrix: W (3, 3) and linear momentum.
    coupling: Array
    momentum: Array
    #: Force on a body: moment and force (6).
    force: Array
    #: State of the joints; M, C and C dq + G there.
    q: Array
    dq: Array
    M: Array
    C: Array
    bias: Array


def body_scratch(n: int) -> BodyScratch:
    """Return scratch for `n` joints."""
    def rows(*shape: int) -> Array:
        return np.zeros((n + 1, *shape))
    made = BodyScratch(
        rows(3, 3), rows(3), rows(6), rows(6), rows(6), rows(6), rows(), rows(3), rows(6),
        rows(3, 3), rows(3), rows(6), *(np.zeros(shape) for shape in (n, n, (n, n), (n, n), n)))
    made.rotation[-1] = np.eye(3)
    return made


@function
def place(arm: Arm, q: Array, s: BodyScratch) -> None:
    """Set rotations, origins and the motions S of all joints."""
    for i in range(len(arm.parent)):
        p, R, F = arm.parent[i], s.rotation[i], arm.rotation[i]
        x, Q, o = q[arm.joint[i]], s.rotation[p], arm.offset[i]
        for a in range(3):
            s.origin[i, a] = (s.origin[p, a] + Q[a, 0] * o[0] + Q[a, 1] * o[1]
                              + Q[a, 2] * o[2])
            for b in range(3):
                R[a, b] = Q[a, 0] * F[0, b] + Q[a, 1] * F[1, b] + Q[a, 2] * F[2, b]
        zx, zy, zz = R[0, 2], R[1, 2], R[2, 2]
        S = s.joint[i]
        if arm.prismatic[i]:
            S[0] = S[1] = S[2] = 0.0
            S[3], S[4], S[5] = zx, zy, zz
            for a in range(3):
                s.origin[i, a] += x * R[a, 2]
            continue
        c, d = cos(x), sin(x)
        for a in range(3):
            R[a, 0], R[a, 1] = c * R[a, 0] + d * R[a, 1], c * R[a, 1] - d * R[a, 0]
        px, py, pz = s.origin[i, 0], s.origin[i, 1], s.origin[i, 2]
        S[0], S[1], S[2] = zx, zy, zz
        S[3], S[4], S[5] = py * zz - pz * zy, pz * zx - px * zz, px * zy - py * zx


@function
def weigh(arm: Arm, s: BodyScratch) -> None:
    """Set mass, first moment and inertia of every body about the origin."""
    for i in range(len(arm.parent)):
        R, A, m, o = s.rotation[i], arm.inertia[i], arm.mass[i], arm.center[i]
        cx = s.origin[i, 0] + R[0, 0] * o[0] + R[0, 1] * o[1] + R[0, 2] * o[2]
        cy = s.origin[i, 1] + R[1, 0] * o[0] + R[1, 1] * o[1] + R[1, 2] * o[2]
        cz = s.origin[i, 2] + R[2, 0] * o[0] + R[2, 1] * o[1] + R[2, 2] * o[2]
        s.mass[i] = m
        s.moment[i, 0], s.moment[i, 1], s.moment[i, 2] = m * cx, m * cy, m * cz
        J = s.inertia[i]
        for e in range(6):                                            # R A Rᵀ
            a, b = _ROW[e], _COLUMN[e]
            x = R[a, 0] * A[0, 0] + R[a, 1] * A[0, 1] + R[a, 2] * A[0, 2]
            y = R[a, 0] * A[0, 1] + R[a, 1] * A[1, 1] + R[a, 2] * A[1, 2]
            z = R[a, 0] * A[0, 2] + R[a, 1] * A[1, 2] + R[a, 2] * A[2, 2]
            J[e] = x * R[b, 0] + y * R[b, 1] + z * R[b, 2]
        J[0] += m * (cy * cy + cz * cz)
        J[1] += m * (cx * cx + cz * cz)
        J[2] += m * (cx * cx + cy * cy)
        J[3] -= m * cx * cy
        J[4] -= m * cx * cz
        J[5] -= m * cy * cz


@function
def move(arm: Arm, dq: Array, s: BodyScratch) -> None:
    """Set the twist of every body, and dS/dt of every joint."""
    for i in range(len(arm.parent)):
        p, S, V, D, x = (arm.parent[i], s.joint[i], s.twist[i], s.joint_rate[i],
                         dq[arm.joint[i]])
        for a in range(6):
            V[a] = S[a] * x + s.twist[p, a]
        D[0] = V[1] * S[2] - V[2] * S[1]
        D[1] = V[2] * S[0] - V[0] * S[2]
        D[2] = V[0] * S[1] - V[1] * S[0]
        D[3] = V[1] * S[5] - V[2] * S[4] + V[4] * S[2] - V[5] * S[1]
        D[4] = V[2] * S[3] - V[0] * S[5] + V[5] * S[0] - V[3] * S[2]
        D[5] = V[0] * S[4] - V[1] * S[3] + V[3] * S[1] - V[4] * S[0]


@function
def couple(arm: Arm, s: BodyScratch) -> None:
    """Set W and P of (RB1) of every body."""
    for i in range(len(arm.parent)):
        m, h, J, V, W, P = (s.mass[i], s.moment[i], s.inertia[i], s.twist[i], s.coupling[i],
                            s.momentum[i])
        wx, wy, wz = V[0], V[1], V[2]
        P[0] = m * V[3] + wy * h[2] - wz * h[1]
        P[1] = m * V[4] + wz * h[0] - wx * h[2]
        P[2] = m * V[5] + wx * h[1] - wy * h[0]
        k = 1.0 / m if m else 0.0
        cx, cy, cz = k * h[0], k * h[1], k * h[2]
        # About the centre.
        xx, yy, zz = (J[0] - m * (cy * cy + cz * cz), J[1] - m * (cx * cx + cz * cz),
                      J[2] - m * (cx * cx + cy * cy))
        xy, xz, yz = J[3] + m * cx * cy, J[4] + m * cx * cz, J[5] + m * cy * cz
        lx, ly, lz = (0.5 * (xx * wx + xy * wy + xz * wz), 0.5 * (xy * wx + yy * wy + yz * wz),
                      0.5 * (xz * wx + yz * wy + zz * wz))
        dot = cx * P[0] + cy * P[1] + cz * P[2]
        # ω̂ I - I ω̂ is symmetric.
        W[0, 0] = wy * xz - wz * xy + dot - P[0] * cx
        W[1, 1] = wz * xy - wx * yz + dot - P[1] * cy
        W[2, 2] = wx * yz - wy * xz + dot - P[2] * cz
        e = 0.5 * (wy * yz - wz * yy + wz * xx - wx * xz)
        W[0, 1], W[1, 0] = e + lz - P[0] * cy, e - lz - P[1] * cx
        e = 0.5 * (wy * zz - wz * yz + wx * xy - wy * xx)
        W[0, 2], W[2, 0] = e - ly - P[0] * cz, e + ly - P[2] * cx
        e = 0.5 * (wz * xz - wx * zz + wx * yy - wy * xy)
        W[1, 2], W[2, 1] = e + lx - P[1] * cz, e - lx - P[2] * cy


@function
def gather(arm: Arm, s: BodyScratch, i: int, moving: bool) -> None:
    """Add what body `i` carries to what its parent carries; with `moving`, W and P as well."""
    p = arm.parent[i]
    s.mass[p] += s.mass[i]
    for a in range(3):
        s.moment[p, a] += s.moment[i, a]
    for a in range(6):
        s.inertia[p, a] += s.inertia[i, a]
    if moving:
        for a in range(3):
            s.momentum[p, a] += s.momentum[i, a]
            for b in range(3):
                s.coupling[p, a, b] += s.coupling[i, a, b]


@function
def momentum_of(m: float, h: Array, J: Array, S: Array) -> tuple[
        float, float, float, float, float, float]:
    """Return (K, L) of (RB2)."""
    x, y, z, u, v, w = S[0], S[1], S[2], S[3], S[4], S[5]
    return (J[0] * x + J[3] * y + J[4] * z + h[1] * w - h[2] * v,
            J[3] * x + J[1] * y + J[5] * z + h[2] * u - h[0] * w,
            J[4] * x + J[5] * y + J[2] * z + h[0] * v - h[1] * u,
            m * u + y * h[2] - z * h[1], m * v + z * h[0] - x * h[2],
            m * w + x * h[1] - y * h[0])


@function
def mass_matrix(arm: Arm, s: BodyScratch, M: Array) -> None:
    """Set M by (RB4), after `place` and `weigh`."""
    for j in range(len(arm.parent) - 1, -1, -1):
        x, y, z, u, v, w = momentum_of(s.mass[j], s.moment[j], s.inertia[j], s.joint[j])
        i = j
        while i >= 0:
            S = s.joint[i]
            M[arm.joint[i], arm.joint[j]] = M[arm.joint[j], arm.joint[i]] = (
                S[0] * x + S[1] * y + S[2] * z + S[3] * u + S[4] * v + S[5] * w)
            i = arm.parent[i]
        M[arm.joint[j], arm.joint[j]] += arm.rotor[j]
        gather(arm, s, j, False)


@function
def evaluate(arm: Arm, q: Array, dq: Array, s: BodyScratch, M: Array, C: Array, G: Array) -> None:
    """Set M, C and G by (RB4) to (RB6); joints that do not carry each other have 0."""
    place(arm, q, s)
    weigh(arm, s)
    move(arm, dq, s)
    couple(arm, s)
    for i in range(len(G)):
        for j in range(len(G)):
            M[i, j] = C[i, j] = 0.0
    for j in range(len(arm.parent) - 1, -1, -1):
        m, h, J, S, D, W, P, b = (s.mass[j], s.moment[j], s.inertia[j], s.joint[j],
                                  s.joint_rate[j], s.coupling[j], s.momentum[j], arm.joint[j])
        x, y, z, u, v, w = momentum_of(m, h, J, S)
        dx, dy, dz, du, dv, dw = momentum_of(m, h, J, D)
        dx += W[0, 0] * S[0] + W[0, 1] * S[1] + W[0, 2] * S[2]
        dy += W[1, 0] * S[0] + W[1, 1] * S[1] + W[1, 2] * S[2]
        dz += W[2, 0] * S[0] + W[2, 1] * S[1] + W[2, 2] * S[2]
        du += S[1] * P[2] - S[2] * P[1]
        dv += S[2] * P[0] - S[0] * P[2]
        dw += S[0] * P[1] - S[1] * P[0]
        tx = W[0, 0] * S[0] + W[1, 0] * S[1] + W[2, 0] * S[2] + P[1] * S[5] - P[2] * S[4]
        ty = W[0, 1] * S[0] + W[1, 1] * S[1] + W[2, 1] * S[2] + P[2] * S[3] - P[0] * S[5]
        tz = W[0, 2] * S[0] + W[1, 2] * S[1] + W[2, 2] * S[2] + P[0] * S[4] - P[1] * S[3]
        G[b] = arm.gravity * (S[0] * h[1] - S[1] * h[0] + S[5] * m)
        i = j
        while i >= 0:
            a, S, D = arm.joint[i], s.joint[i], s.joint_rate[i]
            M[a, b] = M[b, a] = (
                S[0] * x + S[1] * y + S[2] * z + S[3] * u + S[4] * v + S[5] * w)
            C[b, a] = (D[0] * x + D[1] * y + D[2] * z + D[3] * u + D[4] * v + D[5] * w
                       + tx * S[0] + ty * S[1] + tz * S[2])
            C[a, b] = (S[0] * dx + S[1] * dy + S[2] * dz + S[3] * du + S[4] * dv + S[5] * dw)
            i = arm.parent[i]
        M[b, b] += arm.rotor[j]
        gather(arm, s, j, True)


@function
def bias(arm: Arm, s: BodyScratch, dq: Array, out: Array) -> None:
    """Set C dq + G, after `place`, `weigh` and `move`, before `mass_matrix`."""
    n = len(arm.parent)
    s.acceleration[n, 5] = arm.gravity
    for i in range(n):
        p, D, V, A, f, h = (arm.parent[i], s.joint_rate[i], s.twist[i], s.acceleration[i],
                            s.force[i], s.moment[i])
        for a in range(6):
            A[a] = D[a] * dq[arm.joint[i]] + s.acceleration[p, a]
        x, y, z, u, v, w = momentum_of(s.mass[i], h, s.inertia[i], V)
        f[0], f[1], f[2], f[3], f[4], f[5] = momentum_of(s.mass[i], h, s.inertia[i], A)
        f[0] += V[1] * z - V[2] * y + V[4] * w - V[5] * v
        f[1] += V[2] * x - V[0] * z + V[5] * u - V[3] * w
        f[2] += V[0] * y - V[1] * x + V[3] * v - V[4] * u
        f[3] += V[1] * w - V[2] * v
        f[4] += V[2] * u - V[0] * w
        f[5] += V[0] * v - V[1] * u
    for i in range(n - 1, -1, -1):
        p, S, f = arm.parent[i], s.joint[i], s.force[i]
        out[arm.joint[i]] = (S[0] * f[0] + S[1] * f[1] + S[2] * f[2] + S[3] * f[3]
                             + S[4] * f[4] + S[5] * f[5])
        for a in range(6):
            s.force[p, a] += f[a]
