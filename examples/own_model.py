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
A model of your own: a rod on a hinge.

In the parameter file, with this folder on PYTHONPATH::

    /**:
      ros__parameters: {joint_names: [swing], model: 'own_model:Pendulum'}

``ctc check-model --model own_model:Pendulum --joints swing`` tests it.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin

from ctc_chattering import Model

Vector = Sequence[float]


class Pendulum(Model):
    """A rod of 2 kg and 0.8 m; 0 is hanging down."""

    def __init__(self, joint_names: Sequence[str], gravity: float) -> None:
        self.n = len(joint_names)
        self.weight = 2.0 * gravity * 0.4

    def mass_matrix(self, q: Vector) -> list[Vector]:
        """Return M, shape (1, 1) [kg·m²]."""
        del q
        return [[2.0 * 0.8 ** 2 / 3.0]]

    def coriolis_matrix(self, q: Vector, dq: Vector) -> list[Vector]:
        """Return C, shape (1, 1)."""
        del q, dq
        return [[0.0]]

    def gravity_torque(self, q: Vector) -> Vector:
        """Return G, shape (1,) [N·m]."""
        return [self.weight * sin(q[0])]

    def potential_energy(self, q: Vector) -> float:
        """Return the potential whose gradient is G [J]."""
        return -self.weight * cos(q[0])
