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

"""Models whose torque is linear in inertial parameters and in the vector of gravity."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@runtime_checkable
class LinearModel(Protocol):
    """What a model offers besides `Model` if errors of its parameters are to be identified."""

    n: int
    gravity: float

    def inertial_parameters(self) -> Array:
        """Return the parameters, shape (p,)."""

    def parameter_sizes(self) -> Array:
        """Return by how much each may be off at most, roughly, shape (p,)."""

    def torque_regressor(self, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
        """
        Return the derivative of the inverse dynamics by the parameters, shape (n, p).

        `gravity` is the vector of its acceleration in the frame of the base, shape (3,) [m/s²].
        """

    def gravity_map(self, q: Array) -> Array:
        """Return the derivative of G(q) by the vector of gravity, shape (n, 3)."""


def rotors(model: LinearModel) -> Array:
    """Return the inertias of rotors that a model has, shape (n,) [kg·m²]; only a URDF has any."""
    return np.array(getattr(model, 'rotor_inertias', (0.0,) * model.n))
