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
The ten inertial parameters of a body as one symmetric matrix.

With the mass m, the first moment h and the inertia I about the same point, the pseudo-inertia is
the second moment of the mass over (x, y, z, 1):

    J = [[½ tr(I) 1 - I, h], [hᵀ, m]] = ∫ (r, 1) (r, 1)ᵀ dm                               (PI1)

A body can have these parameters if, and only if, J is positive semidefinite (Wensing, Kim and
Slotine, 2018; Traversaro et al., 2016): mass, principal moments and the triangle inequality at
once.
"""

from __future__ import annotations

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Rows and columns of the elements of a symmetric matrix of four, column by column.
ROW, COLUMN = (np.array(x) for x in zip(*((i, j) for j in range(4) for i in range(j + 1))))
#: √2 off the diagonal: with it, the product of two vectors is that of their matrices.
_STRETCH = np.where(ROW == COLUMN, 1.0, np.sqrt(2.0))
#: Least eigenvalue of a reference, with its own mass and length as units.
_FLOOR = 0.01
#: Its mass, where the model has none, as a part of the largest [1], and its radius [m].
_PART, _RADIUS = 0.1, 0.05


def pseudo_inertia(parameters: Array) -> Array:
    """Return J, shape (4, 4), of parameters in the order of `PARAMETERS`, shape (10,)."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = parameters
    half = 0.5 * (xx + yy + zz)
    return np.array([[half - xx, -xy, -xz, x], [-xy, half - yy, -yz, y],
                     [-xz, -yz, half - zz, z], [x, y, z, m]])


def parameters_of(matrix: Array) -> Array:
    """Return the parameters, shape (10,), of a J."""
    (sxx, sxy, sxz, x), (_, syy, syz, y), (_, _, szz, z), (_, _, _, m) = matrix
    return np.array([m, x, y, z, syy + szz, -sxy, sxx + szz, -sxz, -syz, sxx + syy])


def stacked(matrix: Array) -> Array:
    """Return the elements of symmetric matrices, shape (..., 10)."""
    found: Array = matrix[..., ROW, COLUMN] * _STRETCH
    return found


def symmetric(elements: Array) -> Array:
    """Return the symmetric matrix, shape (4, 4), of `stacked` elements."""
    found = np.zeros((4, 4))
    found[ROW, COLUMN] = found[COLUMN, ROW] = elements / _STRETCH
    return found


def unit(prior: Array, heaviest: float) -> Array:
    """
    Return S, shape (4, 4), that makes changes of a body comparable: J = J of the model + S X S.

    X of size 1 is a change as large as the body itself, in whatever coordinates: the metric of
    Lee, Wensing and Park (2020) at the model's body. Directions in which the model has no extent,
    or what no body can have, get a little.

    Parameters
    ----------
    prior : ndarray, shape (10,)
        Parameters of the model.
    heaviest : float
        Mass of the heaviest body [kg].

    """
    matrix = pseudo_inertia(prior)
    mass = max(prior[0], 0.0) or _PART * heaviest
    length = np.sqrt(max(np.trace(matrix[:3, :3]) / mass, 0.0)) or _RADIUS
    scale = np.array([length] * 3 + [1.0]) * np.sqrt(mass)
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    # S is any matrix with S Sᵀ = J; a triangular one, or one with scales, does as well.
    root: Array = scale[:, None] * vectors * np.sqrt(np.maximum(values, _FLOOR))
    return root
