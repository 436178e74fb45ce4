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

"""The windows of the regression, for each time and joint that slides one way, and their motion."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses

from ctc_chattering.bags.recording import Indices, Stretch
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.model_errors import ErrorColumns
from ctc_chattering.identification.weak_form import (
    Dynamics,
    position_noise,
    smooth,
    smoothing_half,
    TestFunction,
    velocity_deviation,
)
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
import numpy.typing as npt
from scipy.ndimage import maximum_filter1d, minimum_filter1d  # type: ignore[import-untyped]

#: Velocities for which a column of Stribeck friction is prepared [rad/s].
STRIBECK = tuple(0.005 * 10.0 ** (0.0625 * k) for k in range(29))
#: Ways after a reversal in which a torque may build up [rad].
BUILD_UP = (3e-4, 1e-3, 3e-3, 1e-2)
#: A joint slides where its velocity exceeds this many deviations, this part of its largest, and
#: this one, of which less is rounding [rad/s or m/s].
_DEVIATIONS, _PART, _LEAST = 6.0, 2e-3, 1e-6
#: Time before the first window, in which drives reach what was commanded before [s].
SETTLING = 0.1


@dataclasses.dataclass(frozen=True)
class Rows:
    """
    Windows of one stretch; J windows, n joints, m columns of errors of the model.

    Attributes
    ----------
    t : ndarray, shape (J,)
        Times of their centres [s].
    centres : ndarray, shape (J,)
        Samples of their centres.
    way : ndarray, shape (J, n)
        Direction in which a joint slides over the whole window: 1, -1, or 0 for neither.
    base : ndarray, shape (J, n)
        Weak left side of the model, without friction [N·m].
    more : ndarray, shape (J, n, m)
        Weak torque of each of these columns.
    velocity : ndarray, shape (J, n)
        Mean velocity [rad/s], by differences of positions.
    stribeck : ndarray, shape (J, n, len(STRIBECK))
        Mean of sgn(dq) exp(-(dq / v)²) for these v.
    gravity : ndarray, shape (J, n)
        The part of `base` that is weight [N·m].
    load : ndarray, shape (J, n)
        Mean magnitude of the model's torque without friction [N·m].
    position, acceleration : ndarray, shape (J, n)
        Mean position [rad], and acceleration by parts [rad/s²].
    build_up : ndarray, shape (J, n, len(BUILD_UP))
        Mean of sgn(dq) exp(-x / d) for these d, x the way since the direction changed.

    """

    t: Array
    centres: Indices
    way: Array
    base: Array
    gravity: Array
    load: Array
    velocity: Array
    position: Array
    acceleration: Array
    stribeck: Array
    build_up: Array
    more: Array

    @classmethod
    def of(cls, stretch: Stretch, model: Model, phi: TestFunction,
           errors: ErrorColumns | None = None) -> Rows:
        """Return the rows of a stretch, for the model that is to be corrected."""
        h, q, n = stretch.period, stretch.q, stretch.q.shape[1]
        margin = max(smoothing_half(h), round(SETTLING / h)) + 1
        centres, least = phi.centres(len(q), margin), least_velocity(q, h)
        # Joint by joint, for long series.
        turns = [reversals(smooth(x, h), sliding(smooth(x, h, 1), v, h))
                 for x, v in zip(q.T, least)]
        sides = [_sides(q, turns, h, model, phi, errors, some, least)
                 for some in phi.blocks(centres) if len(some)]
        shapes = (*[(n,)] * 7, (n, len(STRIBECK)), (n, len(BUILD_UP)), (n, 0))
        found = map(np.concatenate, zip(*sides)) if sides else (
            np.empty((0, *shape)) for shape in shapes)
        return cls(stretch.t[centres], centres, *found)

    def cut(self, use: npt.NDArray[np.bool_], first: int) -> Rows:
        """Return some windows of a stretch from which the samples before `first` are cut off."""
        mine = {field.name: getattr(self, field.name)[use] for field in dataclasses.fields(self)}
        return Rows(**{**mine, 'centres': mine['centres'] - first})


def joined(rows: Sequence[Rows]) -> Rows:
    """Return the windows of all stretches."""
    if len(rows) == 1:  # Without a copy.
        return rows[0]
    return Rows(**{field.name: np.concatenate([getattr(part, field.name) for part in rows])
                   for field in dataclasses.fields(Rows)})


def _sides(q: Array, turns: Sequence[Reversals], period: float, model: Model, phi: TestFunction,
           errors: ErrorColumns | None, centres: Indices, least: Array) -> tuple[Array, ...]:
    """
    Return what `Rows` have from `way` on, of windows that follow each other.

    Positions q have shape (N, n).
    """
    first, last = int(centres[0]) - phi.half, int(centres[-1]) + phi.half + 1
    # What a sample of the directions depends on.
    around = 2 * smoothing_half(period)
    begin = max(first - around, 0)
    wide = q[begin:last + around]
    place, dq, ddq = (smooth(wide, period, order) for order in range(3))
    moved = np.empty_like(wide)
    moved[1:-1] = (wide[2:] - wide[:-2]) / (2.0 * period)
    moved[0], moved[-1] = dq[0], dq[-1]
    place, dq, ddq, moved, slide = (x[first - begin:last - begin] for x in (
        place, dq, ddq, moved, sliding(dq, least, period)))
    at, way, samples = centres - first, np.sign(dq), np.arange(first, first + len(dq))
    since = np.stack([way_since_reversal(*x, samples) for x in zip(place.T, turns)], axis=1)
    dynamics = Dynamics.along(place, dq, period, model)
    more = errors.weak(place, dq, moved, phi, at) if errors else np.empty(
        (len(centres), place.shape[1], 0))
    windows = sliding_window_view(slide, 2 * phi.half + 1, axis=0)[at - phi.half]
    low = windows.min(axis=-1)
    slow, turned = (
        np.stack([phi.sums(way * np.exp(-x), phi.at, at) for x in parts], axis=2) for parts in (
            (np.square(dq / v) for v in STRIBECK), (since / d for d in BUILD_UP)))
    return (np.where(low == windows.max(axis=-1), low, 0.0), dynamics.weak(moved, phi, at),
            dynamics.weight(phi, at), dynamics.load(ddq, phi, at), phi.sums(moved, phi.at, at),
            phi.sums(place, phi.at, at), -phi.sums(moved, phi.slope, at), slow, turned, more)


def least_velocity(q: Array, period: float) -> Array:
    """Return from which velocity on each joint slides, shape (n,) [rad/s]."""
    # Joint by joint, for long series.
    fast = [np.percentile(np.abs(smooth(x, period, 1)), 99.0) for x in q.T]
    return np.maximum(_DEVIATIONS * velocity_deviation(period) * position_noise(q, period),
                      np.maximum(_PART * np.array(fast), _LEAST))


def sliding(dq: Array, least: Array, period: float) -> Array:
    """
    Return which way each joint slides at each sample: 1, -1, or 0 for not at all, shape (N, ...).

    Samples whose smoothed velocity dq [rad/s] contains some of a stop count as not sliding.
    """
    way = np.where(np.abs(dq) > least, np.sign(dq), 0.0)
    size = 2 * smoothing_half(period) + 1
    low, high = (extreme(way, size, axis=0, mode='nearest')
                 for extreme in (minimum_filter1d, maximum_filter1d))
    return np.where(low == high, way, 0.0)


#: Samples after which the direction of a joint changes, and its positions there [rad].
Reversals = tuple[Indices, Array]


def reversals(q: Array, slide: Array) -> Reversals:
    """
    Return where the direction of a joint changes.

    Parameters
    ----------
    q : ndarray, shape (N,)
        Positions [rad].
    slide : ndarray, shape (N,)
        Direction, 0 at rest; a rest between the same directions is no reversal.

    """
    moving = np.flatnonzero(slide)
    turns = np.flatnonzero(np.diff(slide[moving])) if len(moving) else moving
    # The last sample of one direction is where the next one begins.
    ends = moving[turns]
    return ends, q[ends]


def way_since_reversal(q: Array, turns: Reversals, samples: Indices) -> Array:
    """Return how far a joint at q has come since its last reversal; inf without one [rad]."""
    ends, places = turns
    return np.asarray(np.abs(q - np.append(np.inf, places)[np.searchsorted(ends, samples)]))
