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
Repeated motions and their names.

`Learner` follows a `RepeatedMotion`: the periodic profile of a reference, or waypoints that may be
sent again.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from fractions import Fraction
from hashlib import sha256
from math import cos, gcd, lcm, sin

from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.trajectory.reference import ReferenceConfig
from ctc_chattering.trajectory.transitions import TimedMotion, Transition
from ctc_chattering.trajectory.waypoints import Route
import numpy as np

#: Longest common period of the joints [s].
_MAX_PERIOD_S = 60
#: Largest denominator of a frequency in Hz.
_MAX_DENOMINATOR = 1000
#: Number of positions in a pass at which M̂ is evaluated.
_POSITIONS = 5


@dataclasses.dataclass(frozen=True)
class RepeatedMotion:
    """
    A motion that is repeated.

    Attributes
    ----------
    name : str
        Digest that identifies it.
    motion : TimedMotion
        The desired motion over path time, without a correction.
    begin : int
        Path time at which the phase is 0 [ns]. For waypoints that is their begin.
    duration : int
        Duration of a pass [ns].
    is_periodic : bool
        Whether the next pass follows at once.
    start : int
        Path time from which the motion repeats, the end of a smooth start [ns].

    """

    name: str
    motion: TimedMotion
    begin: int
    duration: int
    is_periodic: bool
    start: int

    def phase(self, t: int) -> int:
        """Return the time within the pass at path time `t` [ns]."""
        elapsed = t - self.begin
        if self.is_periodic:
            return elapsed % self.duration
        return min(max(elapsed, 0), self.duration)

    def positions(self) -> list[Sequence[float]]:
        """Return positions along it, each of shape (n,) [rad]."""
        instants = np.linspace(0, self.duration, _POSITIONS).astype(int)
        return [self.motion.at(self.begin + t)[0] for t in instants.tolist()]


def motion_of(config: ReferenceConfig, route: Route | None, motion: TimedMotion
              ) -> RepeatedMotion:
    """
    Return a reference's motion as a repeated one.

    Parameters
    ----------
    config : ReferenceConfig
        Parameters of the profile, if there is no route.
    route : Route or None
        Waypoints that are followed in place of the profile, with path times [ns].
    motion : TimedMotion
        The motion over path time, of which a smooth start may be part.

    Raises
    ------
    CtcError
        If no joint moves, or the joints have no common period.

    """
    if route is not None:
        return waypoint_motion(route, motion, 0)
    start = motion.end if isinstance(motion, Transition) else 0
    profile = config.profile, config.center, config.amplitude, config.frequency, config.phase
    return RepeatedMotion(_name(profile), motion, 0, _period(config), True, start)


def waypoint_motion(route: Route, motion: TimedMotion, begin: int, start: Sequence[float] = ()
                    ) -> RepeatedMotion:
    """
    Return waypoints as a motion that may recur.

    Parameters
    ----------
    route : Route
        Waypoints, with path times [ns].
    motion : TimedMotion
        The motion through them.
    begin : int
        Path time from which they count [ns].
    start : sequence of float, shape (n,), optional
        Position there, which tells the way to the first of them from others [rad].

    """
    # The same on every turn, and to a hundredth.
    direction = [round(f(x), 2) + 0.0 for x in start for f in (cos, sin)]
    points = [[list(row) for row in point] for point in route.points]
    times = [t - begin for t in route.times]
    name = _name((list(route.names), times, points, direction))
    return RepeatedMotion(name, motion, begin, times[-1], False, begin)


def moving_frequencies(config: ReferenceConfig) -> list[float]:
    """Return frequencies of joints that the profile moves [Hz]."""
    return [f for f, size in zip(config.frequency, config.amplitude) if f and size]


def _period(config: ReferenceConfig) -> int:
    """Return the common period [ns], or raise `CtcError`."""
    moving = moving_frequencies(config)
    if not moving:
        raise CtcError('learning: no joint moves')
    rates = [Fraction(f).limit_denominator(_MAX_DENOMINATOR) for f in moving]
    rate = Fraction(gcd(*(x.numerator for x in rates)), lcm(*(x.denominator for x in rates)))
    # A move of a trapezoid takes 2 / f, and the way back as long.
    period = (4 if config.profile == 'trapezoid' else 1) / rate
    is_exact = all(abs(f - x) < 1e-9 for f, x in zip(moving, rates))
    if not is_exact or period > _MAX_PERIOD_S:
        raise CtcError(f'learning: the frequencies {moving} Hz have no common period of up to '
                       f'{_MAX_PERIOD_S} s; round them, for example to multiples of 0.05 Hz')
    return round(period * NANOSECONDS)


def _name(shape: object) -> str:
    """Return a digest that identifies a motion."""
    return sha256(repr(shape).encode()).hexdigest()
