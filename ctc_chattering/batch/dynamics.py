"""The terms of equation (1), M(q) ddq + C(q, dq) dq + G(q), of either kind of arm."""

from __future__ import annotations

from ctc_chattering.batch import tree, two_link
from ctc_chattering.batch.arm import Arm, BodyScratch
from ctc_chattering.batch.compiler import compiled, inlined
from ctc_chattering.batch.linear_algebra import factor, substitute
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt

#: 1 for true.
Flags = npt.NDArray[np.int8]


@compiled
def evaluate(arm: Arm, q: Array, dq: Array, s: BodyScratch, M: Array, C: Array, G: Array) -> None:
    """Set M(q), C(q, dq) and G(q), shapes (n, n), (n, n) and (n,)."""
    if len(arm.parent):
        tree.evaluate(arm, q, dq, s, M, C, G)
    else:
        two_link.mass_matrix(arm, q, M)
        two_link.coriolis_matrix(arm, q, dq, C)
        two_link.gravity_torque(arm, q, G)


@compiled
def mass_and_bias(arm: Arm, q: Array, dq: Array, s: BodyScratch) -> None:
    """Set M and C dq + G in the scratch."""
    if len(arm.parent):
        tree.place(arm, q, s)
        tree.weigh(arm, s)
        tree.move(arm, dq, s)
        tree.bias(arm, s, dq, s.bias)
        tree.mass_matrix(arm, s, s.M)
    else:
        two_link.mass_matrix(arm, q, s.M)
        two_link.bias(arm, q, dq, s.bias)


@inlined
def accelerate(u: Array, fixed: Flags, s: BodyScratch, out: Array) -> None:
    """
    Set ddq of (1) under the torque `u`, after `mass_and_bias`.

    Parameters
    ----------
    u : array, shape (n,)
        All torques but C dq and G [N·m].
    fixed : array, shape (n,)
        Joints that are held still by a torque of their own.
    s : BodyScratch
        With M and C dq + G.
    out : array, shape (n,)
        Acceleration [rad/s²].

    """
    n, free = len(u), 0
    for i in range(n):
        out[i] = 0.0
        if not fixed[i]:
            s.rest[free] = u[i] - s.bias[i]
            column = 0
            for j in range(i + 1):
                if not fixed[j]:
                    s.part[free, column] = s.M[i, j]
                    column += 1
            free += 1
    factor(s.part, free, s.lower)
    substitute(s.lower, free, s.rest)
    for i in range(n - 1, -1, -1):
        if not fixed[i]:
            free -= 1
            out[i] = s.rest[free]


@compiled
def forward_dynamics(arm: Arm, q: Array, dq: Array, u: Array, fixed: Flags, s: BodyScratch,
                     out: Array) -> None:
    """Set ddq, shape (n,) [rad/s²]; arguments as of `mass_and_bias` and `accelerate`."""
    mass_and_bias(arm, q, dq, s)
    accelerate(u, fixed, s, out)
