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
    smoothed,
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

    """

    t: Array
    centres: Indices
    way: Array
    base: Array
    more: Array
    velocity: Array
    stribeck: Array
    gravity: Array
    load: Array

    @classmethod
    def of(cls, stretch: Stretch, model: Model, phi: TestFunction,
           errors: ErrorColumns | None = None) -> Rows:
        """Return the rows of a stretch, for the model that is to be corrected."""
        h, q, n = stretch.period, stretch.q, stretch.q.shape[1]
        margin = max(smoothing_half(h), round(SETTLING / h)) + 1
        centres, least = phi.centres(len(q), margin), least_velocity(q, h)
        sides = [_sides(q, h, model, phi, errors, some, least)
                 for some in phi.blocks(centres) if len(some)]
        way, base, weight, load, velocity, stribeck, more = map(
            np.concatenate, zip(*sides)) if sides else (
            np.empty((0, *shape)) for shape in (*[(n,)] * 5, (n, len(STRIBECK)), (n, 0)))
        return cls(stretch.t[centres], centres, way, base, more, velocity, stribeck, weight, load)

    def cut(self, use: npt.NDArray[np.bool_], first: int) -> Rows:
        """Return some windows of a stretch from which the samples before `first` are cut off."""
        mine = {field.name: getattr(self, field.name)[use] for field in dataclasses.fields(self)}
        return Rows(**{**mine, 'centres': mine['centres'] - first})


def _sides(q: Array, period: float, model: Model, phi: TestFunction, errors: ErrorColumns | None,
           centres: Indices, least: Array) -> tuple[Array, ...]:
    """
    Return what `Rows` have of windows that follow each other, of positions q, shape (N, n).

    That is the direction, the model's left side, its weight and load, the velocity, the Stribeck
    columns, and those of the model's errors.
    """
    first, last = int(centres[0]) - phi.half, int(centres[-1]) + phi.half + 1
    # What a sample of the directions depends on.
    around = 2 * smoothing_half(period)
    begin = max(first - around, 0)
    wide = q[begin:last + around]
    place, dq, ddq = smoothed(wide, period)
    moved = np.empty_like(wide)
    moved[1:-1] = (wide[2:] - wide[:-2]) / (2.0 * period)
    moved[0], moved[-1] = dq[0], dq[-1]
    place, dq, ddq, moved, slide = (x[first - begin:last - begin] for x in (
        place, dq, ddq, moved, sliding(dq, least, period)))
    at = centres - first
    dynamics = Dynamics.along(place, dq, period, model)
    more = errors.weak(place, dq, moved, phi, at) if errors else np.empty(
        (len(centres), place.shape[1], 0))
    windows = sliding_window_view(slide, 2 * phi.half + 1, axis=0)[at - phi.half]
    low = windows.min(axis=-1)
    columns = [phi.sums(np.sign(dq) * np.exp(-np.square(dq / v)), phi.at, at) for v in STRIBECK]
    return (np.where(low == windows.max(axis=-1), low, 0.0), dynamics.weak(moved, phi, at),
            dynamics.weight(phi, at), dynamics.load(ddq, phi, at), phi.sums(moved, phi.at, at),
            np.stack(columns, axis=2), more)


def least_velocity(q: Array, period: float) -> Array:
    """Return from which velocity on each joint slides, shape (n,) [rad/s]."""
    # Joint by joint, for long series.
    fast = [np.percentile(np.abs(smooth(x, period, 1)), 99.0) for x in q.T]
    return np.maximum(_DEVIATIONS * velocity_deviation(period) * position_noise(q, period),
                      np.maximum(_PART * np.array(fast), _LEAST))


def sliding(dq: Array, least: Array, period: float) -> Array:
    """
    Return which way each joint slides at each sample: 1, -1, or 0 for not at all, shape (N, n).

    Samples whose smoothed velocity contains some of a stop count as not sliding.

    Parameters
    ----------
    dq : ndarray, shape (N, n)
        Smoothed velocity [rad/s].
    least : ndarray, shape (n,)
        By `least_velocity` [rad/s].
    period : float
        [s].

    """
    way = np.where(np.abs(dq) > least, np.sign(dq), 0.0)
    size = 2 * smoothing_half(period) + 1
    low, high = (extreme(way, size, axis=0, mode='nearest')
                 for extreme in (minimum_filter1d, maximum_filter1d))
    return np.where(low == high, way, 0.0)


#: Ways after a reversal in which a torque may build up [rad].
BUILD_UP = (3e-4, 1e-3, 3e-3, 1e-2)


@dataclasses.dataclass(frozen=True)
class WindowStates:
    """
    Motion of all windows of all stretches; J windows, n joints.

    Attributes
    ----------
    position : ndarray, shape (J, n)
        Mean position [rad].
    acceleration : ndarray, shape (J, n)
        Mean acceleration [rad/s²], by differences of positions and parts.
    build_up : ndarray, shape (J, n, len(BUILD_UP))
        Mean of sgn(dq) exp(-x / d) for these d, x the way since the direction changed.

    """

    position: Array
    acceleration: Array
    build_up: Array

    @classmethod
    def of(cls, parts: Sequence[Stretch], rows: Sequence[Rows], phi: TestFunction
           ) -> WindowStates:
        """Return the motion in the windows of stretches."""
        found = [cls._of(part, row, phi) for part, row in zip(parts, rows)]
        return cls(*(np.concatenate(x) for x in zip(*found)))

    @staticmethod
    def _of(part: Stretch, rows: Rows, phi: TestFunction) -> tuple[Array, Array, Array]:
        found = []
        # Joint by joint, for long series.
        for i, least in enumerate(least_velocity(part.q, part.period)):
            q = part.q[:, i:i + 1]
            bend = -phi.sums(np.gradient(q, part.period, axis=0), phi.slope, rows.centres)
            place, dq = (smooth(q, part.period, order) for order in range(2))
            position = phi.sums(place, phi.at, rows.centres)
            ways = way_since_reversal(place, sliding(dq, least, part.period))
            build_up = [phi.sums(np.sign(dq) * np.exp(-ways / d), phi.at, rows.centres)
                        for d in BUILD_UP]
            found.append((position, bend, np.stack(build_up, axis=2)))
        position, acceleration, turned = (np.concatenate(x, axis=1) for x in zip(*found))
        return position, acceleration, turned


def way_since_reversal(q: Array, slide: Array) -> Array:
    """
    Return how far each joint has come since its direction changed; inf before, shape (N, n) [rad].

    Parameters
    ----------
    q : ndarray, shape (N, n)
        Positions [rad].
    slide : ndarray, shape (N, n)
        Direction, 0 at rest; a rest between the same directions is no reversal.

    """
    found = np.empty_like(q)
    for i, (x, way) in enumerate(zip(q.T, slide.T)):
        moving = np.flatnonzero(way)
        turns = np.flatnonzero(np.diff(way[moving])) if len(moving) else moving
        # The last sample of one direction is where the next one begins.
        ends = moving[turns]
        counts = np.diff(np.concatenate(([0], ends + 1, [len(x)])))
        found[:, i] = np.abs(x - np.repeat(np.append(np.inf, x[ends]), counts))
    return found
