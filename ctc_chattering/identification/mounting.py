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
Mounting of the base, as the torque shows it.

`identify` asks for it before the drives are timed. Where gravity along another direction explains
the torque much better, the base is mounted that way.
"""

from __future__ import annotations

from ctc_chattering.identification.regression import Observations
from ctc_chattering.identification.torque_shape import friction_columns
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


def estimate_gravity(data: Observations, gravity: Array) -> Array:
    """
    Return gravity in the frame of the base, shape (3,) [m/s²].

    It is that of the model, if no other direction explains the torque much better.

    Parameters
    ----------
    data : Observations
        Windows with the torque, and with the columns of gravity.
    gravity : ndarray, shape (3,)
        Gravity of the model [m/s²].

    """
    strength = float(np.linalg.norm(gravity))
    moving = np.flatnonzero(data.moving).tolist()
    if not strength or not moving or not data.windows.bodies.shape[2]:
        return gravity
    equations = [_gravity_equations(data, joint, gravity) for joint in moving]
    columns, target = map(np.concatenate, zip(*equations))
    fitted = np.linalg.lstsq(columns, target, rcond=1e-6)[0]
    # Across the plane of a planar arm gravity has no torque: there it stays as in the model.
    fitted += gravity - np.linalg.lstsq(columns, columns @ gravity, rcond=1e-6)[0]
    remaining = float(np.square(target - columns @ fitted).sum())
    original = float(np.square(target - columns @ gravity).sum())
    size = float(np.linalg.norm(fitted))
    turned = np.asarray(strength * fitted / max(size, 1e-300), float)
    is_better = remaining / max(original, 1e-300) < 0.5
    is_possible = 0.6 < size / strength < 1.6
    if is_better and is_possible and angle_between(gravity, turned) > 0.03:  # [rad]
        return turned
    return gravity


def _gravity_equations(data: Observations, joint: int, gravity: Array) -> tuple[Array, Array]:
    """Return columns of gravity and the torque, beside friction and inertia."""
    windows, used = data.windows, data.used[:, joint]
    scale = 1.0 / float(data.deviation[joint])
    pull = windows.bodies[used, joint, -3:]
    torque = data.beyond_model[used, joint] + pull @ gravity
    other_columns = np.column_stack((
        friction_columns(data, joint, used), windows.acceleration[used, joint]))
    basis = np.linalg.qr(other_columns)[0]
    columns = scale * (pull - basis @ (basis.T @ pull))
    return columns, scale * (torque - basis @ (basis.T @ torque))


def angle_between(a: Array, b: Array) -> float:
    """Return the angle between two vectors [rad], exact for small ones."""
    a = a / np.linalg.norm(a)
    b = b / np.linalg.norm(b)
    return float(2.0 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))
