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
The paper's robot: two links in a vertical plane (Berghuis & Nijmeijer, 1993), in closed form.

With ``c2 = cos q2`` and ``s2 = sin q2``::

    M = [[8.77 + 1.02 c2, 0.76 + 0.51 c2], [0.76 + 0.51 c2, 0.62]]              [kg·m²]
    C = [[-0.51 s2 dq2, -0.51 s2 (dq1 + dq2)], [0.51 s2 dq1, 0]]
    G = g [7.6 sin q1 + 0.63 sin(q1 + q2), 0.63 sin(q1 + q2)]                   [N·m]

``q = 0`` hangs straight down. ``M22 < 0.76`` is the paper's: no rigid-body arm has it, but M is
positive definite for every q.
"""

from __future__ import annotations

from math import cos, sin

from ctc_chattering.compiled.compilable import function
from ctc_chattering.dynamics.model import LinearModel, Model
from ctc_chattering.numerics.linear_algebra import Array, Rows, Vector
import numpy as np


@function
def terms(gravity: float, q: Vector) -> tuple[float, float, float, float, float, float]:
    """Return M11, M12, M22 [kg·m²], 0.51 s2 [kg·m²], and G [N·m]."""
    c2, g12 = cos(q[1]), 0.63 * gravity * sin(q[0] + q[1])
    return (8.77 + 1.02 * c2, 0.76 + 0.51 * c2, 0.62, 0.51 * sin(q[1]),
            7.6 * gravity * sin(q[0]) + g12, g12)


class TwoLink(Model, LinearModel):
    """
    The paper's two-link arm.

    Parameters
    ----------
    gravity : float
        Acceleration g [m/s²].

    """

    n = 2

    def __init__(self, gravity: float = 9.81) -> None:
        self.gravity = gravity

    def inertial_parameters(self) -> Array:
        """Return the constants of M11, M12, M22, that of c2 in M12, and those of G over g."""
        return np.array((8.77, 0.76, 0.62, 0.51, 7.6, 0.63))

    def torque_regressor(self, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
        """
        Return the derivative of the torque by `inertial_parameters`, shape (2, 6).

        The arm moves in the plane of x and z of the base, towards x from hanging down.
        """
        (a1, a2), (v1, v2), c, s = ddq, dq, cos(q[1]), sin(q[1])
        both = q[0] + q[1]
        g1 = -(gravity[0] * cos(q[0]) + gravity[2] * sin(q[0]))
        g2 = -(gravity[0] * cos(both) + gravity[2] * sin(both))
        return np.array((
            (a1, a2, 0.0, c * (a1 + a1 + a2) - s * v2 * (v1 + v1 + v2), g1, g2),
            (0.0, a1, a2, c * a1 + s * v1 * v1, 0.0, g2)))

    def mass_matrix(self, q: Vector) -> Rows:
        """Return M(q), shape (2, 2)."""
        m11, m12, m22, *_ = terms(self.gravity, q)
        return (m11, m12), (m12, m22)

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:
        """Return C(q, dq), shape (2, 2)."""
        k = terms(self.gravity, q)[3]
        return (-k * dq[1], -k * (dq[0] + dq[1])), (k * dq[0], 0.0)

    def gravity_torque(self, q: Vector) -> Vector:
        """Return G(q), shape (2,)."""
        return terms(self.gravity, q)[4:]

    def potential_energy(self, q: Vector) -> float:
        """Return the potential energy, 0 where both links hang down [J]."""
        return self.gravity * (7.6 * (1.0 - cos(q[0])) + 0.63 * (1.0 - cos(q[0] + q[1])))

    def mass_and_bias(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Return M(q) and C(q, dq) dq + G(q) as arrays, shapes (2, 2) and (2,)."""
        if type(self) is not TwoLink:  # It may have terms of its own.
            return super().mass_and_bias(q, dq)
        m11, m12, m22, k, g1, g2 = terms(self.gravity, q.tolist())
        v1, v2 = dq.tolist()
        return (np.array(((m11, m12), (m12, m22))),
                np.array((g1 - k * v2 * (v1 + v1 + v2), k * v1 * v1 + g2)))
