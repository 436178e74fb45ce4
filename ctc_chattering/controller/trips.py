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
What ends the torques until a reset, and settings of a law that are unsafe.

A law that observes the perturbation removes an error, whatever the robot started with. Where the
error of a joint i grows all the same, the loop is lost: by drives that are slower or later than
told, or a perturbation beyond Ka. In the sample k, of samples j since the torques began::

    g_i(k) = |e_i(k)| - min |e_i(j)| <= 1 rad                                             (TR1)

So a start far from the reference is allowed, and its overshoot. The price: a reference that jumps
by more counts as a loss, and an error that stays within 1 rad does not.

Settings show some conditions under which a law is worse than law `compensation`. `actuator_lag` T
and `torque_rate_limit` say what is known of the drives; no lag and no limit, as by default, are
taken for ideal drives.

- Switching ``implicit_observer``: the term rattles where ω T exceeds `LAG_RATIO` (measured).
- Law ``integral``: a joint with a lag has the poles of T s⁴ + s³ + Kv s² + Kp s + Ki, and is
  unstable for Ki >= Kp (Kv - T Kp) (Routh).
- Laws without a bound of what they estimate: drives with a limited rate that they do not know
  let the estimate grow, until the loop diverges (measured).

docs/safety.md has the measurements, and the conditions that settings do not show. A number that is
set while the controller runs changes by at most a factor of `FACTOR` at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import ceil, inf, log
from typing import Any, NamedTuple

from ctc_chattering.control.controller import Controller, Sample
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.parameters import matrix, Parameter
import numpy as np

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
    """Why no torque is sent until a reset, for the status and for the log."""

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
        #: Of (TR1): least errors, under which law, and the largest growth since the last warning,
        #: with its joint.
        self._law, self._why = '', ''
        self.restart()

    def restart(self) -> None:
        """Begin again with the torques."""
        self._least = [inf] * len(self._names)
        self._grown = 0.0, 0

    def check(self, law: Controller, sample: Sample) -> Trip | None:
        """Return why the torque of a sample must not be sent; None if it may be."""
        joint = joint_beyond(sample.e, law.config.error_limit)
        if joint is not None:
            return Trip(
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
        return Trip(text, f'{text} at {100.0 * part:.0f} % of its bandwidth; '
                    f'{_cause(law, sample, 0)}')

    def _lost(self, law: Controller, sample: Sample) -> Trip | None:
        """Return a trip where an error has grown too much, by (TR1)."""
        config, e = law.config, sample.e
        if config.law != self._law:
            self._law = config.law
            self.restart()
        if config.law != _WATCHED or min(config.error_limit) < inf:
            return None
        self._least = [min(abs(x), least) for x, least in zip(e, self._least)]
        self._grown = max(self._grown, *(
            (abs(x) - least, i) for i, (x, least) in enumerate(zip(e, self._least))))
        grown, joint = self._grown
        if grown >= 0.5 * LARGEST_GROWTH:
            self._why = _cause(law, sample, joint)
        if grown <= LARGEST_GROWTH:
            return None
        text = f'the position error of {self._names[joint]} has grown by {grown:.2f} rad'
        return Trip(text, (
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


#: Largest product of `observer_bandwidth` and the lag of the drives.
LAG_RATIO = 0.3
#: Largest factor by which a number changes at once.
FACTOR = 100.0
#: Laws without a bound of what they estimate.
UNBOUNDED = ('integral', 'momentum_observer', 'super_twisting')


def unsafe_settings(config: ControllerConfig) -> Iterator[str]:
    """Yield a line for each condition of this module that `config` meets."""
    if config.switching_in_force == 'implicit_observer':
        ratio = config.observer_bandwidth * max(config.known_lag)
        if ratio > LAG_RATIO:
            yield (f'observer_bandwidth times actuator_lag is {ratio:.2g}; the term rattles '
                   f'above {LAG_RATIO:g}')
    if config.law == 'integral':
        n, lag = len(config.joint_names), np.array(config.known_lag)
        kp, kv = (np.array(matrix(x, n)).diagonal() for x in (config.kp, config.kv))
        for name, ki, most in zip(config.joint_names, config.ki, kp * (kv - lag * kp)):
            if ki >= most:
                yield f'{name}: ki is {ki:g}; the loop is unstable from {max(most, 0.0):g} on'
    if config.law in UNBOUNDED and any(
            ours > drives for ours, drives in zip(
                config.effort_rate_limit, config.torque_rate_limit)):
        yield ('effort_rate_limit exceeds torque_rate_limit; where drives are slower than the '
               f'torque that is sent, the estimate of {config.law} grows')


def check_change(before: ControllerConfig, after: ControllerConfig) -> None:
    """Raise `ParameterError` if a number changes by more than `FACTOR` at once."""
    n = len(before.joint_names)
    for name, spec in ControllerConfig.parameters().items():
        first, *more = change_steps(spec, getattr(before, spec.field), getattr(after, spec.field),
                                    n)
        if more:
            shown = [float(f'{x:.3g}') for x in np.ravel(first)]
            raise ParameterError(name, getattr(after, spec.field), (
                f'a change by a factor of at most {FACTOR:g} at once; if you mean it, set '
                f'{shown if isinstance(first, tuple) else shown[0]} first'))


def change_steps(spec: Parameter, before: Any, after: Any, n: int) -> list[Any]:
    """
    Return the values by which a parameter changes from one to another.

    Who asks for a larger change than `FACTOR` confirms it by setting them all, one after another.

    Parameters
    ----------
    spec : Parameter
        Of `ControllerConfig`.
    before, after : object
        In force, and wanted.
    n : int
        Number of joints.

    Returns
    -------
    list
        `after`, and before it steps of at most `FACTOR` that lead there; from 0 a factor counts
        from the default, or from 1. What becomes 0, or is or becomes infinite, needs none.

    """
    if before == after or spec.read_only or spec.kind not in ('float', 'float[]'):
        return [after]
    full = spec.shape == 'nn' and len(after) != n
    old, new = (np.diagonal(matrix(x, n)) if spec.shape == 'nn' else np.atleast_1d(x)
                for x in (before, after))
    default = spec.default if 0.0 < spec.default < inf else 1.0
    with np.errstate(all='ignore'):
        last = np.log(np.abs(new))
        change = last - np.log(np.abs(np.where(old == 0.0, default, old)))
    change[~np.isfinite(change)] = 0.0
    count = max(1, ceil(np.abs(change).max() / log(1.01 * FACTOR)))
    diagonals = [np.exp(last - change * (1.0 - k / count)) for k in range(1, count)]
    steps = [matrix(after, n) * np.sqrt(np.outer(x / new, x / new)) if full else x
             for x in diagonals]
    return [tuple(map(float, x.ravel())) if isinstance(after, tuple) else float(x[0])
            for x in steps] + [after]


def missing_limits(config: ControllerConfig, of_model: Vector) -> str:
    """
    Return a line that names the joints without a limit, for a warning at the start; '' for none.

    Parameters
    ----------
    config : ControllerConfig
        As at the start.
    of_model : sequence of float, shape (n,)
        `Model.effort_limits`.

    """
    limits = {'effort_limit': config.largest_torque(of_model)}
    if config.takes('torque_rate_limit'):
        limits['torque_rate_limit'] = config.torque_rate_limit
    return '; '.join(
        f'{name} is infinite for {", ".join(joints)}' for name, values in limits.items()
        if (joints := [x for x, limit in zip(config.joint_names, values) if limit == inf]))
