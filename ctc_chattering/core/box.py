"""
A strictly monotone box-constrained problem, solved exactly for any n in bounded time.

Find z in the box ``|z_i| <= bound_i`` such that, with ``w = A z + b`` and A symmetric positive
definite, for every i::

    w_i = 0 where |z_i| < bound_i,   w_i >= 0 where z_i = -bound_i,   w_i <= 0 where z_i = bound_i

These are the optimality conditions of min ½ zᵀ A z + bᵀ z over the box: the solution exists and
is unique. It is the set-valued friction of joints at rest.

The method is principal pivoting with the least-index rule, which for a positive definite matrix
visits no set of active bounds twice (Murty, *Linear Complementarity, Linear and Nonlinear
Programming*, 1988; with upper bounds, Júdice & Pires, 1994).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ctc_chattering.core.linear_algebra import Array, dot, Rows, solve, Vector


def solve_box(a: Rows, b: Vector, bound: Vector) -> list[float]:
    """
    Solve the box problem of this module.

    Parameters
    ----------
    a : sequence of rows, shape (n, n)
        Symmetric positive definite.
    b : sequence of float, shape (n,)
        Any values.
    bound : sequence of float, shape (n,)
        Not negative.

    Returns
    -------
    list of float, shape (n,)
        The solution z.

    """
    n = len(b)
    if n == 1:
        return [min(max(-b[0] / a[0][0], -bound[0]), bound[0])]
    scale = [1e-13 * (abs(b[i]) + dot([abs(x) for x in a[i]], bound)) for i in range(n)]
    side = [0] * n
    z = _pivot(a, b, bound, side)
    for _ in range(3 ** n):
        wrong = _least_wrong(a, b, bound, side, z, scale)
        if wrong is None:
            break
        i, side[i] = wrong
        z = _pivot(a, b, bound, side)
    return [min(max(x, -limit), limit) for x, limit in zip(z, bound)]


def nearest(mass: Array, point: Array, bound: Array) -> Array:
    """
    Return z in the box that is nearest to `point` in the metric of the inverse of `mass`.

    It is the solution of this module's problem with A = M⁻¹ and b = -A point, found without A:
    with ``x = -w`` it reads ``M x = point - z``, and x_i is 0 wherever z_i is not at its bound,
    so that each pivot solves for the joints at their bounds only.

    Parameters
    ----------
    mass : array, shape (n, n)
        M, symmetric positive definite.
    point : array, shape (n,)
        Any values; within the box it is returned itself.
    bound : array, shape (n,)
        Not negative.

    """
    if (np.abs(point) <= bound).all():
        return point
    if not np.abs(point).max() < 1e280:  # The elimination below would overflow.
        return np.sign(point) * bound
    return np.array(_nearest(mass.tolist(), point.tolist(), bound.tolist()))


def _nearest(mass: Rows, wanted: Vector, bound: Vector) -> list[float]:
    """Return what `nearest` does, pivot by pivot."""
    side = [(x > k) - (x < -k) for x, k in zip(wanted, bound)]
    size = 1e-13 * max(abs(x) + k for x, k in zip(wanted, bound))
    seen: set[tuple[int, ...]] = set()  # Only rounding can lead back.
    while True:
        seen.add(tuple(side))
        at = [i for i, s in enumerate(side) if s]
        z = [s * k if s else x for s, k, x in zip(side, bound, wanted)]
        x = solve([[mass[i][j] for j in at] for i in at], [wanted[i] - z[i] for i in at])
        for i, s in enumerate(side):
            if not s:
                row = mass[i]
                for j, y in zip(at, x):
                    z[i] -= row[j] * y
        wrong = _least_misplaced(side, z, dict(zip(at, x)), bound, size, mass)
        if wrong is None:
            break
        i, side[i] = wrong
        if tuple(side) in seen:
            break
    return [min(max(x, -k), k) for x, k in zip(z, bound)]


def _least_misplaced(side: Sequence[int], z: Vector, x: Mapping[int, float], bound: Vector,
                     size: float, mass: Rows) -> tuple[int, int] | None:
    """Return the first index that is on a wrong side in `nearest`, and the side to try."""
    for i, s in enumerate(side):
        if not s:
            if abs(z[i]) > bound[i]:
                return i, 1 if z[i] > 0.0 else -1
        elif s * x[i] * mass[i][i] < -size:
            return i, 0
    return None


def _pivot(a: Rows, b: Vector, bound: Vector, side: Sequence[int]) -> list[float]:
    """Return z with z_i at the bound that side_i names, and w_i = 0 where side_i is 0."""
    z = [s * limit for s, limit in zip(side, bound)]
    free = [i for i, s in enumerate(side) if s == 0]
    if free:
        part = solve([[a[i][j] for j in free] for i in free],
                     [-b[i] - dot(a[i], z) for i in free])
        for i, value in zip(free, part):
            z[i] = value
    return z


def _least_wrong(a: Rows, b: Vector, bound: Vector, side: Sequence[int], z: Vector,
                 scale: Vector) -> tuple[int, int] | None:
    """Return the first index whose condition fails and the side it should change to."""
    for i, s in enumerate(side):
        if s == 0:
            if abs(z[i]) > bound[i]:
                return i, 1 if z[i] > 0.0 else -1
        elif s * (dot(a[i], z) + b[i]) > scale[i]:
            return i, 0
    return None
