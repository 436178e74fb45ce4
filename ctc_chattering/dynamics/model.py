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
Interface of robot models: M, C and G of (1).

Laws, plants and identification call it. `registry` makes the models that a configuration names.
Vectors are sequences of ``n`` floats, matrices sequences of rows: the plant integrates scalar by
scalar. The control step takes M, C and G as arrays, from `Model.evaluate`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array, Rows, Vector
import numpy as np


class DynamicsTerms(NamedTuple):
    """The terms of (1) at a state, as arrays."""

    M: Array
    C: Array
    G: Array


class PointMass(NamedTuple):
    """A point mass at the tip of an arm."""

    #: [kg].
    mass: float
    #: Position in the frame of the last link, shape (3,) [m].
    center: Vector


class Model(ABC):
    """
    Rigid-body dynamics of an arm with `n` joints.

    A subclass gives M, C, G and the potential. All else follows from them. A subclass overrides
    what it has a faster closed form of.
    """

    #: Number of joints.
    n: int
    #: Largest torque of each joint, inf for unlimited [N·m]. Empty where nothing is known.
    effort_limits: Vector = ()
    #: Least and greatest position of each joint, ∓inf for none. Empty where nothing is known.
    position_limits: Sequence[tuple[float, float]] = ()
    #: True for joints that turn endlessly: their position counts modulo 2π. Empty for none.
    continuous: Sequence[bool] = ()

    @abstractmethod
    def mass_matrix(self, q: Vector) -> Rows:
        """Return M(q), shape (n, n), symmetric positive definite [kg·m²]."""

    @abstractmethod
    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:
        """Return C(q, dq) with ½ dM/dt - C skew-symmetric, shape (n, n)."""

    @abstractmethod
    def gravity_torque(self, q: Vector) -> Vector:
        """Return G(q), shape (n,) [N·m]."""

    @abstractmethod
    def potential_energy(self, q: Vector) -> float:
        """Return the potential whose gradient is G(q) [J]."""

    def with_payload(self, masses: Sequence[PointMass]) -> Model:
        """
        Return the model of this arm with point masses at its tip.

        Raises
        ------
        CtcError
            If the model cannot carry any.

        """
        if masses:
            raise CtcError(f'only the model of a description carries payloads, not {masses}')
        return self

    def evaluate(self, q: Array, dq: Array) -> DynamicsTerms:
        """Return M(q), C(q, dq) and G(q) as arrays."""
        position = q.tolist()
        return DynamicsTerms(
            np.array(self.mass_matrix(position), float),
            np.array(self.coriolis_matrix(position, dq.tolist()), float),
            np.array(self.gravity_torque(position), float),
        )

    def forward(self, q: Array, dq: Array, u: Array) -> Array:
        """
        Return ddq of (1) under a torque, shape (n,).

        Parameters
        ----------
        q, dq, u : ndarray, shape (n,)
            Position [rad], velocity [rad/s] and the sum of all torques but C dq and G [N·m].

        """
        M, bias = self.mass_and_bias(q, dq)
        return np.array(np.linalg.solve(M, u - bias), float)

    def inverse_dynamics(self, q: Vector, dq: Vector, a: Vector) -> Vector:
        """Return the left side of (1), shape (n,) [N·m]."""
        M = np.array(self.mass_matrix(q))
        C = np.array(self.coriolis_matrix(q, dq))
        torque: Array = M.dot(a) + C.dot(dq) + self.gravity_torque(q)
        values: list[float] = torque.tolist()
        return values

    def mass_and_bias(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Return M and C dq + G as arrays."""
        position = q.tolist()
        bias = self.inverse_dynamics(position, dq.tolist(), (0.0,) * self.n)
        return np.array(self.mass_matrix(position), float), np.array(bias, float)


@runtime_checkable
class LinearModel(Protocol):
    """
    Interface of models whose inertial parameters can be identified.

    A model derived from it and from `Model` gives the parameters and the regressor.
    """

    n: int
    gravity: float

    def inertial_parameters(self) -> Array:
        """Return the parameters, shape (p,)."""

    def parameter_sizes(self) -> Array:
        """Return the rough size of each parameter, shape (p,)."""
        return self.inertial_parameters()

    def torque_regressor(
        self, q: Array, dq: Array, ddq: Array, gravity: Array
    ) -> Array:
        """
        Return the torque per parameter, shape (n, p).

        `gravity` is the vector of its acceleration in the frame of the base, shape (3,) [m/s²].
        """

    def gravity_map(self, q: Array) -> Array:
        """Return G per component of gravity, shape (n, 3)."""
        rest = np.zeros(self.n)
        parameters = self.inertial_parameters()
        return np.column_stack(
            [
                self.torque_regressor(q, rest, rest, axis) @ parameters
                for axis in np.eye(3)
            ]
        )


def rotors(model: LinearModel) -> Array:
    """Return the rotor inertias of a model, shape (n,) [kg·m²]."""
    return np.array(getattr(model, 'rotor_inertias', (0.0,) * model.n))


class Scaled(Model):
    """
    Another model with scaled M, C and G.

    Parameters
    ----------
    model : Model
        Model to scale.
    inertia : float
        Factor of M and C.
    gravity : float
        Factor of G.

    """

    def __init__(self, model: Model, inertia: float, gravity: float) -> None:
        self.n = model.n
        self.effort_limits = model.effort_limits
        self.position_limits = model.position_limits
        self.continuous = model.continuous
        self._model = model
        self._inertia = inertia
        self._gravity = gravity

    def mass_matrix(self, q: Vector) -> Rows:
        """Return M(q), shape (n, n)."""
        return _scaled_rows(self._inertia, self._model.mass_matrix(q))

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:
        """Return C(q, dq), shape (n, n)."""
        return _scaled_rows(self._inertia, self._model.coriolis_matrix(q, dq))

    def gravity_torque(self, q: Vector) -> Vector:
        """Return G(q), shape (n,)."""
        return [self._gravity * x for x in self._model.gravity_torque(q)]

    def potential_energy(self, q: Vector) -> float:
        """Return the scaled potential energy [J]."""
        return self._gravity * self._model.potential_energy(q)


def _scaled_rows(factor: float, rows: Rows) -> Rows:
    return [[factor * x for x in row] for row in rows]
