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
Motions that excite all joints of a robot, for the identification of friction and model errors.

The motion leads from where the robot stands to a few poses, at each of which every joint reverses
slowly, once each way; then every joint follows a Fourier series. It begins and ends at rest. All
motions of the same times are combinations of a few *shapes*: with z of one row for each shape and
one column for each joint, q = center + shapes z, and likewise velocity and acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from math import ceil, pi, sqrt
from typing import Any, NamedTuple

from ctc_chattering.errors import ParameterError
from ctc_chattering.identification.excitation.fourier_series import at_rest, FourierSeries
from ctc_chattering.identification.excitation.limits import Bounds, ExcitationConfig
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.polynomials import quintic
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.trajectory.waypoints import Route
import numpy as np

#: What a scaled motion keeps of its limits, so that rounding and the polynomials between two
#: waypoints do not exceed them.
_SCALE = 0.99
#: Greatest distance of a pose from the centre as a part of the room; the reversals take the rest.
_POSES = 0.6
#: Part of the time for the reversals; least time of those at one pose and of the Fourier motion;
#: of the way to the first pose and of those after it, and the rest at the end [s].
_SLOW_PART, _SLOW_LEAST, _FOURIER_LEAST = 0.45, 4.0, 10.0
_FIRST_LEAST, _WAY_LEAST, _REST = 2.0, 1.0, 0.5
#: Greatest frequency of the Fourier motion [Hz], and waypoints in the period of the fastest part.
_FREQUENCY, _WAYPOINTS = 0.5, 12
#: Longest period of the series [s]; longer motions repeat it.
_PERIOD = 45.0
#: w(x) = (sin x - sin(2 x) / 2) / _PEAK has extremes of ±1, slope 0 and curvature 0 at 0 and 2π;
#: the greatest values of |w'| and |w''|.
_PEAK = 0.75 * sqrt(3.0)
_SLOPE, _CURVATURE = 2.0 / _PEAK, 2.7359 / _PEAK
#: Greatest velocity and acceleration of the quintic from 0 to 1 in 1 s, at rest at its ends.
_QUINTIC_VELOCITY, _QUINTIC_ACCELERATION = 1.875, 10.0 / sqrt(3.0)


class Quintics(NamedTuple):
    """
    Waypoints joined by quintics.

    Attributes
    ----------
    times : ndarray of int, shape (W,)
        Of the waypoints [ns]; the first is 0.
    points : ndarray, shape (3, W, m)
        Position, velocity and acceleration at each.

    """

    times: Any
    points: Array

    def at(self, t: Array) -> Array:
        """Return position, velocity and acceleration, (3, N, m), at the times `t`, (N,) [s]."""
        knots = self.times / NANOSECONDS
        i = np.clip(np.searchsorted(knots, t, 'right') - 1, 0, len(knots) - 2)
        h: Any = np.diff(knots)[i][:, np.newaxis]
        s = (t[:, np.newaxis] - knots[i][:, np.newaxis]) / h
        rows: Any = (*self.points[:, i], *self.points[:, i + 1])
        return np.array(quintic(s, h, *rows))


@dataclasses.dataclass(frozen=True)
class Excitation:
    """
    A motion.

    Attributes
    ----------
    names : tuple of str, length n
        Joints.
    path : Quintics
        Its waypoints, and where it begins.
    slow : tuple of (float, float)
        Time at which the reversals at each pose begin and end [s].
    fourier : (float, float)
        Time at which the Fourier motion begins and ends [s].

    """

    names: tuple[str, ...]
    path: Quintics
    slow: tuple[tuple[float, float], ...]
    fourier: tuple[float, float]

    @property
    def route(self) -> Route:
        """Return the waypoints, without the start."""
        points = self.path.points[:, 1:].transpose(1, 0, 2).tolist()
        return Route(self.names, self.path.times[1:].tolist(), [tuple(x) for x in points])


class Shapes:
    """
    All motions with the times that these bounds take.

    Parameters
    ----------
    config : ExcitationConfig
        Duration, start and number of poses.
    bounds : Bounds
        What the motions keep.

    Attributes
    ----------
    path : Quintics
        One column for each shape: the way from the start; slow reversals at each pose; each
        pose; each series. The coefficients are, in this order, the distance of the start from
        the centre, amplitudes, poses less the centre [rad], and factors of the series.
    slow : tuple of (float, float)
        As of `Excitation`.
    fourier : (float, float)
        As of `Excitation`.

    Raises
    ------
    ParameterError
        If the duration is too short.

    """

    def __init__(self, config: ExcitationConfig, bounds: Bounds) -> None:
        first, between, last, slow, fourier = _times(config, bounds)
        self._config, self._bounds, self._count = config, bounds, config.poses
        cycles = ceil(fourier / _PERIOD)
        period = fourier / cycles
        self._series = at_rest(max(3, int(_FREQUENCY * period)), period)
        shapes = 1 + 2 * self._count + len(self._series.cosines)
        unit = np.eye(shapes)
        way = PathBuilder(unit[0])
        spans: list[tuple[float, float]] = []
        for turn, pose in zip(unit[1:], unit[1 + self._count:1 + 2 * self._count]):
            way.rest(pose, between if spans else first)
            begin = way.time
            way.reversals(pose, turn, slow)
            spans.append((begin, way.time))
        way.rest(0.0 * unit[0], last)
        begin = way.time
        for _ in range(cycles):
            way.series(self._series)
        self.slow, self.fourier = tuple(spans), (begin, way.time)
        way.rest(0.0 * unit[0], config.duration - way.time)
        self.path = way.path()

    @property
    def series(self) -> slice:
        """Return the rows of z that are factors of the series."""
        return slice(1 + 2 * self._count, None)

    @property
    def free(self) -> slice:
        """Return the rows of z that may be chosen: poses and factors."""
        return slice(1 + self._count, None)

    def random(self, rng: np.random.Generator) -> Array:
        """Return coefficients z, (shapes, n), of random poses, directions and series."""
        bounds, count, n = self._bounds, self._count, len(self._bounds.center)
        strata = rng.permuted(np.tile(np.arange(count), (n, 1)), axis=1).T
        offsets = 2.0 * (strata + rng.uniform(size=strata.shape)) / count - 1.0
        direction = rng.choice((-1.0, 1.0), offsets.shape)
        factors = rng.standard_normal((len(self._series.cosines), n))
        return self.fitted(np.vstack((
            self._config.start - bounds.center, direction * bounds.slow,
            _POSES * bounds.room * offsets, factors)))

    def fitted(self, z: Array) -> Array:
        """Return z with the largest multiple of each joint's series that keeps the bounds."""
        bounds, period = self._bounds, self._series.period
        count = 40 * self._series.cosines.shape[1]
        rows = np.array(self._series.at(np.linspace(0.0, period, count + 1)))
        most = np.abs(rows @ z[self.series]).max(axis=1)
        room = np.array([bounds.room, bounds.velocity, bounds.acceleration])
        made: Array = z.copy()
        made[self.series] *= _SCALE * (room / np.maximum(most, 1e-300)).min(axis=0)
        return made

    def motion(self, z: Array) -> Excitation:
        """Return the motion of coefficients z, shape (shapes, n)."""
        points = self.path.points @ z
        points[0] += self._bounds.center
        return Excitation(self._config.joint_names, Quintics(self.path.times, points), self.slow,
                          self.fourier)


