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
Torque of a model as a linear function of its parameters.

The parameters are the inertial ones of the model, the inertia of a rotor at each joint, and the
vector of gravity. In (WF1) a parameter has the weak torque of its regressor: that of the momentum
is the regressor of a torque at rest with dq for an acceleration, and with T = ½ dqᵀ M dq

    Cᵀ dq = ∂T/∂q = (dM/dt) dq - C dq,                                                    (EC1)

where dM/dt is the derivative along the motion, by a central difference. `windows.py` calls `weak`
for each block of windows.
"""

from __future__ import annotations

import dataclasses

from ctc_chattering.dynamics.model import LinearModel, Model, rotors
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.numerics.linear_algebra import Array, Indices
import numpy as np


@dataclasses.dataclass(frozen=True)
class BodyRegressor:
    """
    Derivative of a model's torque by its parameters.

    The parameters are in the order: p inertial ones, n rotor inertias [kg·m²], gravity [m/s²].

    Attributes
    ----------
    model : LinearModel
        The model as its user describes it.
    gravity : ndarray, shape (3,)
        Gravity in the frame of the base about which torques are linear [m/s²].

    """

    model: LinearModel
    gravity: Array

    @classmethod
    def of(cls, model: Model, gravity: Array | None = None) -> BodyRegressor | None:
        """Return the regressor of a model, if one holds."""
        if not isinstance(model, LinearModel):
            return None
        downwards = np.array([0.0, 0.0, -model.gravity])
        parameters = model.inertial_parameters()
        # Its linearity is checked in three random states.
        states = np.random.default_rng(0).normal(size=(3, 3, model.n))
        for q, dq, ddq in states:
            torque = model.inverse_dynamics(q.tolist(), dq.tolist(), ddq.tolist())
            linear = model.torque_regressor(q, dq, ddq, downwards) @ parameters
            if not np.allclose(linear + rotors(model) * ddq, torque, rtol=1e-6, atol=1e-9):
                return None
        return cls(model, downwards if gravity is None else gravity)

    @property
    def inertial_count(self) -> int:
        """Return the number p of inertial parameters."""
        return len(self.model.inertial_parameters())

    @property
    def parameters(self) -> Array:
        """Parameters of the model, shape (p + n + 3,)."""
        downwards = np.array([0.0, 0.0, -self.model.gravity])
        return np.concatenate((self.model.inertial_parameters(), rotors(self.model), downwards))

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the torque's derivative, shape (n, p + n + 3)."""
        inertial = self.model.torque_regressor(q, dq, ddq, self.gravity)
        return np.concatenate((inertial, np.diag(ddq), self.model.gravity_map(q)), axis=1)

    def weak(
            self,
            q: Array,
            dq: Array,
            difference: Array,
            phi: TestFunction,
            centres: Indices) -> Array:
        """
        Return the derivative of the weak torque.

        Its shape is (J, n, p + n + 3).

        Parameters
        ----------
        q, dq : ndarray, shape (N, n)
            Smoothed positions [rad] and velocities [rad/s].
        difference : ndarray, shape (N, n)
            Velocities as differences of measured positions [rad/s].
        phi : TestFunction
            φ.
        centres : ndarray, shape (J,)
            Samples at the centres of the windows.

        """
        n = self.model.n
        p = self.inertial_count
        step = max(1, int(0.004 / phi.period))  # A grid of 4 ms at most.
        grid = np.arange(0, len(q), step)
        is_in_window = (np.abs(grid - centres[:, None]) < phi.half).any(axis=0)
        grid = grid[is_in_window]
        states = list(zip(q[grid], dq[grid]))
        momentum = np.array([self._momentum(*state) for state in states])
        remainder = np.array([self._remainder(*state) for state in states])
        weight = np.array([self.model.gravity_map(position) for position, _ in states])
        values, slopes = phi.weights(grid - centres[:, None], step)
        derivative = np.zeros((len(centres), n, p + n + 3))
        inertial = np.tensordot(values, remainder, 1) - np.tensordot(slopes, momentum, 1)
        derivative[:, :, :p] = inertial
        joints = np.arange(n)
        derivative[:, joints, p + joints] = -phi.sums(difference, phi.slope, centres)
        derivative[:, :, p + n:] = np.tensordot(values, weight, 1)
        return derivative

    def _momentum(self, q: Array, dq: Array) -> Array:
        """Return the regressor of the momentum M dq, shape (n, p)."""
        return self.model.torque_regressor(q, np.zeros_like(q), dq, np.zeros(3))

    def _remainder(self, q: Array, dq: Array) -> Array:
        """Return the regressor of G - Cᵀ dq, (EC1), shape (n, p)."""
        step = 1e-4  # [s]
        change = self._momentum(q + step * dq, dq) - self._momentum(q - step * dq, dq)
        torque = self.model.torque_regressor(q, dq, np.zeros_like(q), self.gravity)
        return torque - change / (2.0 * step)
