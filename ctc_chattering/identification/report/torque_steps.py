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

"""How fast torques change: the rate that the drives are asked for, and steps from h to h."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.identification.regression.finding import (
    ALL_JOINTS,
    Finding,
    Severity,
)
from ctc_chattering.identification.regression.identify import Identification
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Time in which friction may change its sign [s].
_REVERSAL = 0.02
#: Least rate to ask for [N·m/s].
_LEAST = 1.0
#: Half the boundary layer that steps are computed with [rad/s].
_BOUNDARY_LAYER = 0.05
#: Deviations of noise that are counted.
_DEVIATIONS = 6.0


class TorqueRate(NamedTuple):
    """
    The rate that `observer_feedback` asks of the drives.

    Attributes
    ----------
    value : ndarray, shape (n,)
        `torque_rate_limit` of the controller [N·m/s].
    known : ndarray, shape (n,)
        Rate of the drives, at the lower end of its interval; nan where it is not known [N·m/s].
    reason : str
        Where the value comes from.
    findings : tuple of Finding
        Of the drives.

    """

    value: Array
    known: Array
    reason: str
    findings: tuple[Finding, ...]


def torque_rate(found: Identification, fastest: Array, given: Sequence[float] = ()
                ) -> TorqueRate:
    """
    Return the rate to ask for: what friction and motion need, and never more than drives have.

    A drive that is slower than the law is told makes the loop diverge; one that is faster costs
    little. Where the lag is inverted, commands change by up to R (2 T + h) a period; of drives
    whose rate is known, R is so small that this is within what they do in a period, if that is
    enough.

    Parameters
    ----------
    found : Identification
        What was identified.
    fastest : ndarray, shape (n,)
        How fast the model's torque changes, as fast as the limits allow [N·m/s].
    given : sequence of float, shape (n,), optional
        Rate that the drives allow [N·m/s].

    """
    n, period = len(found.joints), found.clock.period
    lag = longest_lag(found)
    needed = np.maximum(2.0 * sliding_friction(found) / _REVERSAL, fastest).clip(min=_LEAST)
    known = np.array(given, float) if len(given) else np.array(
        [np.nan if x.value is None else x.value - x.half for x in found.rate] or [np.nan] * n)
    known = np.where(known > 0.0, known, np.nan)
    least = known / (1.0 + 2.0 * lag / period)
    value = np.where(np.isfinite(known), np.clip(needed, least, known), needed)
    text = (f'friction changes its sign within {_REVERSAL:g} s, and the torque of the model as '
            'fast as the limits allow')
    if np.isfinite(known).any():
        text += '; within ' + ('--torque-rate' if len(given) else
                               'the lower end of the interval of the rate of the drives')
    return TorqueRate(value, known, text, tuple(_noticed(needed, known)))


def _noticed(needed: Array, known: Array) -> Iterator[Finding]:
    """Yield for which joints the rate is too little, and whether any is not known."""
    for i, (need, have) in enumerate(zip(needed, known)):
        if have < need:
            yield Finding(
                Severity.CARE, i, f'its drive changes the torque by {have:.3g} N*m/s; {need:.3g} '
                f'N*m/s are needed for reversals in {_REVERSAL:g} s and faster motions',
                'expect errors at reversals, and slow the motion down')
    if np.isnan(known).any():
        yield Finding(Severity.NOTE, ALL_JOINTS, 'the rate of the drives is not known',
                      'give --torque-rate where a drive is slower than the torque_rate_limit that '
                      'is recommended')


def longest_lag(found: Identification) -> Array:
    """Return the longest lag of each drive that is possible, shape (n,) [s]."""
    possible = [lags[2] for lags in found.timing.delays.values()] or [found.timing.drive[1]]
    largest: Array = np.max(possible, axis=0)
    return largest


def sliding_friction(found: Identification) -> Array:
    """Return the largest friction of each joint near 0 velocity, shape (n,) [N·m]."""
    return np.array([
        max([abs(x.value) for x in (one.coulomb, one.forwards, one.backwards)
             if x.value is not None], default=0.0) + max(one.stribeck.value or 0.0, 0.0)
        for one in found.friction])


def torque_steps(found: Identification, ka: Array, noise: Array, kv: float, rate: Array
                 ) -> dict[str, Array]:
    """
    Return the largest torque step per period of each switching and law, shape (n,) [N·m].

    With `sign` the term jumps by 2 ka; with `boundary_layer` by ka / φ times the noise of v; with
    the others by what the friction changes at a reversal, twice Coulomb and Stribeck friction,
    and by the noise M σ / h, but never by more than 2 ka. The noise of the feedback, M kv σ, comes
    to all of them. Six deviations of noise are counted. Commands of `observer_feedback` are within
    R (T + h) of the torque of the drives, which moves by R h.

    Parameters
    ----------
    found : Identification
        What was identified.
    ka, noise, rate : ndarray, shape (n,)
        ka and M σ / h [N·m], and R of `torque_rate` [N·m/s].
    kv : float
        Of the run [1/s].

    """
    most = 2.0 * ka
    period = found.clock.period
    loud = np.where(np.isfinite(noise), _DEVIATIONS * noise, most)
    sigma = np.array([x.value if x.value is not None else np.inf for x in found.noise])
    feedback = _DEVIATIONS * period * kv * np.where(np.isfinite(noise), noise, 0.0)
    soft = ka / _BOUNDARY_LAYER * np.where(np.isfinite(sigma), _DEVIATIONS * sigma, np.inf)
    both = np.minimum(most, 2.0 * sliding_friction(found) + loud)
    steps = {'sign': most, 'boundary_layer': np.minimum(most, soft), 'implicit': both,
             'implicit_observer': both}
    return {**{name: steps.get(name, most) + feedback for name in SWITCHINGS},
            'observer_feedback': rate * (2.0 * longest_lag(found) + period)}
