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

"""A model with inertia and gravity scaled: what a controller has that knows its arm badly."""

from __future__ import annotations

from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Rows, Vector


class Scaled(Model):
    """
    Another model with M and C times one factor and G times another.

    Parameters
    ----------
    model : Model
        The one to scale.
    inertia : float
        Factor of M and C.
    gravity : float
        Factor of G.

    """

    def __init__(self, model: Model, inertia: float, gravity: float) -> None:
        self.n, self.effort_limits = model.n, model.effort_limits
        self._model = model
        self._inertia, self._gravity = inertia, gravity

    def mass_matrix(self, q: Vector) -> Rows:
        """Return M(q), shape (n, n)."""
        return [[self._inertia * x for x in row] for row in self._model.mass_matrix(q)]

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:
        """Return C(q, dq), shape (n, n)."""
        return [[self._inertia * x for x in row] for row in self._model.coriolis_matrix(q, dq)]

    def gravity_torque(self, q: Vector) -> Vector:
        """Return G(q), shape (n,)."""
        return [self._gravity * x for x in self._model.gravity_torque(q)]

    def potential_energy(self, q: Vector) -> float:
        """Return the scaled potential energy [J]."""
        return self._gravity * self._model.potential_energy(q)
