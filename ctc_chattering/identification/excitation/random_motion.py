"""
Motions that excite all joints of a robot, for the identification of friction and model errors.

The motion leads from where the robot stands to a few poses, at each of which every joint reverses
slowly, once each way; then every joint follows a Fourier series. It begins and ends at rest and
keeps limits of position, velocity and acceleration.
"""

from __future__ import annotations

import dataclasses
from math import ceil, pi, sqrt

from ctc_chattering.errors import ParameterError
from ctc_chattering.identification.excitation.fourier_series import FourierSeries, random_series
from ctc_chattering.identification.excitation.limits import Bounds, ExcitationConfig
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.trajectory.buffer import Point
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
#: w(x) = (sin x - sin(2 x) / 2) / _PEAK has extremes of ±1, slope 0 and curvature 0 at 0 and 2π;
#: the greatest values of |w'| and |w''|.
_PEAK = 0.75 * sqrt(3.0)
_SLOPE, _CURVATURE = 2.0 / _PEAK, 2.7359 / _PEAK
#: Greatest velocity and acceleration of the quintic from 0 to 1 in 1 s, at rest at its ends.
_QUINTIC_VELOCITY, _QUINTIC_ACCELERATION = 1.875, 10.0 / sqrt(3.0)


@dataclasses.dataclass(frozen=True)
class Excitation:
    """
    A motion.

    Attributes
    ----------
    route : Route
        Its waypoints.
    slow : tuple of (float, float)
        Time at which the reversals at each pose begin and end [s].
    fourier : (float, float)
        Time at which the Fourier motion begins and ends [s].

    """

    route: Route
    slow: tuple[tuple[float, float], ...]
    fourier: tuple[float, float]


def random_excitation(config: ExcitationConfig, bounds: Bounds, rng: np.random.Generator
                      ) -> Excitation:
    """
    Return a motion with random poses, directions and coefficients; its times are not random.

    Parameters
    ----------
    config : ExcitationConfig
        Duration, start and number of poses.
    bounds : Bounds
        What it keeps.
    rng : Generator
        Source of what is random.

    Raises
    ------
    ParameterError
        If the duration is too short.

    """
    n = len(bounds.center)
    first, between, last, slow, fourier = _times(config, bounds)
    strata = rng.permuted(np.tile(np.arange(config.poses), (n, 1)), axis=1).T
    offsets = 2.0 * (strata + rng.uniform(size=strata.shape)) / config.poses - 1.0
    poses = bounds.center + _POSES * bounds.room * offsets
    direction = rng.choice((-1.0, 1.0), poses.shape)
    way = PathBuilder()
    spans: list[tuple[float, float]] = []
    for pose, sign in zip(poses, direction):
        way.rest(pose, between if spans else first)
        begin = way.time
        way.reversals(pose, sign * bounds.slow, slow)
        spans.append((begin, way.time))
    way.rest(bounds.center, last)
    begin = way.time
    way.series(bounds.center, _fitted(random_series(
        rng, n, max(3, int(_FREQUENCY * fourier)), fourier), bounds))
    end = way.time
    way.rest(bounds.center, config.duration - end)
    return Excitation(Route(config.joint_names, way.times, way.points), tuple(spans), (begin, end))


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


def _fitted(series: FourierSeries, bounds: Bounds) -> FourierSeries:
    """Return the largest multiple of each joint's series that keeps the bounds."""
    count = 40 * series.cosines.shape[1]
    most = [np.abs(x).max(axis=0)
            for x in series.at(np.linspace(0.0, series.period, count + 1))]
    room = np.array([bounds.room, bounds.velocity, bounds.acceleration])
    return series.scaled(_SCALE * (room / np.array(most)).min(axis=0))


class PathBuilder:
    """
    Waypoints that are added one after the other.

    Attributes
    ----------
    time : float
        Of the last one [s].
    times, points : list
        As `Route` takes them.

    """

    def __init__(self) -> None:
        self.time = 0.0
        self.times: list[int] = []
        self.points: list[Point] = []

    def rest(self, q: Array, duration: float) -> None:
        """Go to `q`, shape (n,), and be at rest there after `duration` [s]."""
        self._add(duration, q, 0.0 * q, 0.0 * q)

    def reversals(self, pose: Array, amplitude: Array, duration: float) -> None:
        """Go from a pose, shape (n,), by `amplitude` one way, then the other, and back."""
        rate, count = 2.0 * pi / duration, 2 * _WAYPOINTS
        begin = self.time
        for k in range(1, count + 1):
            x = 2.0 * pi * k / count if k < count else 0.0
            w, dw, ddw = (np.sin(x) - 0.5 * np.sin(2.0 * x), np.cos(x) - np.cos(2.0 * x),
                          2.0 * np.sin(2.0 * x) - np.sin(x))
            a = amplitude / _PEAK
            self._add(begin + duration * k / count - self.time,
                      pose + a * w, a * rate * dw, a * rate * rate * ddw)

    def series(self, center: Array, series: FourierSeries) -> None:
        """Follow a series about `center`, shape (n,)."""
        count = _WAYPOINTS * series.cosines.shape[1]
        shares = np.arange(1, count + 1) / count
        begin = self.time
        for share, *rows in zip(shares, *series.at(series.period * shares)):
            if share == 1.0:  # Without the rounding of 2π.
                rows = [0.0 * row for row in rows]
            self._add(begin + series.period * float(share) - self.time,
                      center + rows[0], rows[1], rows[2])

    def _add(self, duration: float, q: Array, dq: Array, ddq: Array) -> None:
        self.time += duration
        self.times.append(round(self.time * NANOSECONDS))
        self.points.append((q.tolist(), dq.tolist(), ddq.tolist()))