def _times(config: ExcitationConfig, bounds: Bounds) -> tuple[float, float, float, float, float]:
    """Return the times to, between and from the poses, at each of them, and of the series [s]."""
    reach = _POSES * bounds.room
    first, between, last = (_way_time(distance, bounds) for distance in (
        np.abs(config.start - bounds.center) + reach, 2.0 * reach, reach))
    count, first = config.poses, max(first, _FIRST_LEAST)
    fixed = first + (count - 1) * between + last + _REST
    left = config.duration - fixed
    least = max(count * _slow_time(bounds) / _SLOW_PART, _FOURIER_LEAST / (1.0 - _SLOW_PART))
    if left < least:
        raise ParameterError('duration', config.duration, f'at least {ceil(fixed + least)} s, for '
                             f'{count} poses within these limits')
    return first, between, last, _SLOW_PART * left / count, (1.0 - _SLOW_PART) * left


def _way_time(distance: Array, bounds: Bounds) -> float:
    """Return the time that a quintic over a distance, shape (n,) [rad], takes [s]."""
    d = np.abs(distance) / _SCALE
    return float(max(_WAY_LEAST, (_QUINTIC_VELOCITY * d / bounds.velocity).max(),
                     np.sqrt(_QUINTIC_ACCELERATION * d / bounds.acceleration).max()))


def _slow_time(bounds: Bounds) -> float:
    """Return the least time for the reversals at a pose [s]."""
    d = bounds.slow / _SCALE
    return float(max(_SLOW_LEAST, 2.0 * pi * max(
        (_SLOPE * d / bounds.velocity).max(),
        np.sqrt(_CURVATURE * d / bounds.acceleration).max())))


class PathBuilder:
    """
    Waypoints that are added one after the other.

    Parameters
    ----------
    start : ndarray, shape (m,)
        Where it begins, at rest.

    Attributes
    ----------
    time : float
        Of the last one [s].

    """

    def __init__(self, start: Array) -> None:
        self.time = 0.0
        self._times = [0]
        self._points: list[Sequence[Array]] = [(start, 0.0 * start, 0.0 * start)]

    def path(self) -> Quintics:
        """Return the waypoints."""
        return Quintics(np.array(self._times), np.array(self._points).transpose(1, 0, 2))

    def rest(self, q: Array, duration: float) -> None:
        """Go to `q`, shape (m,), and be at rest there after `duration` [s]."""
        self._add(duration, q, 0.0 * q, 0.0 * q)

    def reversals(self, pose: Array, amplitude: Array, duration: float) -> None:
        """Go from a pose, shape (m,), by `amplitude` one way, then the other, and back."""
        rate, count = 2.0 * pi / duration, 2 * _WAYPOINTS
        begin = self.time
        for k in range(1, count + 1):
            x = 2.0 * pi * k / count if k < count else 0.0
            w, dw, ddw = (np.sin(x) - 0.5 * np.sin(2.0 * x), np.cos(x) - np.cos(2.0 * x),
                          2.0 * np.sin(2.0 * x) - np.sin(x))
            a = amplitude / _PEAK
            self._add(begin + duration * k / count - self.time,
                      pose + a * w, a * rate * dw, a * rate * rate * ddw)

    def series(self, series: FourierSeries) -> None:
        """Follow series in the last columns, from where the motion rests."""
        count = _WAYPOINTS * series.cosines.shape[1]
        shares = np.arange(1, count + 1) / count
        begin, place = self.time, self._points[-1][0]
        for share, *rows in zip(shares, *series.at(series.period * shares)):
            if share == 1.0:  # Without the rounding of 2π.
                rows = [0.0 * row for row in rows]
            wide = [np.concatenate((np.zeros(len(place) - len(row)), row)) for row in rows]
            self._add(begin + series.period * float(share) - self.time, place + wide[0], *wide[1:])

    def _add(self, duration: float, *point: Array) -> None:
        self.time += duration
        self._times.append(round(self.time * NANOSECONDS))
        self._points.append(point)
