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

"""Windows of a two-link arm of a URDF at random states, whose torques are known."""

from __future__ import annotations

import dataclasses

from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.identification.least_squares import Data
from ctc_chattering.identification.model_errors import ErrorColumns
from ctc_chattering.identification.windows import STRIBECK
import numpy as np
from rigid_bodies import Array
import urdfs

#: Windows.
COUNT = 400
#: Coulomb friction [N·m].
COULOMB = 2.0


def random_windows(rotor: Array, scale: float = 1.0, gear: float = 0.0, noise: float = 1e-3
                   ) -> tuple[Data, ErrorColumns]:
    """
    Return windows, and the columns of the arm's errors.

    Parameters
    ----------
    rotor : ndarray, shape (COUNT, 2) or what broadcasts to it
        Inertia of the rotors in each window [kg·m²].
    scale : float
        Torque at the joint over that of the signal.
    gear : float
        Part of what gears transmit that is friction.
    noise : float
        Of the torque [N·m].

    """
    model = UrdfModel(urdfs.two_links(), urdfs.TWO_LINKS)
    columns = ErrorColumns.of(model)
    assert columns is not None
    rng = np.random.default_rng(3)
    states = rng.normal(size=(COUNT, 3, 2))
    _, dq, ddq = states.transpose(1, 0, 2)
    base = np.array([model.inverse_dynamics(*(x.tolist() for x in state)) for state in states])
    way = np.sign(dq)
    friction = way * (COULOMB + gear * np.abs(base))
    torque = (base + rotor * ddq + friction + noise * rng.normal(size=(COUNT, 2))) / scale
    more = np.array([columns.at(*state) for state in states])
    return dataclasses.replace(
        Data.at(way, dq, torque, more), t=np.arange(float(COUNT)), base=base, load=np.abs(base),
        stribeck=np.zeros((COUNT, 2, len(STRIBECK))), residual=torque - base,
        floor=np.full(2, 1e-4)), columns
