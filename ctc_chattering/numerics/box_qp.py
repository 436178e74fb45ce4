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
Find the point of a box that is nearest to another point.

The squared distance is vᵀ M⁻¹ v, with M symmetric positive definite. So find the z with
``|z_i| <= bound_i`` that minimises ½ (z - point)ᵀ M⁻¹ (z - point). It exists and is unique. With
``M x = point - z`` its optimality conditions read, for every i::

    x_i = 0 where |z_i| < bound_i,   x_i >= 0 where z_i = bound_i,   x_i <= 0 where z_i = -bound_i

Such problems are the friction of joints at rest (`simulation/friction.py`), the chattering term of
an implicit switching (`control/switching.py`), and the limits of the observers and their laws.
For friction, `bound` is the largest friction torque, `point` the torque that would keep all joints
at rest, and x their acceleration, or its product with a period.

The method is principal pivoting with the least-index rule, which for a positive definite matrix
visits no set of active bounds twice (Murty, *Linear Complementarity, Linear and Nonlinear
Programming*, 1988, and with upper bounds, Júdice & Pires, 1994).
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

#: Changes of the set of active bounds. Random problems of 7 joints took 37 at most. After these
#: z is clipped to the box, and x is no longer that of z.
_MAX_PIVOTS = 200
#: Size of a point from which elimination could overflow. All joints are then put at a bound.
_MAX_SIZE = 1e280
#: Relative tolerance within which a wrong sign of x is put down to rounding.
_ROUNDING = 1e-13


@function
def clip(x: Array, lower: Array | float, upper: Array | float) -> Array:
    """Return `x` within bounds, shape (n,)."""
    return np.minimum(np.maximum(x, lower), upper)


@function
def nearest(mass: Array, point: Array, bound: Array) -> Array:
    """Return z; see `nearest_and_motion`."""
    return nearest_and_motion(mass, point, bound)[0]


@function
def nearest_and_motion(mass: Array, point: Array, bound: Array) -> tuple[Array, Array]:
    """
    Return the solution of this module's problem, z and x, shape (n,).

    Parameters
    ----------
    mass : array, shape (n, n)
        M, symmetric positive definite.
    point : array, shape (n,)
        Within ±1e280 for a solution. Beyond, z is ±bound and x is `point`. Within the box it is
        returned without a copy.
    bound : array, shape (n,)
        From 0 to 1e9 (`parameters.LARGEST`). From 1e15 on, rounding hides wrong signs of x.

    """
    size = np.abs(point)
    inside = size <= bound
    if every(inside):
        return point, 0.0 * point
    side = np.sign(point)
    if not every(size < _MAX_SIZE):
        return side * bound, point
    if not some(inside):  # Usually every joint is then at its bound.
        z = side * bound
        x = solve(mass, point - z)
        if every(side * x >= 0.0):
            return z, x
    # From here on: sign of the bound at which a joint is, 0 if at none.
    side = np.where(inside, 0.0, side)
    tolerance = _ROUNDING * (size + bound).max() / diagonal(mass)
    z = x = point
    for _ in range(_MAX_PIVOTS):
        active = side != 0.0
        z = np.where(active, side * bound, point)
        x = solve_where(active, mass, point - z)
        z = np.where(active, z, point - dot(mass, x))
        wrong = np.where(active, side * x < -tolerance, np.abs(z) > bound)
        if not some(wrong):
            break
        i = first(wrong)
        side = replaced(side, i, 0.0 if active[i] else np.sign(z[i]))
    return clip(z, -bound, bound), x
