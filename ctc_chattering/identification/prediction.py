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
Prediction of torque that was not fitted, which judges an identification.

Four predictions are compared: the mean torque, the given model, that model with friction, and the
identified model. Each is of blocks of time that were left out. `verdict` decides by their errors.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property

from ctc_chattering.identification.regression import BLOCKS, blocks_of_time, Fit, Observations
from ctc_chattering.identification.selection import friction_columns
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Distances of windows without a common sample, at which lasting torque still correlates.
APART = range(4, 13)


@dataclasses.dataclass(frozen=True)
class Prediction:
    """
    Torque on data that were not fitted, of J windows and n joints.

    Attributes
    ----------
    t : ndarray, shape (J,)
        Times of the windows [s].
    measured : ndarray, shape (J, n)
        Torque of the recording [N·m], nan where a joint rests, or the torque is not known.
    model : ndarray, shape (J, n)
        The model as it was given [N·m].
    with_friction : ndarray, shape (J, n)
        That model with friction of each joint [N·m].
    identified : ndarray, shape (J, n)
        Bodies, rotors and friction as identified [N·m].
    weights : ndarray, shape (J, n)
        Of the windows: less than 1 for outliers, and where a joint rests for a while.

    """

    t: Array
    measured: Array
    model: Array
    with_friction: Array
    identified: Array
    weights: Array

    @classmethod
    def of(cls, fit: Fit) -> Prediction:
        """Return the predictions of a fit."""
        data = fit.data
        torque = data.windows.model_torque
        friction = np.stack(
            [_friction_alone(data, joint) for joint in range(data.joint_count)], axis=1
        )
        return cls(
            data.windows.t,
            np.where(data.used, data.torque, np.nan),
            torque,
            torque + friction,
            torque + fit.held_out,
            fit.noise.weights,
        )

    @cached_property
    def recording_rms(self) -> Array:
        """RMS of the measured torque about its mean, shape (n,) [N·m]."""
        return _rms(self.measured - _mean(self.measured))

    @cached_property
    def model_rms(self) -> Array:
        """RMS error of the given model, shape (n,) [N·m]."""
        return _rms(self.measured - self.model)

    @cached_property
    def with_friction_rms(self) -> Array:
        """RMS error of the given model with friction, shape (n,) [N·m]."""
        return _rms(self.measured - self.with_friction)

    @cached_property
    def identified_rms(self) -> Array:
        """RMS error of the identified model, shape (n,) [N·m]."""
        return _rms(self.measured - self.identified)

    @cached_property
    def typical_rms(self) -> Array:
        """RMS error of the identified model without outliers, shape (n,) [N·m]."""
        square = np.nan_to_num(np.square(self.measured - self.identified)) * self.weights
        weights = np.where(np.isfinite(self.measured), self.weights, 0.0)
        mean = square.sum(axis=0) / np.maximum(weights.sum(axis=0), 1e-300)
        return np.asarray(np.sqrt(mean))

    @cached_property
    def systematic_rms(self) -> Array:
        """RMS of the error that lasts beyond a window, (n,) [N·m]."""
        return np.array(
            [_lasting(x, w) for x, w in zip((self.measured - self.identified).T, self.weights.T)]
        )


def _friction_alone(data: Observations, joint: int) -> Array:
    """Return friction, fitted to other blocks, shape (J,)."""
    columns, target = friction_columns(data, joint), data.beyond_model[:, joint]
    block, used = blocks_of_time(len(target)), data.used[:, joint]
    predicted = np.zeros(len(target))
    for k in range(BLOCKS):
        fitted = used & (block != k)
        value = np.linalg.lstsq(columns[fitted], target[fitted], rcond=None)[0]
        predicted[block == k] = columns[block == k] @ value
    return predicted


def _mean(values: Array) -> Array:
    """Return the mean of each column, or 0, without nan."""
    is_number = np.isfinite(values)
    return np.asarray(
        np.where(is_number, values, 0.0).sum(axis=0) / np.maximum(is_number.sum(axis=0), 1)
    )


def _rms(values: Array) -> Array:
    """Return the root mean square of each column without nan."""
    return np.sqrt(_mean(np.square(values)))


def _lasting(residual: Array, weights: Array) -> float:
    """
    Return the RMS of a residual that lasts beyond a window [N·m].

    Parameters
    ----------
    residual, weights : ndarray, shape (J,)
        Values of windows. Those that are nan are left out.

    """
    weights = np.where(np.isfinite(residual), np.sqrt(weights), 0.0)
    x = weights * np.nan_to_num(residual)
    power = float(x @ x) / max(float(weights @ weights), 1e-300)
    products, pairs = [], []
    for k in APART:
        pairs.append(float(weights[k:] @ weights[:-k]))
        products.append(float(x[k:] @ x[:-k]) / max(pairs[-1], 1e-300))
    # Chance gives a mean product of about the power over the root of the number of pairs.
    mean = float(np.mean(products)) - 2.0 * power / np.sqrt(max(min(pairs), 1.0))
    return float(np.sqrt(mean)) if mean > 1e-10 * power else 0.0  # Less is rounding.
