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
from numbers import Real

from ctc_chattering.arguments import checked
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Rows, Vector


class TwoLink(Model):
    """
    The paper's two-link arm.

    Parameters
    ----------
    gravity : float
        Acceleration g [m/s²].

    """

    n = 2

    @checked(gravity=Real)
    def __init__(self, gravity: float = 9.81) -> None:
        self.gravity = gravity
        self._g1 = 7.6 * gravity
        self._g2 = 0.63 * gravity

    def mass_matrix(self, q: Vector) -> Rows:
        """Return M(q), shape (2, 2)."""
        c2 = cos(q[1])
        m12 = 0.76 + 0.51 * c2
        return ((8.77 + 1.02 * c2, m12), (m12, 0.62))

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:
        """Return C(q, dq), shape (2, 2)."""
        k = 0.51 * sin(q[1])
        return ((-k * dq[1], -k * (dq[0] + dq[1])), (k * dq[0], 0.0))

    def gravity_torque(self, q: Vector) -> Vector:
        """Return G(q), shape (2,)."""
        g12 = self._g2 * sin(q[0] + q[1])
        return (self._g1 * sin(q[0]) + g12, g12)

    def potential_energy(self, q: Vector) -> float:
        """Return the potential energy, 0 where both links hang down [J]."""
        return self._g1 * (1.0 - cos(q[0])) + self._g2 * (1.0 - cos(q[0] + q[1]))

    def inverse_dynamics(self, q: Vector, dq: Vector, a: Vector) -> Vector:
        """Return M(q) a + C(q, dq) dq + G(q), shape (2,)."""
        q1, q2 = q
        dq1, dq2 = dq
        a1, a2 = a
        c2 = cos(q2)
        k = 0.51 * sin(q2)
        m12 = 0.76 + 0.51 * c2
        g12 = self._g2 * sin(q1 + q2)
        return ((8.77 + 1.02 * c2) * a1 + m12 * a2 - k * dq2 * (dq1 + dq1 + dq2)
                + self._g1 * sin(q1) + g12,
                m12 * a1 + 0.62 * a2 + k * dq1 * dq1 + g12)

    def forward_dynamics(self, q: Vector, dq: Vector, u: Vector, fixed_joints: int = 0) -> Vector:
        """Return ddq, shape (2,), with the joints of the bit mask `fixed_joints` held still."""
        q1, q2 = q
        dq1, dq2 = dq
        c2 = cos(q2)
        k = 0.51 * sin(q2)
        g12 = self._g2 * sin(q1 + q2)
        r1 = u[0] + k * dq2 * (dq1 + dq1 + dq2) - self._g1 * sin(q1) - g12
        r2 = u[1] - k * dq1 * dq1 - g12
        if not fixed_joints:
            m11 = 8.77 + 1.02 * c2
            m12 = 0.76 + 0.51 * c2
            det = m11 * 0.62 - m12 * m12
            return ((0.62 * r1 - m12 * r2) / det, (m11 * r2 - m12 * r1) / det)
        if fixed_joints == 1:
            return (0.0, r2 / 0.62)
        if fixed_joints == 2:
            return (r1 / (8.77 + 1.02 * c2), 0.0)
        return (0.0, 0.0)
