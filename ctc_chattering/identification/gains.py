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
from typing import Any

from ctc_chattering.analysis.tables import rounded
from ctc_chattering.control.recommended_gains import (
    estimator_bandwidth,
    largest_pole,
    lateness,
    SLOWNESS,
)
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.findings import (
    Finding,
    note,
    Reason,
    Severity,
)
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import (
    in_digits,
    MeasuredPerturbation,
    perturbation_bound,
)
from ctc_chattering.identification.verdict import verdicts
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Times in which friction may change its sign, and drives without torque carry the arm, and range
#: of lags up to which they are known [s]; least rate to ask for [N·m/s].
_REVERSAL, _CARRIED, _KNOWN, _LEAST = 0.02, 0.03, 0.003, 1.0
#: Largest product of observer bandwidth and lag, and bandwidth without a lag [rad/s].
_LAG, _BANDWIDTH = 0.3, 1200.0
#: Parts of the fastest pole that are tried in turn.
SLOWER = (1.0, 0.7, 0.5, 0.35, 0.25)
#: Parameters of the controller, each with a reason.
Gains = dict[str, tuple[object, str]]
#: Gains of the laws of the paper, where those of the run are not known.
GAINS = (100.0, 50.0)


def torque_rate(identified: Identification, fastest: Array, given: Sequence[float] = (),
                weight: Array | float = 0.0) -> tuple[Array, list[Finding]]:
    """
    Return `torque_rate_limit`, shape (n,) [N·m/s], and findings on the drives.

    It is what friction and motion need, and what carries the arm at the start, when drives may be
    without torque; and never more than drives have: a drive that is slower than the law is told
    makes the loop diverge; one that is faster costs little. Where the lag is inverted, commands
    change by up to R (2 T + h) a period; of drives whose rate is known, R is so small that this is
    within what they do in a period, if that is enough.

    Parameters
    ----------
    identified : Identification
        What was identified.
    fastest : ndarray, shape (n,)
        How fast the model's torque changes, as fast as the limits allow [N·m/s].
    given : sequence of float, shape (n,), optional
        Rate that the drives allow [N·m/s].
    weight : ndarray, shape (n,), or float
        Largest torque of the model at rest, in the poses of the run [N·m].

    """
    # The largest friction near 0 velocity.
    friction = [joint.at_rest for joint in identified.friction]
    needed = np.maximum(2.0 * np.array(friction) / _REVERSAL, fastest).clip(min=_LEAST)
    known = np.array(given or [
        np.nan if x.value is None else x.value - x.half for x in identified.rate]
        or [np.nan] * len(needed))
    known = np.where(known > 0.0, known, np.nan)
    least = known / (1.0 + 2.0 * longest_lag(identified) / identified.clock.period)
    findings = [Finding(
        Reason.GAINS, Severity.CARE, i, f'its drive changes the torque by {have:.3g} N*m/s; '
        f'{need:.3g} N*m/s are needed for reversals in {_REVERSAL:g} s and faster motions',
        'expect errors at reversals, and slow the motion down')
        for i, (need, have) in enumerate(zip(needed, known)) if have < need]
    if np.isnan(known).any():
        findings.append(note('the rate of the drives is not known; give --torque-rate where a '
                             'drive is slower than the torque_rate_limit that is recommended'))
    # Lags that may be anything are those of elastic joints, say: fast commands make them swing.
    lags = np.array(list(identified.timing.delays.values()))
    sure = len(lags) and np.ptp(lags, axis=(0, 1)).max() <= _KNOWN
    wanted = np.maximum(needed, weight / _CARRIED if sure else 0.0)
    return np.where(np.isfinite(known), np.clip(wanted, least, known), wanted), findings


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
        What makes gains doubtful.
    options : tuple of dict
        `values`, and more careful ones, each more than the one before.
    trials : tuple of str
        What trial runs showed; empty where there were none.

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
        What was identified.
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
    bound = perturbation_bound(identified, run, model, corrected)
    weight = [np.abs(model.gravity_torque(q.tolist())) for q in identified.positions.poses]
    slope, slow = torque_rate(identified, bound.change, rate, np.max(weight, axis=0))
    level = [max(0.0, x.coulomb.value or 0.0) for x in identified.friction]
    usable = [x.usable for x in verdicts(identified)]
    bandwidth = min(_BANDWIDTH, _LAG / longest) if longest else _BANDWIDTH
    delays = ' or '.join(map(str, identified.timing.delays))
    shared: Gains = {
        'law': ('observer_feedback', 'it inverts the lag of drives, and needs no velocities'),
        'input_delay': (int(delay) if isfinite(delay) else 0,
                        f'samples from a torque to the motion: {delays or "not known"}'),
        'actuator_lag': ([rounded(x) for x in lag], 'the lag of the drives'),
        'switching': ('implicit_observer', 'if you choose law chattering'),
        'observer_bandwidth': (in_digits(bandwidth, 2, np.floor), f'then {_LAG:g} / T with the '
                               f'longest lag of the drives that is possible, T = {longest:.3g} s, '
                               f'at most {_BANDWIDTH:g} rad/s'),
        **{name: ([rounded(float(x), 6) if good else None for x, good in zip(values, usable)],
                  reason) for name, values, reason in (
            ('ka', bound.ka, bound.reason), ('friction_level', level, 'the Coulomb friction'),
            ('torque_rate_limit', slope, 'what a reversal of friction within '
             f'{_REVERSAL:g} s, the weight within {_CARRIED:g} s at the start and the fastest '
             'motion need, within the rate of the drives where it is known'))}}
    # The coarsest step of an encoder, or the noise of positions, if that is more.
    steps = [x.value or 0.0 for x in identified.encoder]
    resolution = max(float(identified.positions.noise.max()), *steps)
    options = tuple({**shared, **_poles(identified, x, resolution)} for x in SLOWER)
    return Recommendation(options[0], (
        *run.outliers(), *run.break_away(identified.joints), *bound.findings, *slow),
        options)


def _poles(identified: Identification, slower: float, resolution: float) -> Gains:
    """Return the gains of `observer_feedback`, its pole as a part of the fastest."""
    period, lag, n = identified.clock.period, identified.timing.drive.lag, len(identified.joints)
    late, slowest, most = max(
        (lateness(float(x.max()), period, d), float(x.max()), d)
        for d, x in (identified.timing.delays or {0: lag}).items())
    pole = in_digits(slower * largest_pole(late), 2, np.floor)
    ratio = estimator_bandwidth(1.0, resolution)
    return {'kp': ([pole ** 2] * n, f'a double pole at p = {pole:g} rad/s, p (T + h (1 + d)) = '
                   f'{pole * late:.2g} ≤ {SLOWNESS:g} with T = {slowest:.3g} s, '
                   f'h = {period:g} s, d = {most}'),
            'kv': ([2.0 * pole] * n, '2 p'),
            'estimator_bandwidth': (ratio * pole,
                                    f'{ratio:g} p for positions to {resolution:.2g} rad')}
