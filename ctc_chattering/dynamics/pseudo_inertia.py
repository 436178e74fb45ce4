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
Inertial parameters of a body as one symmetric matrix.

The prior of `ctc identify` and the corrected URDF need to know which parameters a rigid body can
have. With the mass m, the first moment h and the inertia I about the same point, the
pseudo-inertia is the second moment of the mass over (x, y, z, 1):

    J = [[½ tr(I) 1 - I, h], [hᵀ, m]] = ∫ (r, 1) (r, 1)ᵀ dm                               (PI1)

A body can have these parameters if, and only if, J is positive semidefinite (Wensing, Kim and
Slotine, 2018; Traversaro et al., 2016). That covers mass, principal moments and the triangle
inequality.
"""

from __future__ import annotations

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Rows and columns of the upper triangle of J, column by column.
_UPPER = np.tril_indices(4)[::-1]
#: √2 off the diagonal. With it, the product of two vectors is that of their matrices.
_STRETCH = np.where(np.equal(*_UPPER), 1.0, np.sqrt(2.0))
#: Least eigenvalue of the reference body of `unit`, in its own units.
_REFERENCE_FLOOR = 0.01
#: Mass of a reference body whose model has none, relative to the heaviest body.
_REFERENCE_MASS_RATIO = 0.1
#: Length of a reference body whose model has no extent [m].
_REFERENCE_LENGTH_M = 0.05
#: Least length in `is_possible` [m]. It avoids a division by zero.
_LEAST_LENGTH_M = 1e-6
#: Negative eigenvalues of J above this, in the body's units, are rounding.
_EIGENVALUE_ROUNDING = 1e-12


def pseudo_inertia(parameters: Array) -> Array:
    """Return J of ten parameters in Pinocchio's order."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = parameters
    half_trace = 0.5 * (xx + yy + zz)
    return np.array(
        [
            [half_trace - xx, -xy, -xz, x],
            [-xy, half_trace - yy, -yz, y],
            [-xz, -yz, half_trace - zz, z],
            [x, y, z, m],
        ]
    )


def parameters_of(matrix: Array) -> Array:
    """Return the parameters, shape (10,), of a J."""
    (sxx, sxy, sxz, x), (_, syy, syz, y), (_, _, szz, z), (_, _, _, m) = matrix
    return np.array([m, x, y, z, syy + szz, -sxy, sxx + szz, -sxz, -syz, sxx + syy])


def is_possible(matrix: Array) -> bool:
    """Return whether a body can have this J."""
    mass = matrix[3, 3]
    if not mass > 0.0:
        return False
    square = np.trace(matrix[:3, :3]) / mass
    length = np.sqrt(max(square, _LEAST_LENGTH_M**2))
    units = _units(mass, length)
    eigenvalues = np.linalg.eigvalsh(matrix / np.outer(units, units))
    return bool(eigenvalues[0] > -_EIGENVALUE_ROUNDING)


def _units(mass: float, length: float) -> Array:
    """Return the units of J: it is over their outer product."""
    units: Array = np.array([length] * 3 + [1.0]) * np.sqrt(mass)
    return units


def stacked(matrix: Array) -> Array:
    """Return the elements of symmetric matrices, shape (..., 10)."""
    return matrix[..., _UPPER[0], _UPPER[1]] * _STRETCH


def symmetric(elements: Array) -> Array:
    """Return the symmetric matrix of `stacked` elements."""
    matrix = np.zeros((4, 4))
    matrix[_UPPER] = matrix.T[_UPPER] = elements / _STRETCH
    return matrix


def unit(prior: Array, heaviest: float) -> Array:
    """
    Return S, which makes changes of a body comparable.

    With S of shape (4, 4), J is that of the model plus S X Sᵀ. An X of size 1 changes the body by
    as much as itself, in any coordinates. This is the metric of Lee, Wensing and Park (2020) at
    the model's body. A direction in which the model has no extent gets a small one.

    Parameters
    ----------
    prior : ndarray, shape (10,)
        Parameters of the model.
    heaviest : float
        Mass of the heaviest body [kg].

    """
    matrix = pseudo_inertia(prior)
    mass = max(prior[0], 0.0) or _REFERENCE_MASS_RATIO * heaviest
    square = np.trace(matrix[:3, :3]) / mass
    length = np.sqrt(max(square, 0.0)) or _REFERENCE_LENGTH_M
    units = _units(mass, length)
    values, vectors = np.linalg.eigh(matrix / np.outer(units, units))
    # S is any matrix with S Sᵀ = J. A triangular one, or one with scales, does as well.
    root: Array = (
        units[:, None] * vectors * np.sqrt(np.maximum(values, _REFERENCE_FLOOR))
    )
    return root
