"""
Coulomb friction as a set, as `simulation/friction.py` has it: which joints stick, which slide.

The mode of a joint is +1 or -1 if it slides, 0 if it sticks or has no friction.
"""

from __future__ import annotations

import dataclasses
from math import inf

from ctc_chattering.batch.arm import BodyScratch
from ctc_chattering.batch.compiler import compiled, inlined
from ctc_chattering.batch.dynamics import accelerate, Flags
from ctc_chattering.batch.linear_algebra import factor, invert, substitute
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.records import value, write
import numpy as np
import numpy.typing as npt

#: A load that rounding alone lifts above Kf breaks no joint away.
_HOLD = 1.0 + 1e-12


@dataclasses.dataclass
class FrictionScratch:
    """Scratch of this module; arrays of shape (n,) and (n, n)."""

    load: Array
    acceleration: Array
    free: Flags
    #: Numbers in the arm of the joints at rest, and their inertia.
    rest: npt.NDArray[np.int64]
    compact: Array
    #: Inertia, torque that holds a joint, and Kf; of the others 1, 0 and 0.
    mass: Array
    holding: Array
    bound: Array
    inverse: Array
    lower: Array


def friction_scratch(n: int) -> FrictionScratch:
    """Return scratch for `n` joints."""
    return FrictionScratch(
        np.zeros(n), np.zeros(n), np.zeros(n, np.int8), np.zeros(n, np.int64), np.zeros((n, n)),
        np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros((n, n)), np.zeros((n, n)))


@inlined
def excess(load: Array, breakaway: Array, fixed: Flags, a: Array, s: BodyScratch) -> float:
    """
    Return how far the load of the most loaded fixed joint is beyond Kf [N·m].

    Parameters
    ----------
    load, breakaway : array, shape (n,)
        Torque less the friction of the joints that slide, and Kf [N·m].
    fixed : array, shape (n,)
        Joints that stick.
    a : array, shape (n,)
        Scratch.
    s : BodyScratch
        With M and C dq + G.

    """
    n, worst = len(load), -inf
    accelerate(load, fixed, s, a)
    for i in range(n):
        if fixed[i]:
            need = s.bias[i]
            for j in range(n):
                need += s.M[i, j] * a[j]
            worst = max(worst, abs(load[i] - need) - _HOLD * breakaway[i])
    return worst


@compiled
def decide(dq: Array, u: Array, breakaway: Array, s: BodyScratch, w: FrictionScratch,
           mode: npt.NDArray[np.int64], fixed: Flags) -> None:
    """
    Set the mode of every joint, and which of them stick.

    Parameters
    ----------
    dq, u : array, shape (n,)
        Velocity [rad/s] and torque without friction [N·m].
    breakaway : array, shape (n,)
        Breakaway torque Kf [N·m].
    s : BodyScratch
        With M and C dq + G at the state.
    w : FrictionScratch
        Scratch.
    mode, fixed : array, shape (n,)
        To be set.

    """
    n, count = len(dq), 0
    for i in range(n):
        sliding = breakaway[i] > 0.0 and dq[i] != 0.0
        mode[i] = int(np.sign(dq[i])) if sliding else 0
        fixed[i] = breakaway[i] > 0.0 and not sliding
        w.load[i] = u[i] - breakaway[i] * mode[i]
        if fixed[i]:
            w.rest[count] = i
            count += 1
    if count == 0 or excess(w.load, breakaway, fixed, w.acceleration, s) <= 0.0:
        return
    _inertia_at_rest(s, w, count)
    for i in range(n):
        w.free[i] = 0
    accelerate(w.load, w.free, s, w.acceleration)
    for i in range(n):
        w.holding[i], w.bound[i] = 0.0, breakaway[i] if fixed[i] else 0.0
        for j in range(n):
            if fixed[i] and fixed[j]:
                w.holding[i] += w.mass[i, j] * w.acceleration[j]
    write(w.holding, nearest(value(w.mass), value(w.holding), value(w.bound)))
    for i in range(n):
        if fixed[i] and abs(w.holding[i]) >= w.bound[i]:
            mode[i] = 1 if w.holding[i] > 0.0 else -1
            fixed[i] = 0


@inlined
def _inertia_at_rest(s: BodyScratch, w: FrictionScratch, count: int) -> None:
    """Set the inertia of the joints at rest, the others being free to move."""
    n = len(w.load)
    factor(s.M, n, s.lower)
    for j in range(count):
        for i in range(n):
            w.inverse[j, i] = 1.0 if i == w.rest[j] else 0.0
        substitute(s.lower, n, w.inverse[j])
    for i in range(count):
        for j in range(count):
            s.part[i, j] = w.inverse[i, w.rest[j]]
    invert(s.part, count, w.lower, w.compact)
    for i in range(n):
        for j in range(n):
            w.mass[i, j] = 1.0 if i == j else 0.0
    for i in range(count):
        for j in range(count):
            w.mass[w.rest[i], w.rest[j]] = w.compact[i, j]
