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

"""Inertial parameters of the moved bodies, as a model has them and as a motion shows them."""

from __future__ import annotations

import dataclasses

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: The ten parameters of a body, in Pinocchio's order: mass [kg], first moments [kg·m], and moments
#: of inertia about the joint's frame [kg·m²].
PARAMETERS = ('m', 'mx', 'my', 'mz', 'Ixx', 'Ixy', 'Iyy', 'Ixz', 'Iyz', 'Izz')


@dataclasses.dataclass(frozen=True)
class BodyEstimate:
    """
    Parameters of B bodies: links that are fixed to each other are one, in its joint's frame.

    Body i is the one that joint i of n carries, B = n. With the inertias of R rotors, n or 0, and
    the G components of gravity, 3 or 0, there are P = 10 B + R + G parameters. A motion shows
    fewer combinations of them. `information` is 0 along what it does not show, and what is found
    is that of the model there.

    Attributes
    ----------
    names : tuple of str, length B
        Of the heaviest link of each body.
    prior, value : ndarray, shape (B, 10)
        `PARAMETERS` of the model, and those that fit the motion best; nothing makes these belong
        to a body.
    information : ndarray, shape (P, P)
        Normal matrix of the parameters, row by row, then rotors, then gravity, without what
        friction explains: with all parameters x, twice the logarithm of the likelihood ratio is
        (x - found)ᵀ information (x - found). [1/(kg, kg·m, kg·m²)²]
    rotor_prior, rotor : ndarray, shape (R,)
        Inertias of rotors, reflected to the joints: of the model, and those that fit [kg·m²].
    torque : ndarray, shape (n, P, P)
        Mean over the motion of the products of the columns of each joint's torque, without what
        friction explains: the root mean square of what d parameters make is √(dᵀ torque d).
        Empty where unknown.
    gravity_prior, gravity, gravity_about : ndarray, shape (G,)
        In the frame of the base: of the model, what fits, and about which torques are linear
        [m/s²].

    """

    names: tuple[str, ...]
    prior: Array
    value: Array
    information: Array
    rotor_prior: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    rotor: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    torque: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 0, 0)))
    gravity_prior: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    gravity: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    gravity_about: Array = dataclasses.field(default_factory=lambda: np.zeros(0))

    @property
    def known(self) -> Array:
        """Return the parameters of the model, shape (P,)."""
        return np.concatenate((self.prior.ravel(), self.rotor_prior, self.gravity_prior))

    @property
    def found(self) -> Array:
        """Return the parameters that fit the motion best, shape (P,)."""
        return np.concatenate((self.value.ravel(), self.rotor, self.gravity))
