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
Inertial parameters that bodies can have, as near to the data as possible.

With x = the model's + T y, where |y| = 1 is a change as large as a body itself,

    min (x - x̂)ᵀ A (x - x̂) + w yᵀ y   over J(x) ⪰ ε J of the model, rotor inertia ≥ 0      (PC1)

A is the information of the data, x̂ their estimate. w is so small that data which show anything
decide, and directions that they do not show stay as the model has them. It is a semidefinite
program (Sousa and Cortesão, 2014; Wensing, Kim and Slotine, 2018). If the solution without bounds
keeps them, no solver is needed.
"""

from __future__ import annotations

import dataclasses
import importlib
from typing import Any

from ctc_chattering.dynamics.pseudo_inertia import (
    parameters_of,
    pseudo_inertia,
    stacked,
    symmetric,
    unit,
)
from ctc_chattering.errors import CtcError, MachineError
from ctc_chattering.identification.regression.body_estimate import BodyEstimate
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.linalg import block_diag, solve_triangular  # type: ignore[import-untyped]
from scipy.stats import chi2  # type: ignore[import-untyped]

#: w: how far from the model parameters are expected, in bodies.
_EXPECTED = 3.0
#: ε, and the part of what is expected below which a rotor has no inertia.
_LEAST, _NOTHING = 1e-4, 1e-3
#: How sure, how far beyond that, and by which part of a joint's torque a model is wrong.
_SURE, _CLEAR, _PART = 0.999, 2.0, 0.01
#: Standard errors above which gravity is turned, and its least turn [rad].
_TURNED, _LEVEL = 4.0, 3e-4
#: Turn of gravity that is expected [rad], and part of its strength, which is known.
_TURN, _STRENGTH = 0.05, 1e-7


@dataclasses.dataclass(frozen=True)
class ConsistentBodies:
    """
    Parameters that bodies can have.

    Attributes
    ----------
    estimate : BodyEstimate
        What the data ask for.
    parameters : ndarray, shape (B, 10)
        `PARAMETERS` of each body.
    rotor : ndarray, shape (R,)
        Inertias of the rotors [kg·m²].
    gravity : ndarray, shape (G,)
        In the frame of the base [m/s²].
    wanted : ndarray, shape (P,)
        What fits best without bounds, and is nearest to the model otherwise.
    covariance : ndarray, shape (P, P)
        Of all parameters, without bounds; what is not shown has the large one from before any
        data.
    unit : ndarray, shape (P, P)
        Covariance of changes that are as large as the bodies.
    cost : ndarray, shape (B + R,)
        By how much the bounds of each body, and rotor, raise twice the negative logarithm of the
        likelihood.

    """

    estimate: BodyEstimate
    parameters: Array
    rotor: Array
    gravity: Array
    wanted: Array
    covariance: Array
    unit: Array
    cost: Array

    @property
    def found(self) -> Array:
        """Return all parameters, shape (P,)."""
        return np.concatenate((self.parameters.ravel(), self.rotor, self.gravity))

    @property
    def differ(self) -> bool:
        """Whether they are clearly not those of the model: by the data, and by the torque."""
        change = self.found - self.estimate.known
        size = float(change @ self.estimate.information @ change)
        shown = np.linalg.matrix_rank(self.estimate.information, hermitian=True)
        part = self.torque(change) > _PART * self.torque(self.found)
        return size > _CLEAR * chi2.ppf(_SURE, shown) and bool(part.any())

    @property
    def tilt(self) -> Array:
        """Return gravity, shape (3,); that of the model where a turn of it is not clear."""
        change = self.gravity - self.estimate.gravity_prior
        size = float(np.linalg.norm(change))
        # Each direction over its own error: across the plane of an arm gravity is not shown.
        power = float(change @ np.linalg.pinv(self.covariance[-3:, -3:], 1e-15, True) @ change)
        clear = power > _TURNED ** 2 and size > _LEVEL * float(np.linalg.norm(self.gravity))
        return self.gravity if clear else self.estimate.gravity_prior

    def torque(self, change: Array) -> Array:
        """Return the root mean square of each joint's torque by a change, shape (n,) [N·m]."""
        found: Array = np.sqrt(np.maximum(
            np.einsum('p,ipq,q->i', change, self.estimate.torque, change), 0.0))
        return found


