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
The paper's robot: two links in closed form.

It is the default `model` of the nodes, and needs no URDF (Berghuis & Nijmeijer, 1993). With
``c2 = cos q2`` and ``s2 = sin q2``::

    M = [[8.77 + 1.02 c2, 0.76 + 0.51 c2], [0.76 + 0.51 c2, 0.62]]              [kg·m²]
    C = [[-0.51 s2 dq2, -0.51 s2 (dq1 + dq2)], [0.51 s2 dq1, 0]]
    G = g [7.6 sin q1 + 0.63 sin(q1 + q2), 0.63 sin(q1 + q2)]                   [N·m]

``q = 0`` hangs straight down. ``M22 < 0.76`` is the paper's. No rigid-body arm has it, but M is
positive definite for every q.
"""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

from ctc_chattering.compiled.compilable import function
from ctc_chattering.dynamics.model import LinearModel, Model
from ctc_chattering.numerics.linear_algebra import Array, Rows, Vector
import numpy as np


class TwoLinkTerms(NamedTuple):
    """Elements of M and G, and 0.51 s2 of C."""

    #: [kg·m²]
    m11: float
    m12: float
    m22: float
    coupling: float
    #: [N·m]
    g1: float
    g2: float


@function
def terms(gravity: float, q: Vector) -> TwoLinkTerms:
    """Return the terms at a position."""
    c2 = cos(q[1])
    g2 = 0.63 * gravity * sin(q[0] + q[1])
    return TwoLinkTerms(
        8.77 + 1.02 * c2,
        0.76 + 0.51 * c2,
        0.62,
        0.51 * sin(q[1]),
        7.6 * gravity * sin(q[0]) + g2,
        g2,
    )


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
        """Return the constants of M11, M12, M22, c2 and G."""
        return np.array((8.77, 0.76, 0.62, 0.51, 7.6, 0.63))

    def torque_regressor(
        self, q: Array, dq: Array, ddq: Array, gravity: Array
    ) -> Array:
        """
        Return the torque per parameter, shape (2, 6).

        The arm moves in the plane of x and z of the base, towards x from hanging down.
        """
        a1, a2 = ddq
        v1, v2 = dq
        c2 = cos(q[1])
        s2 = sin(q[1])
        g1 = _torque_per_moment(gravity, q[0])
        g2 = _torque_per_moment(gravity, q[0] + q[1])
        coupling1 = c2 * (a1 + a1 + a2) - s2 * v2 * (v1 + v1 + v2)
        coupling2 = c2 * a1 + s2 * v1 * v1
        return np.array(
            (
                (a1, a2, 0.0, coupling1, g1, g2),
                (0.0, a1, a2, coupling2, 0.0, g2),
            )
        )

    def mass_matrix(self, q: Vector) -> Rows:
        """Return M(q), shape (2, 2)."""
        t = terms(self.gravity, q)
        return (t.m11, t.m12), (t.m12, t.m22)

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:
        """Return C(q, dq), shape (2, 2)."""
        k = terms(self.gravity, q).coupling
        return (-k * dq[1], -k * (dq[0] + dq[1])), (k * dq[0], 0.0)

    def gravity_torque(self, q: Vector) -> Vector:
        """Return G(q), shape (2,)."""
        t = terms(self.gravity, q)
        return t.g1, t.g2

    def potential_energy(self, q: Vector) -> float:
        """Return the potential energy, 0 at hanging links [J]."""
        first = 7.6 * (1.0 - cos(q[0]))
        second = 0.63 * (1.0 - cos(q[0] + q[1]))
        return self.gravity * (first + second)

    def mass_and_bias(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Return M and C dq + G as arrays."""
        if type(self) is not TwoLink:  # It may have terms of its own.
            return super().mass_and_bias(q, dq)
        t = terms(self.gravity, q.tolist())
        v1, v2 = dq.tolist()
        k = t.coupling
        M = np.array(((t.m11, t.m12), (t.m12, t.m22)))
        bias1 = t.g1 - k * v2 * (v1 + v1 + v2)
        bias2 = k * v1 * v1 + t.g2
        return M, np.array((bias1, bias2))


def _torque_per_moment(gravity: Array, angle: float) -> float:
    """Return the gravity torque of a link per first moment [m/s²]."""
    return -float(gravity[0] * cos(angle) + gravity[2] * sin(angle))
