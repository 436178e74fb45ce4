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

from ctc_chattering.compiled.compilable import (
    diagonal,
    dot,
    every,
    first,
    function,
    replaced,
    solve,
    solve_where,
    some,
)
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Changes of the set of active bounds; only rounding can lead beyond.
_MOST_CHANGES = 200


@function
def nearest(mass: Array, point: Array, bound: Array) -> Array:
    """Return the solution z of this module's problem, as `nearest_and_rest` has it."""
    return nearest_and_rest(mass, point, bound)[0]


@function
def nearest_and_rest(mass: Array, point: Array, bound: Array) -> tuple[Array, Array]:
    """
    Return the solution z of this module's problem, and x.

    Parameters
    ----------
    mass : array, shape (n, n)
        M, symmetric positive definite.
    point : array, shape (n,)
        Any values; within the box it is returned itself.
    bound : array, shape (n,)
        Not negative.

    """
    size = np.abs(point)
    inside = size <= bound
    if every(inside):
        return point, 0.0 * point
    side = np.sign(point)
    if not every(size < 1e280):  # The elimination below would overflow.
        return side * bound, point
    if not some(inside):  # Most often all of them are at their bounds.
        z = side * bound
        x = solve(mass, point - z)
        if every(side * x >= 0.0):
            return z, x
    #: The bound at which a joint is; 0 for none.
    side = np.where(inside, 0.0, side)
    rounding = -1e-13 * (size + bound).max() / diagonal(mass)
    z = x = point
    for _ in range(_MOST_CHANGES):
        active = side != 0.0
        z = np.where(active, side * bound, point)
        x = solve_where(active, mass, point - z)
        z = np.where(active, z, point - dot(mass, x))
        wrong = np.where(active, side * x < rounding, np.abs(z) > bound)
        if not some(wrong):
            break
        i = first(wrong)
        side = replaced(side, i, 0.0 if active[i] else np.sign(z[i]))
    return np.minimum(np.maximum(z, -bound), bound), x
