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

"""Gains of `observer_feedback` from what was identified: ka, rate of the drives, and poles."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from math import isfinite
from typing import Any, NamedTuple

from ctc_chattering.analysis.tables import rounded
from ctc_chattering.control.recommended_gains import (
    BANDWIDTH_LAG,
    estimator_bandwidth,
    largest_pole,
    lateness,
    MAX_POLE_LATENESS,
    observer_bandwidth,
    RECOMMENDED_LAW,
    RECOMMENDED_SWITCHING,
)
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.findings import (
    Finding,
    note,
    Reason,
    Severity,
)
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import MeasuredPerturbation
from ctc_chattering.identification.perturbation_bound import bound_perturbation, round_to_digits
from ctc_chattering.identification.verdict import verdicts
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Time in which friction may change its sign [s].
REVERSAL_S = 0.02
#: Time in which drives without torque carry the arm [s].
CARRIED_S = 0.03
#: Range of lags up to which they are known [s].
KNOWN_LAG_S = 0.003
#: Least rate to ask for [N·m/s].
LEAST_RATE = 1.0
#: Largest observer bandwidth [rad/s].
MOST_BANDWIDTH = 1200.0
#: Parts of the fastest pole that are tried in turn.
SLOWER = (1.0, 0.7, 0.5, 0.35, 0.25)
#: Parameters of the controller, each with a reason.
Gains = dict[str, tuple[object, str]]
#: Gains of the laws of the paper, where those of the run are not known.
GAINS = (100.0, 50.0)


class RateLimit(NamedTuple):
    """`torque_rate_limit` of each joint, shape (n,) [N·m/s], and findings on the drives."""

    rate: Array
    findings: tuple[Finding, ...]


def torque_rate(identified: Identification, fastest: Array, declared: Sequence[float] = (),
                weight: Array | float = 0.0) -> RateLimit:
    """
    Return the rate limit for the law.

    It is what friction and motion need, and what carries the arm at the start, when drives may be
    without torque. It is never above the drive's own rate: a drive that is slower than the
    configured limit makes the loop diverge, one that is faster costs little. Where the lag is
    inverted, commands change by up to R (2 T + h) a period. For drives whose rate is known, R is
    so small that this is within what they do in a period, if that is enough.

    Parameters
    ----------
    identified : Identification
        As of `identify`.
    fastest : ndarray, shape (n,)
        Change of the model's torque as fast as the limits allow [N·m/s].
    declared : sequence of float, shape (n,), optional
        Rate that the drives allow [N·m/s].
    weight : ndarray, shape (n,), or float
        Largest torque of the model at rest, in the poses of the run [N·m].

    """
    friction = np.array([joint.at_rest for joint in identified.friction])
    needed = np.maximum(2.0 * friction / REVERSAL_S, fastest).clip(min=LEAST_RATE)
    identified_rate = [np.nan if x.value is None else x.value - x.half for x in identified.rate]
    drive = np.array(declared or identified_rate or [np.nan] * len(needed))
    drive = np.where(drive > 0.0, drive, np.nan)
    least = drive / (1.0 + 2.0 * longest_lag(identified) / identified.clock.period)
    findings = [Finding(
        Reason.GAINS, Severity.CARE, joint,
        f'The drive changes its torque by {drive[joint]:.3g} N*m/s; {needed[joint]:.3g} N*m/s are '
        f'needed for reversals in {REVERSAL_S:g} s and faster motions',
        'Expect errors at reversals, and slow the motion down')
        for joint in np.flatnonzero(drive < needed).tolist()]
    if np.isnan(drive).any():
        findings.append(note('The rate of the drives is not known; give --torque-rate where a '
                             'drive is slower than the torque_rate_limit that is recommended'))
    # Lags that may be anything are those of elastic joints, say: fast commands make them swing.
    lags = np.array(list(identified.timing.delays.values()))
    is_known = len(lags) and np.ptp(lags, axis=(0, 1)).max() <= KNOWN_LAG_S
    wanted = np.maximum(needed, weight / CARRIED_S if is_known else 0.0)
    rate = np.where(np.isfinite(drive), np.clip(wanted, least, drive), wanted)
    return RateLimit(rate, tuple(findings))


def longest_lag(identified: Identification) -> Array:
    """Return the longest lag of each drive that is possible, shape (n,) [s]."""
    timing = identified.timing
    possible = [lags[2] for lags in timing.delays.values()] or [timing.drive.lag]
    return np.asarray(np.max(possible, axis=0))


@dataclasses.dataclass(frozen=True)
class Recommendation:
    """
    Gains for the controller; n joints.

    Attributes
    ----------
    values : dict of str to (value, reason)
        Parameters of the controller.
    findings : tuple of Finding
        Doubts about the gains.
    options : tuple of dict
        `values`, and more careful ones, each more than the one before.
    trials : tuple of str
        Results of trial runs; empty where there were none.

    """

    values: Gains
    findings: tuple[Finding, ...] = ()
    options: tuple[Gains, ...] = ()
    trials: tuple[str, ...] = ()

    @property
    def ka(self) -> list[float | None]:
        """Return ka of each joint [N·m]; None for one that is not usable."""
        ka: Any = self.values['ka'][0]
        return list(ka)


def recommend(identified: Identification, run: MeasuredPerturbation, model: Model,
              rate: Sequence[float] = (), corrected: bool = False) -> Recommendation:
    """
    Return gains.

    Parameters
    ----------
    identified : Identification
        As of `identify`.
    run : MeasuredPerturbation
        P of the run.
    model : Model
        The controller's.
    rate : sequence of float, shape (n,), optional
        Rate that the drives allow [N·m/s].
    corrected : bool
        Whether the model has the identified bodies.

    """
    delay, lag, _ = identified.timing.drive
    longest = float(longest_lag(identified).max())
    bound = bound_perturbation(identified, run, model, corrected)
    weight = [np.abs(model.gravity_torque(q.tolist())) for q in identified.positions.poses]
    drives = torque_rate(identified, bound.change, rate, np.max(weight, axis=0))
    level = [max(0.0, x.coulomb.value or 0.0) for x in identified.friction]
    usable = [x.usable for x in verdicts(identified)]

    def of_usable(values: Sequence[float] | Array, reason: str) -> tuple[object, str]:
        return ([rounded(float(x), 6) if good else None for x, good in zip(values, usable)],
                reason)

    bandwidth = observer_bandwidth(longest, MOST_BANDWIDTH)
    delays = ' or '.join(map(str, identified.timing.delays))
    shared: Gains = {
        'law': (RECOMMENDED_LAW, 'it inverts the lag of drives, and needs no velocities'),
        'input_delay': (int(delay) if isfinite(delay) else 0,
                        f'samples from a torque to the motion: {delays or "not known"}'),
        'actuator_lag': ([rounded(x) for x in lag], 'the lag of the drives'),
        'switching': (RECOMMENDED_SWITCHING, 'if you choose law chattering'),
        'observer_bandwidth': (
            round_to_digits(bandwidth, 2, np.floor),
            f'if you choose it: {BANDWIDTH_LAG:g} / T with the longest lag of the drives that is '
            f'possible, T = {longest:.3g} s, at most {MOST_BANDWIDTH:g} rad/s'),
        'ka': of_usable(bound.ka, bound.reason),
        'friction_level': of_usable(level, 'the Coulomb friction'),
        'torque_rate_limit': of_usable(
            drives.rate, f'what a reversal of friction within {REVERSAL_S:g} s, the weight within '
            f'{CARRIED_S:g} s at the start and the fastest motion need, within the rate of the '
            'drives where it is known')}
    # The coarsest step of an encoder, or the noise of positions, if that is more.
    steps = [x.value or 0.0 for x in identified.encoder]
    resolution = max(float(identified.positions.noise.max()), *steps)
    options = tuple({**shared, **_poles(identified, x, resolution)} for x in SLOWER)
    return Recommendation(
        options[0], (*run.outliers(), *run.break_away(identified.joints), *bound.findings,
                     *drives.findings), options)


class _Latest(NamedTuple):
    """The possible delay and lag of the drives after which a torque acts last [s, s, samples]."""

    lateness: float
    lag: float
    delay: int


def _poles(identified: Identification, slower: float, resolution: float) -> Gains:
    """Return the gains of `observer_feedback`, its pole as a part of the fastest."""
    period, n = identified.clock.period, len(identified.joints)
    possible = identified.timing.delays or {0: identified.timing.drive.lag}
    latest = max(_Latest(lateness(float(lags.max()), period, delay), float(lags.max()), delay)
                 for delay, lags in possible.items())
    pole = round_to_digits(slower * largest_pole(latest.lateness), 2, np.floor)
    ratio = estimator_bandwidth(1.0, resolution)
    return {'kp': ([pole ** 2] * n, f'a double pole at p = {pole:g} rad/s, p (T + h (1 + d)) = '
                   f'{pole * latest.lateness:.2g} ≤ {MAX_POLE_LATENESS:g} with '
                   f'T = {latest.lag:.3g} s, h = {period:g} s, d = {latest.delay}'),
            'kv': ([2.0 * pole] * n, '2 p'),
            'estimator_bandwidth': (ratio * pole,
                                    f'{ratio:g} p for positions to {resolution:.2g} rad')}
