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
Prior of the bodies: the URDF with its uncertainty.

The regression works with unknowns x of deviation 1 around the model. A body changes by S X Sᵀ,
X symmetric with elements u x, where S Sᵀ is its pseudo-inertia (PI1) in the model and u the
uncertainty of the URDF: a change of size 1 is as large as the body itself, in whatever
coordinates, which is the metric of Lee, Wensing and Park (2020). Bodies stay physical: J of each
is positive semidefinite. Rotor inertia, Coulomb and viscous friction are not negative.
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

#: Deviation of a body of the URDF, relative to its mass and size.
URDF_UNCERTAINTY = 0.2
#: Least rotor inertia of a geared arm at the joint, per effort limit [kg·m² per N·m].
LEAST_ROTOR_PER_EFFORT = 0.0005
#: Least eigenvalue of a pseudo-inertia, in units of the model's.
MIN_EIGENVALUE = 1e-4
#: Least eigenvalue, and least margin of other unknowns, where the search begins.
_START_MARGIN = 1e-2
#: Weight of the barrier at the end of the search, in units of the logarithm of a likelihood.
_LAST_BARRIER = 1e-4
#: Symmetric matrices of which `stacked` has one element of 1, shape (10, 4, 4).
_SYMMETRIC_UNITS = np.stack([symmetric(element) for element in np.eye(10)])


@dataclasses.dataclass(frozen=True)
class BodyPrior:
    """
    Bodies, rotors and gravity before any data.

    There are P parameters and k unknowns.

    Attributes
    ----------
    transform : ndarray, shape (P, k)
        Change of the parameters by each unknown.
    mean : ndarray, shape (k,)
        Expected unknowns: 0, but for rotors that the URDF lacks.
    bounds : PhysicalBounds
        Bounds of these unknowns.

    """

    transform: Array
    mean: Array
    bounds: PhysicalBounds

    @classmethod
    def of(
            cls,
            regressor: BodyRegressor | None,
            uncertainty: float,
            rotors_show: bool = True) -> BodyPrior:
        """
        Return the prior of a model.

        Without a regressor nothing is unknown.

        Parameters
        ----------
        regressor : BodyRegressor or None
            Regressor of the model.
        uncertainty : float
            Deviation of a body of the URDF, relative to the body.
        rotors_show : bool
            Whether the torque accelerates the rotors. That of a sensor behind the gear does not.

        """
        if regressor is None:
            return cls(np.zeros((0, 0)), np.zeros(0), PhysicalBounds())
        model = regressor.model
        first_rotor = regressor.inertial_count
        if first_rotor == 10 * model.n and hasattr(model, 'bodies'):
            bodies, bounds = _urdf_bodies(model.inertial_parameters(), uncertainty)
        else:
            bodies = np.diag(uncertainty * model.parameter_sizes())
            bounds = PhysicalBounds()
        turns = _gravity_turns(regressor.gravity)
        rotors = regressor.parameters[first_rotor:-3]
        if not (rotors_show or rotors.any()):
            transform = block_diag(bodies, np.zeros((model.n, 0)), turns)
            return cls(transform, np.zeros(transform.shape[1]), bounds)
        sizes = _rotor_deviations(model)
        transform = block_diag(bodies, np.diag(sizes), turns)
        first = bodies.shape[1]
        unknowns = range(first, first + model.n)
        bounds = bounds.with_minimum(dict(zip(unknowns, (-rotors / sizes).tolist())))
        mean = np.zeros(transform.shape[1])
        mean[unknowns] = assumed_rotors(regressor) / sizes
        return cls(transform, mean, bounds)


def _urdf_bodies(parameters: Array, uncertainty: float) -> tuple[Array, PhysicalBounds]:
    """Return transform and bounds of the bodies of a URDF."""
    rows = parameters.reshape(-1, 10)
    heaviest = float(rows[:, 0].max())
    if heaviest <= 0.0:
        raise CtcError(f'no moved body of the model has a mass: {rows[:, 0].tolist()} kg')
    transforms = []
    models = []
    for row in rows:
        root = unit(row, heaviest)
        inverse = np.linalg.inv(root)
        models.append(inverse @ pseudo_inertia(row) @ inverse.T)
        changes = [parameters_of(root @ element @ root.T) for element in _SYMMETRIC_UNITS]
        transforms.append(uncertainty * np.column_stack(changes))
    return block_diag(*transforms), PhysicalBounds(np.stack(models), uncertainty)


def _rotor_deviations(model: LinearModel) -> Array:
    """Return the deviation of each rotor inertia, shape (n,) [kg·m²]."""
    states = np.random.default_rng(0).normal(size=(30, model.n))
    mass = [model.evaluate(q, np.zeros(model.n))[0]  # type: ignore[attr-defined]
            for q in states]
    inertia = np.mean([matrix.diagonal() for matrix in mass], axis=0)
    # A rotor may deviate by the arm's own inertia.
    return np.maximum(0.004 * finite_efforts(model), inertia)


def assumed_rotors(regressor: BodyRegressor) -> Array:
    """Return the rotor inertias that the URDF lacks, shape (n,) [kg·m²]."""
    described = regressor.parameters[regressor.inertial_count:-3]
    return np.where(described > 0.0, 0.0, ASSUMED_ROTOR * finite_efforts(regressor.model))


def finite_efforts(model: Model | LinearModel) -> Array:
    """Return the effort limits, shape (n,) [N·m], 0 for none."""
    effort = np.array(getattr(model, 'effort_limits', None) or [np.inf] * model.n, float)
    return np.where(np.isfinite(effort), effort, 0.0)


