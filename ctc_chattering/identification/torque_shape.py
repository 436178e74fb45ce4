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
Torque of a joint as weight, inertial torque and friction, each with a factor.

`conventions.py` and `torque_constants.py` judge units and signs by these factors. A factor of the
weight far from 1 means another unit. Friction or inertia below 0 means the other sign.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.identification.regression import correlation_length, Observations
from ctc_chattering.numerics.linear_algebra import Array, Flags
import numpy as np


class Factor(NamedTuple):
    """Factor of a column of the torque, with its standard error or inf."""

    value: float
    error: float

    @property
    def sign(self) -> float:
        """Sign of the factor; 0 within three standard errors of 0."""
        return float(np.sign(self.value)) if abs(self.value) > 3.0 * self.error else 0.0

    @property
    def is_known(self) -> bool:
        """Return whether the factor is known to 15 %."""
        return self.error < 0.15 * max(abs(self.value), 0.5)


class Factors(NamedTuple):
    """
    Factors of columns that explain a torque.

    Attributes
    ----------
    factors : tuple of Factor
        Factor of each column.
    unexplained : float
        Fraction of the torque's variance that remains.

    """

    factors: tuple[Factor, ...]
    unexplained: float

    @classmethod
    def fit(cls, columns: Array, target: Array) -> Factors:
        """Return the factors with the least squared residual."""
        sizes = np.maximum(np.abs(columns).max(axis=0, initial=0.0), 1e-300)
        scaled = columns / sizes
        value, _, rank, _ = np.linalg.lstsq(scaled, target, rcond=1e-9)
        residual = target - scaled @ value
        variance = float(residual @ residual) / max(len(target) - len(value), 1)
        variance *= correlation_length(residual)
        normal = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12)
        error = np.sqrt(np.maximum(variance * normal.diagonal(), 0.0))
        if rank < len(value):
            error = np.where(np.abs(columns).max(axis=0) > 0.0, error, np.inf)
        power = float(np.square(target - target.mean()).sum()) if len(target) else 0.0
        factors = map(Factor, (value / sizes).tolist(), (error / sizes).tolist())
        unexplained = float(residual @ residual) / power if power > 0.0 else 1.0
        return cls(tuple(factors), unexplained)


def fit_model(data: Observations, joint: int, signal: int | None = None) -> Factors:
    """
    Return factors of a torque, those of weight and inertial torque first.

    With `signal`, it is the torque of another joint, over the motion of this one.
    """
    used = data.used[:, joint]
    if signal is None:
        signal = joint
    else:
        used = used & data.used[:, signal]
    torque = data.torque[used, signal]
    weight = data.windows.weight[used, joint]
    inertial = data.windows.model_torque[used, joint] - weight
    columns = np.column_stack((weight, inertial, friction_columns(data, joint, used)))
    fitted = Factors.fit(columns, torque)
    # Weight below 2 % of the torque shows no factor.
    if np.std(weight) > 0.02 * max(float(np.std(torque)), 1e-300):
        return fitted
    weight_factor, *further = fitted.factors
    return fitted._replace(factors=(weight_factor._replace(error=np.inf), *further))


def fit_beside_any_gravity(data: Observations, joint: int) -> Factors:
    """
    Return factors of a torque beside weight along any direction.

    The first two are those of the direction and of the inertial torque.
    """
    windows, used = data.windows, data.used[:, joint]
    weight = windows.weight[used, joint]
    inertial = windows.model_torque[used, joint] - weight
    direction, velocity, constant = friction_columns(data, joint, used).T
    pull = windows.bodies[used, joint, -3:] if windows.bodies.shape[2] else weight[:, None]
    columns = np.column_stack((direction, inertial, velocity, constant, pull))
    return Factors.fit(columns, data.torque[used, joint])


def friction_columns(data: Observations, joint: int, used: Flags) -> Array:
    """Return direction, velocity and a constant, shape (rows, 3)."""
    windows = data.windows
    return np.column_stack((
        windows.direction[used, joint], windows.velocity[used, joint], np.ones(int(used.sum()))))
