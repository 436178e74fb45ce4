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
The point of a box that is nearest to another point.

The metric is that of an inverse inertia. For M symmetric positive definite, find the z with
``|z_i| <= bound_i`` that minimises ½ (z - point)ᵀ M⁻¹ (z - point). It exists and is unique. With
``M x = point - z`` its optimality conditions read, for every i::

    x_i = 0 where |z_i| < bound_i,   x_i >= 0 where z_i = bound_i,   x_i <= 0 where z_i = -bound_i

Two set-valued terms are such problems: the friction of joints at rest (`simulation/friction.py`)
and the chattering term of an implicit switching (`control/switching.py`). `bound` is what a joint
can hold, `point` what holds all of them, x how they move.

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

#: Changes of the set of active bounds. Only rounding can lead beyond.
_MAX_PIVOTS = 200
#: Size of a point beyond which elimination would overflow. It is then clipped.
_MAX_SIZE = 1e280
#: Relative error of a sign that rounding explains.
_ROUNDING = 1e-13


@function
def clip(x: Array, lower: Array, upper: Array) -> Array:
    """Return `x` within bounds, shape (n,)."""
    return np.minimum(np.maximum(x, lower), upper)


@function
def nearest(mass: Array, point: Array, bound: Array) -> Array:
    """Return z; see `nearest_and_motion`."""
    return nearest_and_motion(mass, point, bound)[0]


@function
def nearest_and_motion(mass: Array, point: Array, bound: Array) -> tuple[Array, Array]:
    """
    Return the solution of this module's problem, z and x.

    Parameters
    ----------
    mass : array, shape (n, n)
        M, symmetric positive definite.
    point : array, shape (n,)
        Any values. Within the box it is returned itself.
    bound : array, shape (n,)
        Not negative.

    """
    size = np.abs(point)
    inside = size <= bound
    if every(inside):
        return point, 0.0 * point
    side = np.sign(point)
    if not every(size < _MAX_SIZE):
        return side * bound, point
    if not some(inside):  # Usually all of them are at their bounds.
        z = side * bound
        x = solve(mass, point - z)
        if every(side * x >= 0.0):
            return z, x
    #: Sign of the bound at which a joint is, 0 without one.
    side = np.where(inside, 0.0, side)
    rounding = -_ROUNDING * (size + bound).max() / diagonal(mass)
    z = x = point
    for _ in range(_MAX_PIVOTS):
        active = side != 0.0
        z = np.where(active, side * bound, point)
        x = solve_where(active, mass, point - z)
        z = np.where(active, z, point - dot(mass, x))
        wrong = np.where(active, side * x < rounding, np.abs(z) > bound)
        if not some(wrong):
            break
        i = first(wrong)
        side = replaced(side, i, 0.0 if active[i] else np.sign(z[i]))
    return clip(z, -bound, bound), x
