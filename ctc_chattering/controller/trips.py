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
What ends the torques until a reset: an error that is large or grows, a loop that oscillates.

A law that observes the perturbation removes an error, whatever the robot started with. Where the
error of a joint i grows all the same, the loop is lost: by drives that are slower or later than
told, or a perturbation beyond Ka. In the sample k, of samples j since the torques began::

    g_i(k) = |e_i(k)| - min |e_i(j)| <= 1 rad                                             (TR1)

So a start far from the reference is allowed, and its overshoot. The price: a reference that jumps
by more counts as a loss, and an error that stays within 1 rad does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

from ctc_chattering.control.controller import Controller, Sample
from ctc_chattering.controller.state_machine import Input
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS

#: Largest growth of an error of (TR1) [rad].
LARGEST_GROWTH = 1.0


def joint_beyond(e: Vector, limit: Vector) -> int | None:
    """
    Return the first joint whose error is beyond its limit; None if all are within.

    Parameters
    ----------
    e : sequence of float, shape (n,)
        Position error [rad]; NaN is beyond any limit.
    limit : sequence of float, shape (n,)
        Largest magnitude allowed [rad].

    """
    for i, (x, most) in enumerate(zip(e, limit)):
        if not -most <= x <= most:
            return i
    return None


class ErrorGrowth:
    """Remembers the least error of each joint, for n joints; see (TR1)."""

    def __init__(self, n: int) -> None:
        self._least = [inf] * n

    def restart(self) -> None:
        """Forget the errors so far."""
        self._least = [inf] * len(self._least)

    def largest(self, e: Vector) -> tuple[float, int]:
        """Return the largest g_i [rad] with the error e, shape (n,) [rad], and the joint i."""
        size = [abs(x) for x in e]
        self._least = least = [min(a, b) for a, b in zip(size, self._least)]
        return max((a - b, i) for i, (a, b) in enumerate(zip(size, least)))


#: How long a loop may seem out of control [s], and how often that is read [ns].
_PATIENCE, _INTERVAL = 0.2, NANOSECONDS // 50
#: Part of the bandwidth below which it is worth a word.
_WORTH_A_WORD = 0.7
#: Part of ka at which an estimate is at its bound.
_AT_BOUND = 0.99
#: The law whose errors must not grow, where `error_limit` is not set.
_WATCHED = 'observer_feedback'


def _cause(law: Controller, sample: Sample, joint: int) -> str:
    """Return what is wrong where the error of a joint grows, or the feedback oscillates."""
    config, ka = law.config, law.config.ka[joint]
    if law.stability[0] > _WORTH_A_WORD and abs(sample.robust[joint]) >= _AT_BOUND * ka:
        return f'ka is too small for friction, load and error of the model: {ka:g} N*m'
    return ('the drives may be slower than the law is told (torque_rate_limit '
            f'{list(config.torque_rate_limit)} N*m/s), or later (actuator_lag '
            f'{list(config.actuator_lag)} s, input_delay {config.input_delay} samples): measure '
            'and set them')


class Trip(NamedTuple):
    """Why no torque is sent until a reset."""

    event: Input
    #: For the status, and for the log.
    reason: str
    detail: str


class TripMonitor:
    """
    Watches the error, and the bandwidth that a law leaves itself.

    Parameters
    ----------
    names : sequence of str
        The joints.
    period : int
        Control period [ns].

    """

    def __init__(self, names: Sequence[str], period: int) -> None:
        self._names = names
        self._interval = max(_INTERVAL // period, 1)
        self._samples = 0
        self._lowest = 1.0
        #: Of (TR1), under which law, and the largest since the last warning, with its joint.
        self._growth, self._law = ErrorGrowth(len(names)), ''
        self._grown, self._why = (0.0, 0), ''

    def restart(self) -> None:
        """Begin again with the torques."""
        self._growth.restart()
        self._grown = 0.0, 0

    def check(self, law: Controller, sample: Sample) -> Trip | None:
        """Return why the torque of a sample must not be sent; None if it may be."""
        joint = joint_beyond(sample.e, law.config.error_limit)
        if joint is not None:
            return Trip(
                Input.ERROR_LIMIT,
                f'the position error of {self._names[joint]} exceeded error_limit',
                f'the position errors {[float(f"{x:.4g}") for x in sample.e]} rad exceed '
                'error_limit')
        if (found := self._lost(law, sample)) is not None:
            return found
        self._samples += 1
        if self._samples % self._interval:
            return None
        part, duration = law.stability
        self._lowest = min(self._lowest, part)
        if duration < _PATIENCE:
            return None
        text = f'the feedback of {law.config.law} oscillated'
        return Trip(Input.OSCILLATION, text, f'{text} at {100.0 * part:.0f} % of its bandwidth; '
                    f'{_cause(law, sample, 0)}')

    def _lost(self, law: Controller, sample: Sample) -> Trip | None:
        """Return a trip where an error has grown too much, by (TR1)."""
        config, e = law.config, sample.e
        if config.law != self._law:
            self._law = config.law
            self.restart()
        if config.law != _WATCHED or min(config.error_limit) < inf:
            return None
        self._grown = max(self._grown, self._growth.largest(e))
        grown, joint = self._grown
        if grown >= 0.5 * LARGEST_GROWTH:
            self._why = _cause(law, sample, joint)
        if grown <= LARGEST_GROWTH:
            return None
        text = f'the position error of {self._names[joint]} has grown by {grown:.2f} rad'
        return Trip(Input.ERROR_LIMIT, text, (
            f'{text}, to {abs(e[joint]):.2f} rad, and exceeded the limit of '
            f'{LARGEST_GROWTH:g} rad (set error_limit to change it); {self._why}'))

    def warnings(self) -> list[tuple[int, str]]:
        """Return level and text of what was seen since the last call."""
        (lowest, self._lowest), (grown, self._grown) = (self._lowest, 1.0), (self._grown, (0.0, 0))
        found = []
        if lowest <= _WORTH_A_WORD:
            found.append('the feedback oscillates; the law is down to '
                         f'{100.0 * lowest:.0f} % of its bandwidth. Are the drives slower than '
                         'torque_rate_limit, or later than actuator_lag and input_delay say?')
        if grown[0] >= 0.5 * LARGEST_GROWTH:
            found.append(f'the position error of {self._names[grown[1]]} has grown by '
                         f'{grown[0]:.2f} rad; beyond {LARGEST_GROWTH:g} rad no torque is sent; '
                         f'{self._why}')
        return [(1, x) for x in found]
