"""The rows of the regression: one for each window of time and joint that slides one way."""

from __future__ import annotations

import dataclasses

from ctc_chattering.analysis.recording import Stretch
from ctc_chattering.analysis.time_stamps import Indices
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.regression.error_columns import ErrorColumns
from ctc_chattering.identification.regression.weak_form import (
    blocks,
    Dynamics,
    position_noise,
    smoothed,
    smoothing_half,
    TestFunction,
    velocity_deviation,
)
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
import numpy.typing as npt

#: Velocities for which a column of Stribeck friction is prepared [rad/s].
STRIBECK = tuple(0.005 * 10.0 ** (0.0625 * k) for k in range(29))
#: A joint slides where its velocity exceeds this many deviations, and this part of its largest.
_DEVIATIONS, _PART = 6.0, 2e-3
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
        h, q = stretch.period, stretch.q
        place, dq, ddq = smoothed(q, h)
        moved = np.empty_like(q)
        moved[1:-1], moved[0], moved[-1] = (q[2:] - q[:-2]) / (2.0 * h), dq[0], dq[-1]
        margin = max(smoothing_half(h), round(SETTLING / h)) + 1
        centres = phi.centres(len(q), margin)
        slide = sliding(q, dq, h)
        low, high = _extremes(slide, phi, centres)
        way = np.where(low == high, low, 0.0)
        motion, n = (place, dq, ddq, moved), q.shape[1]
        sides = [_sides(motion, model, phi, errors, some) for some in blocks(centres) if len(some)]
        base, weight, load, stribeck, more = map(np.concatenate, zip(*sides)) if sides else (
            np.empty((0, *shape)) for shape in (*[(n,)] * 3, (n, len(STRIBECK)), (n, 0)))
        return cls(stretch.t[centres], centres, way, base, more,
                   phi.sums(moved, phi.at, centres), stribeck, weight, load)

    def cut(self, use: npt.NDArray[np.bool_], first: int) -> Rows:
        """Return some windows of a stretch from which the samples before `first` are cut off."""
        mine = {field.name: getattr(self, field.name)[use] for field in dataclasses.fields(self)}
        return Rows(**{**mine, 'centres': mine['centres'] - first})


def _sides(motion: tuple[Array, Array, Array, Array], model: Model, phi: TestFunction,
           errors: ErrorColumns | None, centres: Indices) -> tuple[Array, ...]:
    """Return the model's left side, weight and load, Stribeck columns, and those of its errors."""
    place, dq, ddq, moved = motion
    part = slice(int(centres[0]) - phi.half, int(centres[-1]) + phi.half + 1)
    at = centres - part.start
    dynamics = Dynamics.along(place[part], dq[part], phi.period, model)
    more = errors.weak(place, dq, moved, phi, part.start, centres) if errors else np.empty(
        (len(centres), place.shape[1], 0))
    dq = dq[part]
    columns = [phi.sums(np.sign(dq) * np.exp(-np.square(dq / v)), phi.at, at) for v in STRIBECK]
    return (dynamics.weak(moved[part], phi, at), dynamics.weight(phi, at),
            dynamics.load(ddq[part], phi, at), np.stack(columns, axis=2), more)


def _extremes(x: Array, phi: TestFunction, centres: Indices) -> Array:
    """Return the least and the greatest x in each window, shape (2, J, n)."""
    windows = sliding_window_view(x, 2 * phi.half + 1, axis=0)
    return np.stack([
        np.concatenate([extreme(windows[some - phi.half], axis=-1) for some in blocks(centres)])
        for extreme in (np.min, np.max)])


def sliding(q: Array, dq: Array, period: float) -> Array:
    """
    Return which way each joint slides at each sample: 1, -1, or 0 for not at all, shape (N, n).

    Samples whose smoothed velocity contains some of a stop count as not sliding.
    """
    least = np.maximum(_DEVIATIONS * velocity_deviation(period) * position_noise(q, period),
                       _PART * np.percentile(np.abs(dq), 99.0, axis=0))
    way = np.where(np.abs(dq) > least, np.sign(dq), 0.0)
    m = smoothing_half(period)
    around = sliding_window_view(np.pad(way, ((m, m), (0, 0)), 'edge'), 2 * m + 1, axis=0)
    found: Array = np.where(around.min(axis=-1) == around.max(axis=-1), way, 0.0)
    return found
