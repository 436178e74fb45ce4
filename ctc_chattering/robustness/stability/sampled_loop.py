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
The sampled loop of a linear law and a robot whose model is wrong.

M is the robot's mass matrix, M̂ the model's, both constant. All eigenvalues of M̂ M⁻¹ are 1 for
the exact model. With X = M̂^½ M⁻¹ M̂^½, which has the same ones, a period of the robot is::

    q⁺  = q + h dq + ½ h² M̂^-½ X M̂^-½ (m + r)
    dq⁺ = dq + h M̂^-½ X M̂^-½ m                                                       (XL1)

with m the mean of the torque of the drives over it, and m + r the mean weighted by the time that
is left (`control/drive_model.py`). So X is a feedback between signals of the loop without it::

    z = (M̂^-½ m, s M̂^-½ r),     w = (X, X) z                                         (XL2)

for any s > 0.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.control.drive_model import drive_model
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.robustness.stability.linear_law import LinearLaw
import numpy as np


class LinearRobot(NamedTuple):
    """What the loop has besides the law."""

    #: h [s].
    period: float
    #: M̂ [kg·m²], shape (n, n).
    mass: Array
    #: T of the drives [s], shape (n,), and their delay in samples.
    lag: Array
    delay: int
    #: Whether the velocity is the difference of positions; exact otherwise.
    differenced: bool = False


class SampledLoop(NamedTuple):
    """The loop of (XL2): state⁺ = A state + B w, z = C state, for s = 1."""

    #: Shapes (m, m), (m, 2 n) and (2 n, m).
    A: Array
    B: Array
    C: Array

    def closed(self, ratio: float) -> Array:
        """Return the matrix of the loop for M̂ = `ratio` M, shape (m, m)."""
        return self.A + ratio * self.B @ self.C

    def scaled(self, s: float) -> SampledLoop:
        """Return the loop for another s of (XL2)."""
        n = len(self.C) // 2
        scale = np.array([1.0] * n + [s] * n)
        return SampledLoop(self.A, self.B / scale, scale[:, np.newaxis] * self.C)

    def radius(self, ratio: float = 1.0) -> float:
        """Return the largest absolute value of a pole for M̂ = `ratio` M."""
        return float(np.abs(np.linalg.eigvals(self.closed(ratio))).max())


def sampled_loop(law: LinearLaw, robot: LinearRobot) -> SampledLoop:
    """Return the loop of a law and a robot of n joints."""
    n, h, delay, m = len(robot.mass), robot.period, robot.delay, len(law.A)
    drives = drive_model(robot.lag, np.full(n, np.inf), h)
    # State: q, dq, torque of the drives, torques in transit, q a sample ago, memory of the law.
    sizes = [n, n, n, delay * n, n if robot.differenced else 0, m]
    q, dq, torque, transit, last, memory = np.split(
        np.eye(sum(sizes)), np.cumsum(np.array(sizes))[:-1])
    y = np.vstack([q, (q - last) / h if robot.differenced else dq])
    sent = law.C @ memory + law.D @ y
    command = np.vstack([transit, sent])
    gap = torque - command[:n]
    mean = command[:n] + drives.mean[:, np.newaxis] * gap
    rest = command[:n] + drives.weighted[:, np.newaxis] * gap - mean
    values, vectors = np.linalg.eigh(robot.mass)
    root = vectors / np.sqrt(values) @ vectors.T
    B = np.zeros((sum(sizes), 2 * n))
    B[:n, :n] = B[:n, n:] = 0.5 * h * h * root
    B[n:2 * n, :n] = h * root
    return SampledLoop(
        np.vstack([q + h * dq, dq, command[:n] + drives.decay[:, np.newaxis] * gap, command[n:],
                   q[:len(last)], law.A @ memory + law.B @ y]),
        B, np.vstack([root @ mean, root @ rest]))


def one_joint(law: LinearLaw) -> LinearLaw:
    """Return the first joint of a law whose joints are independent and equal."""
    of_y = np.array([0, len(law.D)])
    mine = law.B[:, of_y].any(axis=1)
    for _ in range(len(law.A)):
        mine = mine | law.A[:, mine].any(axis=1)
    return LinearLaw(law.A[mine][:, mine], law.B[mine][:, of_y], law.C[:1, mine],
                     law.D[:1, of_y])
