"""
The point of a box that is nearest to a given one in the metric of an inverse inertia.

For M symmetric positive definite, find the z with ``|z_i| <= bound_i`` that makes
½ (z - point)ᵀ M⁻¹ (z - point) least. It exists and is unique. With ``M x = point - z`` its
optimality conditions read, for every i::

    x_i = 0 where |z_i| < bound_i,   x_i >= 0 where z_i = bound_i,   x_i <= 0 where z_i = -bound_i

These are the set-valued friction of joints at rest, and the chattering term of an implicit
switching: `bound` is what a joint can hold, `point` what holds all of them, x how they move.

The method is principal pivoting with the least-index rule, which for a positive definite matrix
visits no set of active bounds twice (Murty, *Linear Complementarity, Linear and Nonlinear
Programming*, 1988; with upper bounds, Júdice & Pires, 1994).
"""

from __future__ import annotations

import numpy as np

from ctc_chattering.numerics.linear_algebra import Array


def nearest(mass: Array, point: Array, bound: Array) -> Array:
    """
    Return the solution z of this module's problem.

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
    #: The bound at which a joint is; 0 for none.
    side = np.sign(point) * (np.abs(point) > bound)
    rounding = -1e-13 * (np.abs(point) + bound).max() / mass.diagonal()
    seen: set[bytes] = set()  # Only rounding can lead back.
    while True:
        seen.add(side.tobytes())
        at = np.flatnonzero(side)
        z, x = np.where(side, side * bound, point), np.zeros(len(point))
        x[at] = np.linalg.solve(mass[np.ix_(at, at)], (point - z)[at])
        z = np.where(side, z, point - mass.dot(x))
        wrong = np.flatnonzero(np.where(side, side * x < rounding, np.abs(z) > bound))
        if wrong.size:
            i = wrong[0]
            side[i] = 0.0 if side[i] else np.sign(z[i])
        if not wrong.size or side.tobytes() in seen:
            return np.minimum(np.maximum(z, -bound), bound)
