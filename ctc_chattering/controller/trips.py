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
Trips that end the torques, and unsafe settings.

The control loop passes each sample to a `TripMonitor` before its torque is sent. A law that
observes the perturbation removes an error, whatever the robot started with. If the error of a
joint i grows all the same, the loop is lost: because the drives are slower, or their delay longer,
than configured, or because the perturbation exceeds Ka. In the sample k, of samples j since the
torques began::

    g_i(k) = |e_i(k)| - min |e_i(j)| <= 1 rad                                             (TR1)

So a start far from the reference is allowed, and its overshoot. The price: a reference that jumps
by more counts as a loss, and an error that stays within 1 rad does not.

Some settings make a law worse than law `compensation`. `actuator_lag` T and `torque_rate_limit`
describe the drives. By default they have no lag and no limit, and are ideal.

- Law ``integral``: a joint with a lag has the poles of T s⁴ + s³ + Kv s² + Kp s + Ki, and is
  unstable for Ki >= Kp (Kv - T Kp) (Routh).
- Laws whose estimate has no bound: it grows under drives with a limited rate that the law does
  not know, until the loop diverges (measured).

docs/safety.md has the measurements, and the conditions that settings do not show. A number that is
set while the controller runs changes by at most a factor of `MAX_CHANGE_FACTOR` at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf
from operator import gt, sub
from typing import Any, NamedTuple

from ctc_chattering.control.controller import Controller, Sample
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.base import Stability
from ctc_chattering.control.laws.registry import law_class
from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.parameters import matrix, Parameter
import numpy as np

#: Time for which a feedback must oscillate before it is a trip [s].
TRIP_DELAY_S = 0.2
#: Time between two looks at the law's stability [ns].
CHECK_PERIOD_NS = NANOSECONDS // 50
#: Warn below this fraction of the nominal bandwidth.
WARN_BANDWIDTH_RATIO = 0.7


class TripLimits(NamedTuple):
    """Thresholds of the trips."""

    #: Largest growth of an error, (TR1) [rad].
    growth: float = 1.0
    #: Longest time of a feedback that oscillates strongly [s].
    strained: float = TRIP_DELAY_S
    #: Longest limit cycle [s].
    cycling: float = 1.0
    #: Lowest frequency of an oscillation that is named [Hz].
    frequency: float = 1.0


TRIP_LIMITS = TripLimits()
#: Possible causes of an error that grows, or of a feedback that oscillates.
_CAUSES = ('possible causes are drives that are slower than torque_rate_limit or later than '
           'actuator_lag and input_delay, a small ka, elastic joints, and a wrong rotor_inertia')
#: Possible causes of a limit cycle, and the cure.
_CYCLE_CAUSES = ('the joints are elastic, or an inertia of the model is wrong, often a rotor; '
                 'set resonance or correct rotor_inertia (docs/safety.md#limit-cycles)')


def joint_beyond(e: Vector, limit: Vector) -> int | None:
    """
    Return the first joint beyond its limit, if any.

    Parameters
    ----------
    e : sequence of float, shape (n,)
        Position error [rad]. NaN exceeds any limit.
    limit : sequence of float, shape (n,)
        Largest magnitude allowed [rad].

    """
    for joint, (error, largest) in enumerate(zip(e, limit)):
        if not -largest <= error <= largest:
            return joint
    return None


