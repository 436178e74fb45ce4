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
Prior of the bodies: the URDF with its uncertainty, and what is physical.

The regression works with unknowns x of deviation 1 around the model. A body changes by S X Sᵀ,
X symmetric with elements u x, where S Sᵀ is its pseudo-inertia (PI1) in the model and u the
uncertainty of the URDF: a change of size 1 is as large as the body itself, in whatever
coordinates, which is the metric of Lee, Wensing and Park (2020). Bodies stay physical: J of each
is positive semidefinite; rotor inertia, Coulomb and viscous friction are not negative.
"""

from __future__ import annotations

import dataclasses

from ctc_chattering.configuration.arm_knowledge import ASSUMED_ROTOR
from ctc_chattering.dynamics.model import LinearModel, Model
from ctc_chattering.dynamics.pseudo_inertia import (
    parameters_of,
    pseudo_inertia,
    stacked,
    symmetric,
    unit,
)
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.regressor import BodyRegressor
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.linalg import block_diag, solve_triangular  # type: ignore[import-untyped]

#: Default uncertainty of a body of the URDF, as a part of the body.
URDF_UNCERTAINTY = 0.2
#: Deviation of a rotor inertia at the joint per effort limit [kg·m² per N·m]; where the URDF has
#: none, `ASSUMED_ROTOR` is expected.
ROTOR_DEVIATION_PER_EFFORT = 0.004
#: Least one of a geared arm.
LEAST_ROTOR_PER_EFFORT = 0.0005
#: Least deviation of a rotor inertia as a part of the joint's inertia.
ROTOR_DEVIATION_PER_INERTIA = 1.0
#: Deviation of a turn of the base [rad]; the strength of gravity is known.
TILT = 0.03
#: Random states in which inertias of joints are averaged.
INERTIA_STATES = 30
#: Least eigenvalue of a pseudo-inertia, in units of the model's.
LEAST_EIGENVALUE = 1e-4
#: Least eigenvalue with which the search for physical parameters begins.
FIRST_EIGENVALUE = 1e-2
#: First weight of the barrier, as a part of the cost of the point where the search begins.
FIRST_BARRIER = 0.1
#: Weight with which the search ends, in units of the logarithm of a likelihood.
LAST_BARRIER = 1e-4
#: Ratio of a weight to the one before.
BARRIER_RATIO = 0.1
#: Distance from the bounds within which the search stays.
INTERIOR = 1e-12
#: Most steps of Newton's method for each weight.
NEWTON_STEPS = 100
#: Part of the expected decrease that a step must have.
LEAST_DECREASE = 1e-3
#: Decrease that a step expects, in weights of the barrier, below which a search ends.
SETTLED = 1e-3
#: Symmetric matrices of which `stacked` has one element of 1, shape (10, 4, 4).
_SYMMETRIC_UNITS = np.stack([symmetric(element) for element in np.eye(10)])


@dataclasses.dataclass(frozen=True)
class BodyPrior:
    """
    Bodies, rotors and direction of gravity before any data; P parameters, k unknowns.

    Attributes
    ----------
    transform : ndarray, shape (P, k)
        Change of the parameters by each unknown.
    mean : ndarray, shape (k,)
        Unknowns as expected: 0, but for rotors that the URDF lacks.
    bounds : PhysicalBounds
        Of these unknowns.

    """

    transform: Array
    mean: Array
    bounds: PhysicalBounds

    @classmethod
    def of(cls, regressor: BodyRegressor | None, uncertainty: float,
           rotors_show: bool = True) -> BodyPrior:
        """
        Return the prior of a model; nothing is unknown without a regressor.

        Parameters
        ----------
        regressor : BodyRegressor or None
            Of the model.
        uncertainty : float
            Of a body of the URDF, as a part of the body.
        rotors_show : bool
            Whether the torque accelerates the rotors; that of a sensor behind the gear does not.

        """
        if regressor is None:
            return cls(np.zeros((0, 0)), np.zeros(0), PhysicalBounds())
        model = regressor.model
        if regressor.inertial_count == 10 * model.n and hasattr(model, 'bodies'):
            bodies, bounds = _urdf_bodies(model.inertial_parameters(), uncertainty)
        else:
            bodies, bounds = np.diag(uncertainty * model.parameter_sizes()), PhysicalBounds()
        rotors = regressor.parameters[regressor.inertial_count:-3]
        if not (rotors_show or rotors.any()):
            transform = block_diag(bodies, np.zeros((model.n, 0)), _turns(regressor.gravity))
            return cls(transform, np.zeros(transform.shape[1]), bounds)
        sizes = _rotor_sizes(model)
        first = bodies.shape[1]
        least = (-rotors / sizes).tolist()
        bounds = bounds.with_least({first + joint: x for joint, x in enumerate(least)})
        transform = block_diag(bodies, np.diag(sizes), _turns(regressor.gravity))
        mean = np.zeros(transform.shape[1])
        mean[first:first + model.n] = assumed_rotors(regressor) / sizes
        return cls(transform, mean, bounds)


def _urdf_bodies(parameters: Array, uncertainty: float) -> tuple[Array, PhysicalBounds]:
    """Return the transform of the bodies of a URDF, and their bounds."""
    rows = parameters.reshape(-1, 10)
    heaviest = float(rows[:, 0].max())
    if heaviest <= 0.0:
        raise CtcError(f'no moved body of the model has a mass: {rows[:, 0].tolist()} kg')
    roots = [unit(row, heaviest) for row in rows]
    inverses = [np.linalg.inv(root) for root in roots]
    model = np.stack([inverse @ pseudo_inertia(row) @ inverse.T
                      for inverse, row in zip(inverses, rows)])
    blocks = [uncertainty * _change(root) for root in roots]
    return block_diag(*blocks), PhysicalBounds(model, uncertainty)


def _change(root: Array) -> Array:
    """Return the change of the parameters by each element of X, shape (10, 10)."""
    return np.column_stack(
        [parameters_of(root @ symmetric(element) @ root.T) for element in np.eye(10)])


def _rotor_sizes(model: LinearModel) -> Array:
    """Return the deviation of each rotor inertia, shape (n,) [kg·m²]."""
    states = np.random.default_rng(0).normal(size=(INERTIA_STATES, model.n))
    mass = [model.evaluate(q, np.zeros(model.n))[0]  # type: ignore[attr-defined]
            for q in states]
    inertia = np.mean([matrix.diagonal() for matrix in mass], axis=0)
    return np.asarray(np.maximum(ROTOR_DEVIATION_PER_EFFORT * finite_efforts(model),
                                 ROTOR_DEVIATION_PER_INERTIA * inertia))


def assumed_rotors(regressor: BodyRegressor) -> Array:
    """Return the rotor inertias that are expected where the URDF has none, shape (n,) [kg·m²]."""
    given = regressor.parameters[regressor.inertial_count:-3]
    return np.where(given > 0.0, 0.0, ASSUMED_ROTOR * finite_efforts(regressor.model))


def finite_efforts(model: Model | LinearModel) -> Array:
    """Return the effort limits, shape (n,) [N·m]; 0 where there is none."""
    effort = np.array(getattr(model, 'effort_limits', None) or [np.inf] * model.n, float)
    return np.asarray(np.where(np.isfinite(effort), effort, 0.0))


def _turns(gravity: Array) -> Array:
    """Return the change of gravity by turns about two axes across it, shape (3, 2)."""
    strength = float(np.linalg.norm(gravity))
    if not strength:
        return np.zeros((3, 0))
    across = np.linalg.svd(gravity[:, None] / strength)[0][:, 1:]
    return np.asarray(TILT * strength * across)


@dataclasses.dataclass(frozen=True)
class PhysicalBounds:
    """
    Bounds of unknowns x: pseudo-inertias of bodies come first, others have a least value.

    Attributes
    ----------
    model : ndarray, shape (n, 4, 4)
        Pseudo-inertias of the model in its own units; empty without bodies.
    uncertainty : float
        Change of an element of a pseudo-inertia by an unknown.
    least : dict of int to float
        Least value of an unknown.

    """

    model: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 4, 4)))
    uncertainty: float = 1.0
    least: dict[int, float] = dataclasses.field(default_factory=dict)

    def with_least(self, least: dict[int, float]) -> PhysicalBounds:
        """Return it with the least values of further unknowns."""
        return dataclasses.replace(self, least={**self.least, **least})

    def keep(self, x: Array, margin: float = 0.0) -> bool:
        """Return whether unknowns are physical, at least by so much."""
        return all(x[i] >= least + margin for i, least in self.least.items()) and all(
            np.linalg.eigvalsh(body)[0] >= LEAST_EIGENVALUE + margin for body in self._bodies(x))

    def _bodies(self, x: Array) -> Array:
        """Return the pseudo-inertias in units of the model's, shape (n, 4, 4)."""
        count = len(self.model)
        changes = [symmetric(part) for part in x[:10 * count].reshape(count, 10)]
        return self.model + self.uncertainty * np.reshape(changes, (count, 4, 4))

    def nearest(self, x: Array, information: Array) -> Array:
        """
        Return the physical unknowns y for which (y - x)ᵀ information (y - x) is least.

        That is a convex problem. Newton's method solves it with a logarithmic barrier; unknowns
        that it keeps from their least value by less than they are known are set to that.
        """
        if self.keep(x):
            return x
        y = self._inside(len(x))
        barrier = FIRST_BARRIER * float((y - x) @ information @ (y - x))
        while barrier > LAST_BARRIER:
            y = self._centred(y, x, information / barrier)
            barrier *= BARRIER_RATIO
        for i, least in self.least.items():
            if information[i, i] * (y[i] - least) ** 2 < LAST_BARRIER:
                y[i] = least
        return y

    def _centred(self, y: Array, x: Array, information: Array) -> Array:
        """Return where ½ (y - x)ᵀ information (y - x) and the barrier are least together."""
        def cost(y: Array) -> float:
            return 0.5 * float((y - x) @ information @ (y - x)) + self._barrier(y)

        for _ in range(NEWTON_STEPS):
            slope, curvature = self._derivatives(y)
            slope = slope + information @ (y - x)
            step = -np.linalg.solve(information + curvature, slope)
            expected, length, before = float(slope @ step), 1.0, cost(y)
            if -expected < SETTLED:
                break
            while length > INTERIOR and not (
                    self.keep(y + length * step, INTERIOR)
                    and cost(y + length * step) < before + LEAST_DECREASE * length * expected):
                length *= 0.5
            y = y + length * step
        return y

    def _inside(self, count: int) -> Array:
        """Return unknowns well within the bounds, shape (count,)."""
        y = np.zeros(count)
        for i, body in enumerate(self.model):
            values, vectors = np.linalg.eigh(body)
            inside = vectors * np.maximum(values, FIRST_EIGENVALUE) @ vectors.T
            y[10 * i:10 * i + 10] = stacked(inside - body) / self.uncertainty
        for i, least in self.least.items():
            y[i] = max(0.0, least + FIRST_EIGENVALUE)
        return y

    def _barrier(self, y: Array) -> float:
        """Return -Σ log det J - Σ log(y - least)."""
        bodies = self._bodies(y) - LEAST_EIGENVALUE * np.eye(4)
        scalars = sum(float(np.log(y[i] - least)) for i, least in self.least.items())
        return -float(np.linalg.slogdet(bodies)[1].sum()) - scalars

    def _derivatives(self, y: Array) -> tuple[Array, Array]:
        """Return slope (m,) and curvature (m, m) of the barrier."""
        slope, curvature = np.zeros(len(y)), np.zeros((len(y), len(y)))
        for i, body in enumerate(self._bodies(y)):
            block = slice(10 * i, 10 * i + 10)
            inverse = np.linalg.inv(body - LEAST_EIGENVALUE * np.eye(4))
            slope[block] = -self.uncertainty * stacked(inverse)
            curvature[block, block] = self.uncertainty ** 2 * stacked(
                inverse @ _SYMMETRIC_UNITS @ inverse)
        for i, least in self.least.items():
            distance = y[i] - least
            slope[i] = -1.0 / distance
            curvature[i, i] = 1.0 / distance ** 2
        return slope, curvature


def covariance_of(information: Array) -> Array:
    """Return the inverse of a positive definite matrix."""
    lower = np.linalg.cholesky(information)
    inverse = solve_triangular(lower, np.eye(len(lower)), lower=True)
    return np.asarray(inverse.T @ inverse)
