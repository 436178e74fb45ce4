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
The numbers of a model that compiled dynamics take: a tree of bodies, or the paper's two links.

Frame of body i: at the joint, its axis along z. A body's parent comes before it.
"""

from __future__ import annotations

import dataclasses
from functools import lru_cache

from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import Arm as Arm
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@dataclasses.dataclass
class BodyScratch:
    """
    Scratch of the dynamics of a tree, all in the frame of the base and about its origin.

    Vectors of 3 are rows: position, angular part, linear part.
    """

    #: Rotation (n, 3, 3), origin, axis of every body.
    rotation: Array
    origin: Array
    #: Motion of each joint (6), its rate of change (6), twist (6) and acceleration (6).
    joint: Array
    joint_rate: Array
    twist: Array
    acceleration: Array
    #: Mass, first moment, inertia (6: xx, yy, zz, xy, xz, yz), of a body, then of all it carries.
    mass: Array
    moment: Array
    inertia: Array
    #: Velocity terms of the Coriolis matrix: W (3, 3) and linear momentum.
    coupling: Array
    momentum: Array
    #: Force on a body: moment and force (6).
    force: Array
    #: State of the joints; M, C and C dq + G there.
    q: Array
    dq: Array
    M: Array
    C: Array
    bias: Array


def arm_of(model: Model, inertia_scale: float = 1.0, gravity_scale: float = 1.0) -> Arm | None:
    """
    Return the numbers of a `TwoLink` or `UrdfModel`; None for another model.

    Parameters
    ----------
    model : Model
        Whose numbers they are.
    inertia_scale, gravity_scale : float
        Factors of M and C, and of G.

    """
    c, ratio = inertia_scale, gravity_scale / inertia_scale
    if type(model) is UrdfModel:
        arm = _bodies(model)
        return dataclasses.replace(
            arm, gravity=ratio * model.gravity, mass=c * arm.mass, inertia=c * arm.inertia,
            rotor=c * arm.rotor)
    if type(model) is not TwoLink:
        return None
    none, row, square = np.zeros(model.n), np.zeros((model.n, 3)), np.zeros((model.n, 3, 3))
    return Arm(True, ratio * model.gravity, c, none.astype(np.int64), none.astype(np.bool_),
               none.astype(np.int64), square, row, none, row, square, none)


@lru_cache(64)
def _bodies(model: UrdfModel) -> Arm:
    """Return the bodies of a model; those of many runs are one model."""
    return model.bodies()


def body_scratch(n: int) -> BodyScratch:
    """Return scratch for `n` joints."""
    def rows(*shape: int) -> Array:
        return np.zeros((n, *shape))
    return BodyScratch(
        rows(3, 3), rows(3), rows(6), rows(6), rows(6), rows(6), rows(), rows(3), rows(6),
        rows(3, 3), rows(3), rows(6), rows(), rows(), rows(n), rows(n), rows())