def _gravity_turns(gravity: Array) -> Array:
    """Return the change of gravity by two turns, shape (3, 2)."""
    strength = float(np.linalg.norm(gravity))
    if not strength:
        return np.zeros((3, 0))
    across = np.linalg.svd(gravity[:, None] / strength)[0][:, 1:]
    # A turn deviates by 0.03 rad, and the strength of gravity is known.
    return np.asarray(0.03 * strength * across)


@dataclasses.dataclass(frozen=True)
class PhysicalBounds:
    """
    Bounds of unknowns x.

    Pseudo-inertias of bodies come first. Others have a minimum.

    Attributes
    ----------
    model : ndarray, shape (n, 4, 4)
        Pseudo-inertias of the model in its own units, empty without bodies.
    uncertainty : float
        Change of an element of a pseudo-inertia by an unknown.
    minimum : dict of int to float
        Least value of an unknown.

    """

    model: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 4, 4)))
    uncertainty: float = 1.0
    minimum: dict[int, float] = dataclasses.field(default_factory=dict)

    def with_minimum(self, minimum: dict[int, float]) -> PhysicalBounds:
        """Return the bounds with the minima of further unknowns."""
        return dataclasses.replace(self, minimum={**self.minimum, **minimum})

    def allow(self, x: Array, margin: float = 0.0) -> bool:
        """Return whether unknowns are physical, with a margin."""
        if any(x[i] < bound + margin for i, bound in self.minimum.items()):
            return False
        eigenvalues = np.linalg.eigvalsh(self._bodies(x))
        return bool((eigenvalues[:, 0] >= MIN_EIGENVALUE + margin).all())

    def _bodies(self, x: Array) -> Array:
        """Return the pseudo-inertias, in the model's, shape (n, 4, 4)."""
        count = len(self.model)
        elements = x[:10 * count].reshape(count, 10)
        changes = np.reshape([symmetric(row) for row in elements], (count, 4, 4))
        return self.model + self.uncertainty * changes

    def nearest(self, x: Array, information: Array) -> Array:
        """
        Return the nearest physical unknowns.

        They are the y for which (y - x)ᵀ information (y - x) is least, a convex problem. Newton's
        method solves it with a logarithmic barrier. Unknowns that it keeps from their minimum by
        less than they are known are set to that.
        """
        if self.allow(x):
            return x
        y = self._start(len(x))
        # Its first weight is a tenth of the cost at the start.
        barrier = 0.1 * float((y - x) @ information @ (y - x))
        while barrier > _LAST_BARRIER:
            y = self._minimize(y, x, information / barrier)
            barrier *= 0.1
        for i, bound in self.minimum.items():
            if information[i, i] * (y[i] - bound) ** 2 < _LAST_BARRIER:
                y[i] = bound
        return y

    def _start(self, count: int) -> Array:
        """Return unknowns well within the bounds, shape (count,)."""
        y = np.zeros(count)
        for i, body in enumerate(self.model):
            values, vectors = np.linalg.eigh(body)
            inside = vectors * np.maximum(values, _START_MARGIN) @ vectors.T
            y[10 * i:10 * i + 10] = stacked(inside - body) / self.uncertainty
        for i, bound in self.minimum.items():
            y[i] = max(0.0, bound + _START_MARGIN)
        return y

    def _minimize(self, y: Array, x: Array, information: Array) -> Array:
        """Return the minimum of distance and barrier, from y on."""
        def cost(y: Array) -> float:
            return 0.5 * float((y - x) @ information @ (y - x)) + self._barrier(y)

        shortest = 1e-12  # The search stays as far within the bounds.
        for _ in range(100):
            slope, curvature = self._derivatives(y)
            slope = slope + information @ (y - x)
            step = -np.linalg.solve(information + curvature, slope)
            expected = float(slope @ step)
            if -expected < 1e-3:  # In weights of the barrier.
                break
            length = 1.0
            cost_before = cost(y)
            while length > shortest and not (
                    self.allow(y + length * step, shortest)
                    and cost(y + length * step) < cost_before + 1e-3 * length * expected):
                length *= 0.5
            y = y + length * step
        return y

    def _barrier(self, y: Array) -> float:
        """Return -Σ log det J - Σ log(y - minimum)."""
        bodies = self._bodies(y) - MIN_EIGENVALUE * np.eye(4)
        scalars = sum(float(np.log(y[i] - bound)) for i, bound in self.minimum.items())
        return -float(np.linalg.slogdet(bodies)[1].sum()) - scalars

    def _derivatives(self, y: Array) -> tuple[Array, Array]:
        """Return slope (m,) and curvature (m, m) of the barrier."""
        slope = np.zeros(len(y))
        curvature = np.zeros((len(y), len(y)))
        for i, body in enumerate(self._bodies(y)):
            block = slice(10 * i, 10 * i + 10)
            inverse = np.linalg.inv(body - MIN_EIGENVALUE * np.eye(4))
            slope[block] = -self.uncertainty * stacked(inverse)
            curvature[block, block] = self.uncertainty ** 2 * stacked(
                inverse @ _SYMMETRIC_UNITS @ inverse)
        for i, bound in self.minimum.items():
            distance = y[i] - bound
            slope[i] = -1.0 / distance
            curvature[i, i] = 1.0 / distance ** 2
        return slope, curvature


def covariance_of(information: Array) -> Array:
    """Return the inverse of a positive definite matrix."""
    lower = np.linalg.cholesky(information)
    inverse = solve_triangular(lower, np.eye(len(lower)), lower=True)
    return np.asarray(inverse.T @ inverse)
