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
"""Torques of a Panda with friction, in random states, for the tests of its conventions."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from ctc_chattering.identification.prior import BodyPrior
from ctc_chattering.identification.regression import Observations
from ctc_chattering.identification.windows import Windows
from ctc_chattering.numerics.linear_algebra import Array
from made_up_windows import arm_windows, observed
import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]
import urdfs

#: Coulomb friction of a geared arm [N·m], and viscous friction [N·m·s/rad].
COULOMB = np.array([4.0, 4.0, 3.0, 3.0, 1.0, 1.0, 0.5])
VISCOUS = 0.3 * COULOMB
JOINTS = urdfs.PANDA


class PandaTorque(NamedTuple):
    """Windows, the prior of the bodies, and the torque of the robot [N·m]."""

    rows: Windows
    prior: BodyPrior
    torque: Array


@cache
def panda_torque() -> PandaTorque:
    """Return the arm in 500 random states."""
    rows, regressor = arm_windows(urdfs.panda(), JOINTS, 500)
    friction = rows.direction * COULOMB + rows.velocity * VISCOUS
    noise = 0.05 * np.random.default_rng(1).normal(size=friction.shape)
    return PandaTorque(rows, BodyPrior.of(regressor, 0.2), rows.model_torque + friction + noise)


def scaled_torque(factor: Array | float = 1.0) -> Observations:
    """Return windows with the torque times a factor."""
    return observed(panda_torque().rows, panda_torque().torque * factor)


def turned_base(rotation: Rotation, sign: float = 1.0) -> tuple[Observations, Array]:
    """Return the torque of the arm on a turned base, and gravity in its frame."""
    rows, _, torque = panda_torque()
    gravity = rotation.apply([0.0, 0.0, -9.81])
    change = rows.bodies[:, :, -3:] @ (gravity - [0.0, 0.0, -9.81])
    return observed(rows, sign * (torque + change)), gravity
