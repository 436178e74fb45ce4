"""
The point of a box nearest to a given one in the metric of an inverse inertia.

Problem and method are those of `numerics/box_qp.py`, in place and without allocation.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ctc_chattering.batch.compiler import compiled
from ctc_chattering.batch.linear_algebra import factor, substitute
from ctc_chattering.numerics.linear_algebra import Array

#: Changes of the set of bounds that are active; only rounding can lead beyond.
_MOST_CHANGES = 1000


@dataclasses.dataclass
class BoxScratch:
    """Scratch of `nearest`; arrays of shape (n,) and (n, n)."""

    side: Array
    x: Array
    z: Array
    part: Array
    lower: Array


def box_scratch(n: int) -> BoxScratch:
    """Return scratch for `n` joints."""
    return BoxScratch(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((n, n)), np.zeros((n, n)))


@compiled
def nearest(mass: Array, point: Array, bound: Array, n: int, s: BoxScratch, out: Array) -> bool:
    """
    Set `out` to the nearest point; return whether it is not `point` itself.

    Parameters
    ----------
    mass : array, shape (n, n)
        M, symmetric positive definite; its first `n` rows, as of all arrays here.
    point, bound : array, shape (n,)
        Any values, and the bounds, which are not negative.
    n : int
        Number of unknowns.
    s : BoxScratch
        Scratch.
    out : array, shape (n,)
        May be `point`.

    """
    beyond, largest, size = False, 0.0, 0.0
    for i in range(n):
        beyond |= not abs(point[i]) <= bound[i]
        largest = max(largest, abs(point[i]))
        size = max(size, abs(point[i]) + bound[i])
        s.side[i] = np.sign(point[i]) if abs(point[i]) > bound[i] else 0.0
        s.z[i] = point[i]
    if not beyond or not largest < 1e280:  # The elimination below would overflow.
        for i in range(n):
            out[i] = point[i] if not beyond else np.sign(point[i]) * bound[i]
        return beyond
    for _ in range(_MOST_CHANGES):
        _solve_on_sides(mass, point, bound, n, s)
        wrong = -1
        for i in range(n):
            rounding = -1e-13 * size / mass[i, i]
            if (s.side[i] * s.x[i] < rounding) if s.side[i] else (abs(s.z[i]) > bound[i]):
                wrong = i
                break
        if wrong < 0:
            break
        s.side[wrong] = 0.0 if s.side[wrong] else np.sign(s.z[wrong])
    for i in range(n):
        out[i] = min(max(s.z[i], -bound[i]), bound[i])
    return True


@compiled
def _solve_on_sides(mass: Array, point: Array, bound: Array, n: int, s: BoxScratch) -> None:
    """Set z and x of the optimality conditions where some unknowns are on their bounds."""
    count = 0
    for i in range(n):
        s.z[i] = s.side[i] * bound[i] if s.side[i] else point[i]
        if s.side[i]:
            s.x[count] = point[i] - s.z[i]
            column = 0
            for j in range(i + 1):
                if s.side[j]:
                    s.part[count, column] = mass[i, j]
                    column += 1
            count += 1
    factor(s.part, count, s.lower)
    substitute(s.lower, count, s.x)
    for i in range(n - 1, -1, -1):  # From the back, so that none is overwritten before its use.
        if s.side[i]:
            count -= 1
            s.x[i] = s.x[count]
        else:
            s.x[i] = 0.0
    for i in range(n):
        if not s.side[i]:
            for j in range(n):
                if s.side[j]:
                    s.z[i] -= mass[i, j] * s.x[j]
