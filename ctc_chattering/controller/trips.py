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

- Law ``integral``: a joint with a lag has the poles of T s⁴ + s³ + Kv s² + Kp s + Ki, and is
  unstable for Ki >= Kp (Kv - T Kp) (Routh).
- Laws without a bound of what they estimate: drives with a limited rate that they do not know
  let the estimate grow, until the loop diverges (measured).

docs/safety.md has the measurements, and the conditions that settings do not show. A number that is
set while the controller runs changes by at most a factor of `FACTOR` at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf

from ctc_chattering.control.controller import Controller, Sample
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.base import Stability
from ctc_chattering.control.laws.registry import law_class
from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.parameters import matrix
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
    return next((i for i, (x, most) in enumerate(zip(e, limit)) if not -most <= x <= most), None)


#: How long a loop may seem out of control [s], and how often that is read [ns].
PATIENCE, _INTERVAL = 0.2, NANOSECONDS // 50
#: Longest limit cycle [s].
LIMIT_CYCLE_S = 1.0
#: Least frequency of an oscillation [Hz].
LEAST_FREQUENCY_HZ = 1.0
#: Part of the bandwidth below which it is worth a word.
_WORTH_A_WORD = 0.7
#: Why the error of a joint grows, or the feedback oscillates.
_CAUSES = ('the drives may be slower than torque_rate_limit, or later than actuator_lag and '
           'input_delay say, ka too small, joints elastic, or a rotor far from that of the model')
#: Why a loop has a limit cycle, and what to do about it.
_CYCLE_CAUSES = ('the joints are elastic, or an inertia is far from that of the model, often a '
                 "rotor's; set resonance, or correct rotor_inertia (docs/safety.md#limit-cycles)")


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
        #: Of (TR1): under which law, and the least errors.
        self._law = ''
        self.restart()

    def restart(self) -> None:
        """Begin again with the torques."""
        self._least = [inf] * len(self._names)

    def check(self, law: Controller, sample: Sample) -> str:
        """Return why the torque of a sample must not be sent until a reset; '' if it may be."""
        config, e = law.config, sample.e
        if (joint := joint_beyond(e, config.error_limit)) is not None:
            return (f'the position error of {self._names[joint]}, {e[joint]:.4g} rad, exceeded '
                    'error_limit')
        if config.law != self._law:
            self._law = config.law
            self.restart()
        if law.law.is_watched and min(config.error_limit) == inf:
            self._least = [min(abs(x), least) for x, least in zip(e, self._least)]
            grown, joint = max(
                (abs(x) - least, i) for i, (x, least) in enumerate(zip(e, self._least)))
            if grown > LARGEST_GROWTH:
                return (f'the position error of {self._names[joint]} has grown by {grown:.2f} rad '
                        f'(set error_limit to allow more than {LARGEST_GROWTH:g} rad)'
                        f'{self._where(law.stability)}; {_CAUSES}')
        self._samples += 1
        if self._samples % self._interval:
            return ''
        return self._oscillation(config.law, law.stability)

    def _oscillation(self, law: str, state: Stability) -> str:
        """Return why a feedback that oscillates must end; '' if it need not."""
        if state.strained >= PATIENCE:
            return f'the feedback of {law} oscillated{self._where(state)}; {_CAUSES}'
        if state.cycling >= LIMIT_CYCLE_S:
            return (f'the feedback of {law} found no bandwidth at which it is calm'
                    f'{self._where(state)}; {_CYCLE_CAUSES}')
        return ''

    def _where(self, state: Stability) -> str:
        """Return which joint oscillates, and how fast; '' if none does."""
        if state.bandwidth > _WORTH_A_WORD or state.frequency < LEAST_FREQUENCY_HZ:
            return ''
        return f': {self._names[state.joint]} oscillates at {state.frequency:.0f} Hz'


#: Largest factor by which a number changes at once.
FACTOR = 100.0


def low_bandwidth(law: Controller) -> list[str]:
    """Return a line if the feedback of a law oscillates so much that it uses less bandwidth."""
    part = law.stability.bandwidth
    return [] if part > _WORTH_A_WORD else [
        f'the feedback oscillates; the law is down to {100.0 * part:.0f} % of its bandwidth; '
        f'{_CAUSES}']


def unsafe_settings(config: ControllerConfig) -> Iterator[str]:
    """Yield a line for each condition of this module that `config` meets."""
    law = law_class(config.law)
    for name, ki, largest in zip(config.joint_names, config.ki, law.largest_ki(config)):
        if ki >= largest:
            yield f'{name}: ki is {ki:g}; the loop is unstable from {max(largest, 0.0):g} on'
    if not law.is_bounded and any(
            ours > drives for ours, drives in zip(
                config.effort_rate_limit, config.torque_rate_limit)):
        yield ('effort_rate_limit exceeds torque_rate_limit; where drives are slower than the '
               f'torque that is sent, the estimate of {config.law} grows')


def check_change(before: ControllerConfig, after: ControllerConfig) -> None:
    """
    Raise `ParameterError` if a number changes by more than `FACTOR` at once.

    From 0 a factor counts from the default, or from 1. What becomes 0, or is or becomes infinite,
    may be any.
    """
    n = len(before.joint_names)
    for name, spec in ControllerConfig.parameters().items():
        if spec.read_only or spec.kind not in ('float', 'float[]'):
            continue
        old, new = (np.abs(np.diagonal(matrix(x, n)) if spec.shape == 'nn' else np.atleast_1d(x))
                    for x in (getattr(before, spec.field), getattr(after, spec.field)))
        old[old == 0.0] = spec.default if 0.0 < spec.default < inf else 1.0
        with np.errstate(all='ignore'):
            ratio = np.maximum(new / old, old / new)
        if (ratio > 1.01 * FACTOR)[(new > 0.0) & np.isfinite(new) & np.isfinite(old)].any():
            raise ParameterError(name, getattr(after, spec.field), (
                f'a change by a factor of at most {FACTOR:g} at once; if you mean it, set values '
                'in between first'))


def missing_limits(config: ControllerConfig, of_model: Vector) -> str:
    """
    Return a line that names the joints whose torque has no limit, for a warning; '' for none.

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
