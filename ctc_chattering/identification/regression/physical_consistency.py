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

#: w: how far from the model parameters are expected, in bodies.
_EXPECTED = 3.0
#: ε, and the least rotor inertia.
_LEAST = 1e-4
#: Inertia of a rotor that is expected, in that of the body it moves, and in that of the largest.
_ROTOR, _LARGEST = 1.0, 0.1


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
    wanted : ndarray, shape (P,)
        What fits best without bounds, and is nearest to the model otherwise.
    covariance : ndarray, shape (P, P)
        Of all parameters, without bounds; what is not shown has that of `expected`.
    expected : ndarray, shape (P, P)
        Covariance before any data.
    cost : ndarray, shape (B + R,)
        By how much the bounds of each body, and rotor, raise twice the negative logarithm of the
        likelihood.

    """

    estimate: BodyEstimate
    parameters: Array
    rotor: Array
    wanted: Array
    covariance: Array
    expected: Array
    cost: Array

    @property
    def found(self) -> Array:
        """Return all parameters, shape (P,)."""
        return np.concatenate((self.parameters.ravel(), self.rotor))

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
        If there are numbers that are not finite, or the solver finds no solution.

    """
    known = estimate.known
    if not all(np.isfinite(x).all() for x in (known, estimate.found, estimate.information)):
        raise CtcError('the estimate of inertial parameters is not finite')
    roots = _units(estimate.prior)
    count = len(roots)
    T = block_diag(*(_change(S) for S in roots), *_rotor_units(estimate))
    information = T.T @ estimate.information @ T
    information = 0.5 * (information + information.T)
    H = information + np.eye(len(known)) / _EXPECTED ** 2
    lower = np.linalg.cholesky(H)
    wanted = np.linalg.solve(H, T.T @ estimate.information @ (estimate.found - known))
    bounds = np.concatenate([
        *(stacked(_inside(S, x) - _LEAST * np.eye(4)) for S, x in zip(roots, estimate.prior)),
        estimate.rotor_prior / T.diagonal()[10 * count:]])
    y, cost = wanted, np.zeros(count + len(estimate.rotor))
    if not _keeps(bounds + wanted, count):
        y, cost = _solve(lower, wanted, bounds, count)
    x = known + T @ y
    inverse = solve_triangular(lower, T.T, lower=True)
    return ConsistentBodies(
        estimate, x[:10 * count].reshape(-1, 10), np.maximum(x[10 * count:], 0.0),
        known + T @ wanted, inverse.T @ inverse, _EXPECTED ** 2 * T @ T.T, cost)


def _units(prior: Array) -> list[Array]:
    """Return S of every body."""
    heaviest = float(prior[:, 0].max())
    if heaviest <= 0.0:
        raise CtcError(f'no moved body of the model has a mass: {prior[:, 0].tolist()} kg')
    return [unit(x, heaviest) for x in prior]


def _change(S: Array) -> Array:
    """Return the change of the parameters by each element of X, shape (10, 10)."""
    return np.column_stack([parameters_of(S @ symmetric(e) @ S.T) for e in np.eye(10)])


def _rotor_units(estimate: BodyEstimate) -> list[Array]:
    """Return the inertia that the rotor of each joint is expected to have, matrices of one."""
    about = np.abs(estimate.prior[:, [4, 6, 9]]).max(axis=1)
    expected = np.maximum(_ROTOR * about, _LARGEST * about.max())
    return [np.array([[x or 1.0]]) for x in expected[:len(estimate.rotor)]]


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

    size = len(wanted)
    # With z = Lᵀ (y - wanted), the cost is zᵀ z.
    back = solve_triangular(lower, np.eye(size), lower=True).T
    cones = [clarabel.PSDTriangleConeT(4)] * count
    if size > 10 * count:
        cones.append(clarabel.NonnegativeConeT(size - 10 * count))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solution = clarabel.DefaultSolver(
        sparse.eye(size, format='csc'), np.zeros(size), sparse.csc_matrix(-back),
        bounds + wanted, cones, settings).solve()
    if str(solution.status) not in ('Solved', 'AlmostSolved'):
        raise CtcError('no inertial parameters that bodies can have were found: Clarabel says '
                       f'{solution.status}')
    shares = -np.array(solution.z) * (bounds + wanted)
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
