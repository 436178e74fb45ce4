"""M, C and G of the paper's two-link arm, as `dynamics/two_link.py` has them."""

from __future__ import annotations

from math import cos, sin

from ctc_chattering.batch.arm import Arm
from ctc_chattering.batch.compiler import inlined
from ctc_chattering.numerics.linear_algebra import Array


@inlined
def mass_matrix(arm: Arm, q: Array, M: Array) -> None:
    """Set M(q), shape (2, 2)."""
    scale, c2 = arm.inertia_scale, cos(q[1])
    M[0, 0] = scale * (8.77 + 1.02 * c2)
    M[0, 1] = M[1, 0] = scale * (0.76 + 0.51 * c2)
    M[1, 1] = scale * 0.62


@inlined
def coriolis_matrix(arm: Arm, q: Array, dq: Array, C: Array) -> None:
    """Set C(q, dq), shape (2, 2)."""
    k = arm.inertia_scale * 0.51 * sin(q[1])
    C[0, 0], C[0, 1] = -k * dq[1], -k * (dq[0] + dq[1])
    C[1, 0], C[1, 1] = k * dq[0], 0.0


@inlined
def gravity_torque(arm: Arm, q: Array, G: Array) -> None:
    """Set G(q), shape (2,)."""
    g = arm.gravity_scale * arm.gravity
    G[1] = 0.63 * g * sin(q[0] + q[1])
    G[0] = 7.6 * g * sin(q[0]) + G[1]


@inlined
def bias(arm: Arm, q: Array, dq: Array, out: Array) -> None:
    """Set C(q, dq) dq + G(q), shape (2,)."""
    gravity_torque(arm, q, out)
    k = arm.inertia_scale * 0.51 * sin(q[1])
    out[0] -= k * dq[1] * (dq[0] + dq[0] + dq[1])
    out[1] += k * dq[0] * dq[0]
