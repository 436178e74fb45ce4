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
Windows of the regression, with the terms of (WF1).

Each window is a row of the regression for every joint. Its friction is the mean of the direction
of motion, so a window may contain a reversal. A window in which a joint rests tells little of that
joint, since static friction can be anything up to the Coulomb friction. `identify` builds the
windows of each stretch.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import Any

from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.regressor import BodyRegressor
from ctc_chattering.identification.stretches import Stretch
from ctc_chattering.identification.weak_form import (
    Dynamics,
    position_noise,
    smooth,
    smoothing_half,
    TestFunction,
    velocity_deviation,
)
from ctc_chattering.numerics.linear_algebra import Array, Flags, Indices
import numpy as np
from scipy.interpolate import make_interp_spline  # type: ignore[import-untyped]

#: Velocities for which a column of Stribeck friction is prepared [rad/s].
STRIBECK_VELOCITIES = tuple(0.005 * 10.0 ** (k / 8.0) for k in range(17))
#: Weights of these columns for a velocity between them, by its index.
_STRIBECK_WEIGHTS = make_interp_spline(
    np.arange(len(STRIBECK_VELOCITIES)),
    np.eye(len(STRIBECK_VELOCITIES)),
    3)
#: Time before the first window, in which drives reach what was commanded before [s].
SETTLING_S = 0.1


@dataclasses.dataclass(frozen=True)
class Windows:
    """
    Terms of (WF1) in J windows of n joints.

    The bodies have P parameters, and there are S Stribeck velocities.
    All are means over a window, weighted by φ.

    Attributes
    ----------
    t : ndarray, shape (J,)
        Times of the centres [s].
    centres : ndarray, shape (J,)
        Samples of the centres in their stretch.
    model_torque : ndarray, shape (J, n)
        Torque of the model without friction [N·m].
    weight : ndarray, shape (J, n)
        The part of it that is weight [N·m].
    bodies : ndarray, shape (J, n, P)
        Derivative of `model_torque` by the parameters, P = 0 for a model without a regressor.
    direction : ndarray, shape (J, n)
        Sign of the velocity, 0 while a joint rests.
    resting : ndarray, shape (J, n)
        Share of the window in which a joint rests.
    velocity, acceleration : ndarray, shape (J, n)
        [rad/s, rad/s²]. The acceleration is integrated by parts.
    stribeck : ndarray, shape (J, n, S)
        sgn(dq) exp(-(dq / v)²) for each of `STRIBECK_VELOCITIES`.
    load : ndarray, shape (J, n)
        sgn(dq) times the magnitude of the model's torque [N·m].

    """

    t: Array
    centres: Indices
    model_torque: Array
    weight: Array
    bodies: Array
    direction: Array
    resting: Array
    velocity: Array
    acceleration: Array
    stribeck: Array
    load: Array

    @classmethod
    def of(
            cls,
            stretch: Stretch,
            model: Model,
            phi: TestFunction,
            regressor: BodyRegressor | None) -> Windows:
        """Return the windows of a stretch."""
        q, period = stretch.q, stretch.period
        margin = max(smoothing_half(period), round(SETTLING_S / period)) + 1
        centres = phi.centres(len(q), margin)
        threshold = moving_threshold(q, period)
        blocks = [_terms(q, period, model, phi, regressor, block, threshold)
                  for block in phi.blocks(centres) if len(block)]
        if not blocks:
            return cls._empty(q.shape[1])
        columns = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
        return cls(t=stretch.t[centres], centres=centres, **columns)

    @classmethod
    def _empty(cls, n: int) -> Windows:
        """Return no windows of n joints."""
        columns: dict[str, Any] = {
            field.name: np.empty((0, n)) for field in dataclasses.fields(cls)}
        columns['t'] = np.empty(0)
        columns['centres'] = np.empty(0, int)
        columns['bodies'] = np.empty((0, n, 0))
        columns['stribeck'] = np.empty((0, n, len(STRIBECK_VELOCITIES)))
        return cls(**columns)

    def stribeck_column(self, joint: int, index: float) -> Array:
        """Return a column of Stribeck friction, also between two, shape (J,)."""
        return np.asarray(self.stribeck[:, joint] @ _STRIBECK_WEIGHTS(index))

    def select(self, is_chosen: Flags, first_sample: int = 0) -> Windows:
        """Return some windows of a stretch without its samples before `first_sample`."""
        columns = {field.name: getattr(self, field.name)[is_chosen]
                   for field in dataclasses.fields(self)}
        columns['centres'] = columns['centres'] - first_sample
        return Windows(**columns)

    def with_gravity(self, change: Array) -> Windows:
        """Return the windows with a change of gravity, shape (3,) [m/s²]."""
        added = self.bodies[:, :, -3:] @ change
        torque = self.model_torque + added
        return dataclasses.replace(
            self,
            model_torque=torque,
            weight=self.weight + added,
            load=self.direction * np.abs(torque))


def join_windows(windows: Sequence[Windows]) -> Windows:
    """Return the windows of all stretches."""
    if len(windows) == 1:  # Without a copy.
        return windows[0]
    names = [field.name for field in dataclasses.fields(Windows)]
    return Windows(**{
        name: np.concatenate([getattr(x, name) for x in windows]) for name in names})


def moving_threshold(q: Array, period: float) -> Array:
    """
    Return the velocity above which each joint moves, shape (n,) [rad/s].

    It is six deviations of the velocity's noise, a part of the largest velocity, or the velocity
    of rounding, the largest of these.
    """
    # Joint by joint, for long series.
    fastest = np.array([np.percentile(np.abs(smooth(x, period, 1)), 99.0) for x in q.T])
    noise = velocity_deviation(period) * position_noise(q, period)
    return np.maximum(6.0 * noise, np.maximum(2e-3 * fastest, 1e-6))


def _terms(
        q: Array,
        period: float,
        model: Model,
        phi: TestFunction,
        regressor: BodyRegressor | None,
        centres: Indices,
        threshold: Array) -> dict[str, Array]:
    """Return the fields of `Windows` around successive centres."""
    first = int(centres[0]) - phi.half
    last = int(centres[-1]) + phi.half + 1
    # A smoothed sample depends on these around it.
    margin = 2 * smoothing_half(period)
    start = max(first - margin, 0)
    wide = q[start:last + margin]
    inside = slice(first - start, last - start)
    position, velocity, acceleration = (smooth(wide, period, order)[inside] for order in range(3))
    difference = np.gradient(wide, period, axis=0)[inside]
    centres = centres - first
    dynamics = Dynamics.along(position, velocity, period, model)
    direction = np.where(np.abs(velocity) > threshold, np.sign(velocity), 0.0)

    def mean(values: Array) -> Array:
        return phi.sums(values, phi.values, centres)

    bodies = np.empty((len(centres), q.shape[1], 0))
    if regressor is not None:
        bodies = regressor.weak(position, velocity, difference, phi, centres)
    slow = [mean(direction * np.exp(-np.square(velocity / v))) for v in STRIBECK_VELOCITIES]
    return {
        'model_torque': dynamics.weak(difference, phi, centres),
        'weight': mean(dynamics.weight()),
        'bodies': bodies,
        'direction': mean(direction),
        'resting': mean(1.0 - np.abs(direction)),
        'velocity': mean(difference),
        'acceleration': -phi.sums(difference, phi.slope, centres),
        'stribeck': np.stack(slow, axis=2),
        'load': mean(direction * np.abs(dynamics.torque(acceleration)))}
