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
An arm whose joints are elastic: a spring and a damper between each motor and its link.

With the positions θ of the motors, all reflected to the joints (Spong, 1987)::

    M(q) ddq + C(q, dq) dq + G(q) = K (θ - q) + D (dθ - dq)
    J ddθ + K (θ - q) + D (dθ - dq) = τ
"""

from __future__ import annotations

from math import inf, sqrt

from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Rows, Vector
import numpy as np


class Elastic(Model):
    """
    Another model with motors: a `Model` of the coordinates (q, θ).

    The torque of an elastic joint acts on its θ; a rigid joint has no θ. D is part of C, so that
    ½ dM/dt - C is skew-symmetric without it only.

    Parameters
    ----------
    model : Model
        The links.
    stiffness, damping, inertia : sequence of float, shape (n,)
        K [N·m/rad], inf for a rigid joint; D [N·m·s/rad]; J of the motor [kg·m²].

    Attributes
    ----------
    n : int
        Number of links and motors.
    motors : list of int, shape (n of the links,)
        Coordinate on which the drive of each joint acts.

    """

    def __init__(self, model: Model, stiffness: Vector, damping: Vector, inertia: Vector) -> None:
        elastic = [i for i, k in enumerate(stiffness) if k < inf]
        self._model, self._links = model, model.n
        self.n = model.n + len(elastic)
        self.motors = list(range(model.n))
        #: Link, motor, K, D, J.
        self._springs = [(i, k, stiffness[i], damping[i], inertia[i])
                         for k, i in enumerate(elastic, model.n)]
        for i, k, *_ in self._springs:
            self.motors[i] = k

    def mass_matrix(self, q: Vector) -> Rows:
        """Return M and J, shape (n, n)."""
        rows = self._padded(self._model.mass_matrix(q[:self._links]))
        for _, k, _, _, inertia in self._springs:
            rows[k][k] = inertia
        return rows

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:
        """Return C and D, shape (n, n)."""
        links = self._links
        rows = self._padded(self._model.coriolis_matrix(q[:links], dq[:links]))
        for i, k, _, damping, _ in self._springs:
            for a, b in ((i, k), (k, i)):
                rows[a][a] += damping
                rows[a][b] -= damping
        return rows

    def gravity_torque(self, q: Vector) -> Vector:
        """Return G and the torques of the springs, shape (n,)."""
        torque = [*self._model.gravity_torque(q[:self._links]), *[0.0] * len(self._springs)]
        for i, k, stiffness, _, _ in self._springs:
            spring = stiffness * (q[k] - q[i])
            torque[i] -= spring
            torque[k] += spring
        return torque

    def potential_energy(self, q: Vector) -> float:
        """Return the potential energy of links and springs [J]."""
        return self._model.potential_energy(q[:self._links]) + sum(
            0.5 * stiffness * (q[k] - q[i]) ** 2 for i, k, stiffness, _, _ in self._springs)

    def start(self, q: Vector, dq: Vector) -> tuple[list[float], list[float]]:
        """
        Return coordinates and velocities at which the springs carry the weight.

        Parameters
        ----------
        q, dq : sequence of float, shape (n of the links,)
            Position [rad] and velocity [rad/s] of the links.

        """
        weight = self._model.gravity_torque(q)
        return ([*q, *(q[i] + weight[i] / stiffness for i, _, stiffness, _, _ in self._springs)],
                [*dq, *(dq[i] for i, *_ in self._springs)])

    def rate(self, q: Vector) -> float:
        """Return a bound of the joints' eigenvalues with the links at rest at `q` [1/s]."""
        rates = []
        for i, _, stiffness, damping, inertia in self._springs:
            mobility = 1.0 / inertia + np.linalg.inv(np.array(self._model.mass_matrix(q)))[i, i]
            rates.append(damping * mobility + sqrt(stiffness * mobility))
        return float(max(rates))

    def _padded(self, rows: Rows) -> list[list[float]]:
        """Return a matrix of the links with zeros for the motors."""
        more = self.n - self._links
        return [[*row, *[0.0] * more] for row in rows] + [[0.0] * self.n for _ in range(more)]
