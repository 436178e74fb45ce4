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
Arms with springs and dampers between motors and links.

The plant uses it where `joint_stiffness` is set. With the positions θ of the motors, all
reflected to the joints (Spong, 1987)::

    M(q) ddq + C(q, dq) dq + G(q) = K (θ - q) + D (dθ - dq)
    J ddθ + K (θ - q) + D (dθ - dq) = τ
"""

from __future__ import annotations

from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Rows, Vector
import numpy as np


class Elastic(Model):
    """
    A model of links and motors, coordinates (q, θ).

    The torque of an elastic joint acts on its θ. A rigid joint has no θ. D is part of C: without
    it, ½ dM/dt - C is skew-symmetric.

    Parameters
    ----------
    model : Model
        The links.
    stiffness, damping, inertia : sequence of float, shape (n,)
        K [N·m/rad], inf for a rigid joint, D [N·m·s/rad], and J of the motor [kg·m²].

    Attributes
    ----------
    n : int
        Number of links and motors.
    motors : list of int, shape (n of the links,)
        Coordinate on which the drive of each joint acts.

    """

    def __init__(
        self, model: Model, stiffness: Vector, damping: Vector, inertia: Vector
    ) -> None:
        elastic = np.flatnonzero(np.isfinite(stiffness))
        self._model = model
        self._links = model.n
        self._elastic = elastic
        self.n = model.n + len(elastic)
        self._stiffness = np.array(stiffness, float)[elastic]
        self._damping = np.array(damping, float)[elastic]
        self._inertia = np.array(inertia, float)[elastic]
        #: θ - q of the springs is this matrix times the coordinates.
        self._stretch = np.hstack((-np.eye(model.n)[elastic], np.eye(len(elastic))))
        motors = np.arange(model.n)
        motors[elastic] = np.arange(model.n, self.n)
        self.motors: list[int] = motors.tolist()

    def mass_matrix(self, q: Vector) -> Rows:
        """Return M and J, shape (n, n)."""
        from scipy.linalg import block_diag  # type: ignore[import-untyped]

        links = self._model.mass_matrix(q[: self._links])
        rows: Rows = block_diag(links, np.diag(self._inertia)).tolist()
        return rows

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:
        """Return C and D, shape (n, n)."""
        links = self._links
        torques = self._stretch.T * self._damping
        matrix = torques @ self._stretch
        matrix[:links, :links] += self._model.coriolis_matrix(q[:links], dq[:links])
        rows: Rows = matrix.tolist()
        return rows

    def gravity_torque(self, q: Vector) -> Vector:
        """Return G with the torques of the springs."""
        springs = self._stiffness * (self._stretch @ q)
        torque = self._stretch.T @ springs
        links = self._links
        torque[:links] += self._model.gravity_torque(q[:links])
        values: list[float] = torque.tolist()
        return values

    def potential_energy(self, q: Vector) -> float:
        """Return the potential energy of links and springs [J]."""
        springs = 0.5 * self._stiffness @ (self._stretch @ q) ** 2
        return self._model.potential_energy(q[: self._links]) + float(springs)

    def start(self, q: Vector, dq: Vector) -> tuple[list[float], list[float]]:
        """
        Return the state at which springs carry the weight.

        Parameters
        ----------
        q, dq : sequence of float, shape (n of the links,)
            Position [rad] and velocity [rad/s] of the links.

        """
        weight = np.array(self._model.gravity_torque(q))[self._elastic]
        motor_positions = np.array(q)[self._elastic] + weight / self._stiffness
        motor_velocities = np.array(dq)[self._elastic]
        return [*q, *motor_positions.tolist()], [*dq, *motor_velocities.tolist()]

    def rate(self, q: Vector) -> float:
        """Return a bound of the eigenvalues at rest [1/s]."""
        M = np.array(self._model.mass_matrix(q))
        link_mobility = np.linalg.inv(M).diagonal()
        mobility = 1.0 / self._inertia + link_mobility[self._elastic]
        damping_rate = self._damping * mobility
        frequency = np.sqrt(self._stiffness * mobility)
        return float((damping_rate + frequency).max())