class TripMonitor:
    """
    Watches the error, and the bandwidth that a law uses.

    Parameters
    ----------
    names : sequence of str
        The joints.
    period : int
        Control period [ns].

    """

    def __init__(self, names: Sequence[str], period: int) -> None:
        self._names = names
        self._interval = max(CHECK_PERIOD_NS // period, 1)
        self._samples = 0
        #: For (TR1): the law, and the smallest errors under it.
        self._law = ''
        self.restart()

    def restart(self) -> None:
        """Begin again with the torques."""
        self._smallest = [inf] * len(self._names)

    def check(self, law: Controller, sample: Sample) -> str:
        """Return the reason not to send a torque, or ''."""
        config, e = law.config, sample.e
        if (joint := joint_beyond(e, config.error_limit)) is not None:
            return (f'the position error of {self._names[joint]}, {e[joint]:.4g} rad, exceeded '
                    'error_limit')
        if config.law != self._law:
            self._law = config.law
            self.restart()
        if law.law.is_watched and min(config.error_limit) == inf:
            magnitude = [abs(x) for x in e]
            self._smallest = list(map(min, magnitude, self._smallest))
            by_joint = list(map(sub, magnitude, self._smallest))
            growth = max(by_joint)
            joint = by_joint.index(growth)
            if growth > TRIP_LIMITS.growth:
                return (f'the position error of {self._names[joint]} has grown by {growth:.2f} '
                        f'rad (set error_limit to allow more than {TRIP_LIMITS.growth:g} rad)'
                        f'{self._where(law.stability)}; {_CAUSES}')
        self._samples += 1
        if self._samples % self._interval:
            return ''
        return self._oscillation(config.law, law.stability)

    def _oscillation(self, law: str, state: Stability) -> str:
        """Return the reason to end an oscillation, or ''."""
        if state.strained >= TRIP_LIMITS.strained:
            return f'the feedback of {law} oscillated{self._where(state)}; {_CAUSES}'
        if state.cycling >= TRIP_LIMITS.cycling:
            return (f'the feedback of {law} oscillated at every bandwidth'
                    f'{self._where(state)}; {_CYCLE_CAUSES}')
        return ''

    def _where(self, state: Stability) -> str:
        """Return the joint that oscillates and its frequency, or ''."""
        if (state.bandwidth > WARN_BANDWIDTH_RATIO
                or state.frequency < TRIP_LIMITS.frequency):
            return ''
        return f': {self._names[state.joint]} oscillates at {state.frequency:.0f} Hz'


#: Largest factor by which a number changes at once.
MAX_CHANGE_FACTOR = 100.0


def low_bandwidth(law: Controller) -> list[str]:
    """Return a line if an oscillation reduces the bandwidth."""
    ratio = law.stability.bandwidth
    return [] if ratio > WARN_BANDWIDTH_RATIO else [
        f'the feedback oscillates, so the law uses {100.0 * ratio:.0f} % of its bandwidth; '
        f'{_CAUSES}']


def unsafe_settings(config: ControllerConfig) -> Iterator[str]:
    """Yield a line for each unsafe setting."""
    law = law_class(config.law)
    for name, ki, bound in zip(config.joint_names, config.ki, law.largest_ki(config)):
        if ki >= bound:
            yield (f'{name}: ki is {ki:g}, but the loop is unstable from {max(bound, 0.0):g} on; '
                   'lower ki')
    exceeds = map(gt, config.effort_rate_limit, config.torque_rate_limit)
    if not law.is_bounded and any(exceeds):
        yield ('effort_rate_limit exceeds torque_rate_limit; the drives cannot follow such a '
               f'torque, and the estimate of {config.law} grows; lower effort_rate_limit')


def check_change(present: ControllerConfig, candidate: ControllerConfig) -> None:
    """
    Raise `ParameterError` if a number changes too much at once.

    The largest factor is `MAX_CHANGE_FACTOR`.
    From 0 a factor counts from the default, or from 1. A number that becomes 0, or that is or
    becomes infinite, is not checked.
    """
    n = len(present.joint_names)
    for name, spec in ControllerConfig.parameters().items():
        is_ramped = name in ('payload_mass', 'payload_center')
        if spec.read_only or is_ramped or spec.kind not in ('float', 'float[]'):
            continue
        old = _magnitudes(spec, getattr(present, spec.field), n)
        new = _magnitudes(spec, getattr(candidate, spec.field), n)
        old[old == 0.0] = spec.default if 0.0 < spec.default < inf else 1.0
        with np.errstate(all='ignore'):
            ratio = np.maximum(new / old, old / new)
        is_checked = (new > 0.0) & np.isfinite(new) & np.isfinite(old)
        if (ratio > 1.01 * MAX_CHANGE_FACTOR)[is_checked].any():
            raise ParameterError(name, getattr(candidate, spec.field), (
                f'a change by a factor of at most {MAX_CHANGE_FACTOR:g} at once; for a larger '
                'change set values in between first'))


def _magnitudes(spec: Parameter, value: Any, n: int) -> Array:
    """Return the numbers of a parameter, those on the diagonal of a matrix."""
    numbers = np.diagonal(matrix(value, n)) if spec.shape == 'nn' else np.atleast_1d(value)
    return np.abs(numbers)


def missing_limits(config: ControllerConfig, of_model: Vector) -> str:
    """
    Return a warning of joints without a torque limit.

    It is '' if all have one.

    Parameters
    ----------
    config : ControllerConfig
        As at the start.
    of_model : sequence of float, shape (n,)
        `Model.effort_limits`.

    """
    limits = config.largest_torque(of_model)
    joints = [name for name, limit in zip(config.joint_names, limits) if limit == inf]
    return f'effort_limit is infinite for {", ".join(joints)}' if joints else ''