def consistent(estimate: BodyEstimate) -> ConsistentBodies:
    """
    Return the parameters that bodies can have and that fit best.

    Raises
    ------
    MachineError
        If bounds bite and Clarabel is not installed.
    CtcError
        If there are numbers that are not finite, the information is negative or too large for
        what is expected beside it, or the solver finds no solution.

    """
    known = np.concatenate((estimate.prior.ravel(), estimate.rotor_prior, estimate.gravity_about))
    if not all(np.isfinite(x).all() for x in (known, estimate.found, estimate.information)):
        raise CtcError('the estimate of inertial parameters is not finite')
    roots = _units(estimate.prior)
    count = len(roots)
    T = block_diag(*(_change(S) for S in roots), np.diag(_rotors(estimate)),
                   _turns(estimate.gravity_about))
    information = T.T @ estimate.information @ T
    information = 0.5 * (information + information.T)
    H = information + np.eye(len(known)) / _EXPECTED ** 2
    lower = _root(H)
    wanted = np.linalg.solve(H, T.T @ estimate.information @ (estimate.found - known))
    bounds = np.concatenate([
        *(stacked(_inside(S, x) - _LEAST * np.eye(4)) for S, x in zip(roots, estimate.prior)),
        estimate.rotor_prior / _rotors(estimate)])
    y, cost = wanted, np.zeros(count + len(estimate.rotor))
    if not _keeps(bounds + wanted[:len(bounds)], count):
        y, cost = _solve(lower, wanted, bounds, count)
    parameters, rotor, gravity = np.split(known + T @ y, [10 * count, len(bounds)])
    rotor[rotor < _NOTHING * _rotors(estimate)] = 0.0
    inverse = solve_triangular(lower, T.T, lower=True)
    return ConsistentBodies(
        estimate, parameters.reshape(-1, 10), rotor, gravity,
        known + T @ wanted, inverse.T @ inverse, T @ T.T, cost)


def _root(H: Array) -> Array:
    """Return L of H = L Lᵀ; raise `CtcError` if there is none."""
    try:
        return np.asarray(np.linalg.cholesky(H), float)
    except np.linalg.LinAlgError:
        low, high = np.linalg.eigvalsh(H)[[0, -1]]
        raise CtcError('the information of inertial parameters, in changes as large as the bodies,'
                       f' is from {low:.3g} to {high:.3g}; allowed: from 0 to about 1e12'
                       ) from None


def _units(prior: Array) -> list[Array]:
    """Return S of every body."""
    heaviest = float(prior[:, 0].max())
    if heaviest <= 0.0:
        raise CtcError(f'no moved body of the model has a mass: {prior[:, 0].tolist()} kg')
    return [unit(x, heaviest) for x in prior]


def _change(S: Array) -> Array:
    """Return the change of the parameters by each element of X, shape (10, 10)."""
    return np.column_stack([parameters_of(S @ symmetric(e) @ S.T) for e in np.eye(10)])


def _rotors(estimate: BodyEstimate) -> Array:
    """Return the inertia that rotors may have, that of the largest body, shape (R,) [kg·m²]."""
    largest = float(np.abs(estimate.prior[:, [4, 6, 9]]).max())
    return np.full(len(estimate.rotor), largest or 1.0)


def _turns(gravity: Array) -> Array:
    """Return the change of gravity by its turns about two axes, and by its strength."""
    if not gravity.any():
        return np.eye(len(gravity))
    along = gravity[:, None] / np.linalg.norm(gravity)
    across = np.linalg.svd(along)[0][:, 1:]
    found: Array = np.linalg.norm(gravity) * np.hstack((_TURN * across, _STRENGTH * along))
    return found


def _inside(S: Array, parameters: Array) -> Array:
    """Return S⁻¹ J S⁻ᵀ."""
    half = np.linalg.solve(S, pseudo_inertia(parameters))
    found: Array = np.linalg.solve(S, half.T)
    return found


def _keeps(slack: Array, count: int) -> bool:
    """Return whether bodies and rotors keep their bounds."""
    bodies = (symmetric(x) for x in slack[:10 * count].reshape(-1, 10))
    return bool(min(slack[10 * count:], default=0.0) >= 0.0
                and all(np.linalg.eigvalsh(x)[0] >= 0.0 for x in bodies))


def _solve(lower: Array, wanted: Array, bounds: Array, count: int) -> tuple[Array, Array]:
    """Return y of (PC1), and by how much the bounds of each body and rotor raise the cost."""
    clarabel = _clarabel()
    from scipy import sparse  # type: ignore[import-untyped]

    size, bounded = len(wanted), len(bounds)
    # With z = Lᵀ (y - wanted), the cost is zᵀ z.
    back = solve_triangular(lower, np.eye(size), lower=True).T
    cones = [clarabel.PSDTriangleConeT(4)] * count
    if bounded > 10 * count:
        cones.append(clarabel.NonnegativeConeT(bounded - 10 * count))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solution = clarabel.DefaultSolver(
        sparse.eye(size, format='csc'), np.zeros(size),
        sparse.csc_matrix(-back[:bounded]), bounds + wanted[:bounded], cones, settings).solve()
    if str(solution.status) not in ('Solved', 'AlmostSolved'):
        raise CtcError('no inertial parameters that bodies can have were found: Clarabel says '
                       f'{solution.status}')
    shares = -np.array(solution.z) * (bounds + wanted[:bounded])
    cost = np.concatenate((shares[:10 * count].reshape(-1, 10).sum(axis=1), shares[10 * count:]))
    y: Array = wanted + back @ np.array(solution.x)
    return y, np.maximum(cost, 0.0)


def _clarabel() -> Any:
    """Return the solver."""
    try:
        return importlib.import_module('clarabel')
    except ImportError as error:
        raise MachineError('inertial parameters that bodies can have need Clarabel '
                           f'({error}): pip install clarabel') from None
