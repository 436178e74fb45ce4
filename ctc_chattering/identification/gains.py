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
import dataclasses
from math import isfinite
from typing import Any, NamedTuple

from ctc_chattering.analysis.tables import rounded
from ctc_chattering.control.recommended_gains import (
    estimator_bandwidth,
    largest_pole,
    lateness,
    SLOWNESS,
)
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.findings import ALL_JOINTS, Finding, Kind
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.least_squares import Data, TermKind
from ctc_chattering.identification.perturbation import (
    in_digits,
    MeasuredPerturbation,
    perturbation_bound,
)
from ctc_chattering.identification.verdict import verdicts
from ctc_chattering.identification.weak_form import position_noise
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Time in which friction may change its sign [s].
_REVERSAL = 0.02
#: Least rate to ask for [N·m/s].
_LEAST = 1.0


class TorqueRate(NamedTuple):
    """
    The rate that `observer_feedback` asks of the drives.

    Attributes
    ----------
    value : ndarray, shape (n,)
        `torque_rate_limit` of the controller [N·m/s].
    known : ndarray, shape (n,)
        Rate of the drives, at the lower end of its interval; nan where it is not known [N·m/s].
    findings : tuple of Finding
        Of the drives.

    """

    value: Array
    known: Array
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
    return TorqueRate(value, known, tuple(_noticed(needed, known)))


def _noticed(needed: Array, known: Array) -> Iterator[Finding]:
    """Yield for which joints the rate is too little, and whether any is not known."""
    for i, (need, have) in enumerate(zip(needed, known)):
        if have < need:
            yield Finding(
                Kind.DOUBT, i, f'its drive changes the torque by {have:.3g} N*m/s; {need:.3g} '
                f'N*m/s are needed for reversals in {_REVERSAL:g} s and faster motions',
                'expect errors at reversals, and slow the motion down')
    if np.isnan(known).any():
        yield Finding(Kind.NOTE, ALL_JOINTS, 'the rate of the drives is not known',
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


#: Poses that are looked at.
_POSES = 20


def inertia_findings(found: Identification, model: Model, positions: Array) -> Iterator[Finding]:
    """
    Yield the joints whose inertia the model has wrong by more than a loop stands.

    Parameters
    ----------
    found : Identification
        With errors of the model.
    model : Model
        As `identify` had it.
    positions : ndarray, shape (N, n)
        Of the run [rad].

    """
    most = Kind.INERTIA.refused
    for i, (low, high) in enumerate(_ratios(found, model, positions)):
        off = max(low, 1.0 / max(high, 1e-9))
        if off > most:
            yield Finding(
                Kind.INERTIA, i, f'the inertia about it is {0.5 * (low + high):.3g} times '
                f'that of the model, allowed for gains: {1.0 / most:g} to {most:g}',
                'correct the description: rotor inertia, masses and inertias', off)


def _ratios(found: Identification, model: Model, positions: Array) -> Array:
    """Return the interval of M_ii of the robot over that of the model, shape (n, 2)."""
    n = model.n
    if found.columns is None:
        return np.ones((n, 2))
    zero, ratios = np.zeros(n), []
    for q in positions[::max(1, len(positions) // _POSES)]:
        mass = np.diagonal(model.mass_matrix(q.tolist()))
        rest = found.columns.at(q, zero, zero)
        columns = np.array([(found.columns.at(q, zero, x) - rest)[i]
                            for i, x in enumerate(np.eye(n))])
        state = Data.at(np.ones((1, n)), zero[None], zero[None], columns[None])
        change, half = (x[0] for x in found.selected.torque(state, (TermKind.MODEL,)))
        ratios.append(1.0 + np.stack((change - half, change + half), axis=1) / mass[:, None])
    middle: Array = np.median(ratios, axis=0)
    return middle


#: Deviations of noise that must have room between |P| and ka.
_ROOM = 2.0
#: Largest product of observer bandwidth and lag, and bandwidth without a lag [rad/s].
_LAG, _BANDWIDTH = 0.3, 1200.0
#: A lag above this part of a period, or a delay, asks for observer_feedback.
_SHORT_LAG = 0.25
#: Positions at which inertias are looked up.
_POSITIONS = 200
#: Parts of the fastest pole that are tried in turn.
SLOWER = (1.0, 0.7, 0.5, 0.35, 0.25)
#: Parameters of the controller, each with a reason.
Gains = dict[str, tuple[object, str]]
#: Gains of the laws of the paper, where those of the run are not known.
GAINS = (100.0, 50.0)


@dataclasses.dataclass(frozen=True)
class Recommendation:
    """
    Gains for the controller; n joints.

    Attributes
    ----------
    values : dict of str to (value, reason)
        Parameters of the controller.
    noise_torque : ndarray, shape (n,)
        M σ / h: what the noise of the velocity adds to the chattering term [N·m].
    findings : tuple of Finding
        What makes gains doubtful.
    options : tuple of dict
        `values`, and more careful ones, each more than the one before.
    trials : tuple of str
        What trial runs showed; empty where there were none.

    """

    values: Gains
    noise_torque: Array
    findings: tuple[Finding, ...] = ()
    options: tuple[Gains, ...] = ()
    trials: tuple[str, ...] = ()

    @property
    def law(self) -> str:
        """Return the law to be used."""
        return str(self.values['law'][0])

    @property
    def ka(self) -> list[float | None]:
        """Return ka of each joint [N·m]; None for one that is not usable."""
        ka: Any = self.values['ka'][0]
        return list(ka)


def recommend(found: Identification, run: MeasuredPerturbation, model: Model, positions: Array,
              rate: Sequence[float] = ()) -> Recommendation:
    """
    Return gains.

    Parameters
    ----------
    found : Identification
        What was identified.
    run : MeasuredPerturbation
        P of the run.
    model : Model
        The controller's.
    positions : ndarray, shape (N, n)
        Of the run [rad].
    rate : sequence of float, shape (n,), optional
        Rate that the drives allow [N·m/s].

    """
    period = found.clock.period
    noise = _noise_torque(found, model, positions)
    bound = perturbation_bound(found, run, model)
    ka, peak, drives = bound.ka, bound.peak, torque_rate(found, bound.change, rate)
    allowed = [bool(w <= (k - p) / _ROOM * 1.001) for k, p, w in zip(ka, peak, noise)]
    delay = found.timing.drive[0]
    resolution = _resolution(found, positions)
    slow = (not isfinite(delay) or bool(longest_lag(found).max() > _SHORT_LAG * period)
            or bool((2.0 * ka > period * drives.known).any()))
    law = 'observer_feedback' if slow or not all(allowed) else 'chattering'
    level = [max(0.0, x.coulomb.value or 0.0) for x in found.friction]
    usable = [x.usable for x in verdicts(found)]
    shared: Gains = {name: ([rounded(float(x), 6) if good else None
                             for x, good in zip(values, usable)], reason)
                     for name, values, reason in (
                         ('ka', ka, bound.reason),
                         ('friction_level', level, 'the Coulomb friction'),
                         ('torque_rate_limit', drives.value, 'what a reversal of friction within '
                          f'{_REVERSAL:g} s and the fastest motion need, within the rate of the '
                          'drives where it is known'))}
    why = ('period, noise and drives allow a chattering term on every joint'
           if law == 'chattering' else 'it inverts the lag of drives, and needs no velocities: a '
           'delay or noise that is not known, a lag, a rate limit of the drives, or noise leaves '
           'no room for a chattering term')
    laws = [(law, why, 1.0)] if law == 'chattering' else []
    laws += [('observer_feedback', 'the next one' if laws else why, x) for x in SLOWER]
    options = [_drive_values(found) | shared | _law_values(found, *one, resolution)
               for one in laws]
    noticed = (*run.outliers(), *run.break_away(found.joints), *bound.findings, *drives.findings,
               *inertia_findings(found, model, positions))
    return Recommendation(options[0], noise, noticed, tuple(options))


def _noise_torque(found: Identification, model: Model, positions: Array) -> Array:
    """Return the largest √(Σ M_ij² σ_j²) / h over the run; inf where σ is not known."""
    sigma = np.array([np.inf if x.value is None else x.value for x in found.noise])
    if not np.isfinite(sigma).all():
        return np.full(len(sigma), np.inf)
    every = max(1, len(positions) // _POSITIONS)
    masses = np.array([model.mass_matrix(q.tolist()) for q in positions[::every]])
    largest: Array = np.sqrt(np.square(masses) @ np.square(sigma)).max(axis=0)
    return largest / found.clock.period


def _resolution(found: Identification, positions: Array) -> float:
    """Return the coarsest step of an encoder, or the noise of positions, if that is more [rad]."""
    return max(float(position_noise(positions, found.clock.period).max()),
               *(x.value or 0.0 for x in found.encoder))


def _drive_values(found: Identification) -> Gains:
    """Return what the controller knows of the drives, with its reasons."""
    delay, lag, _ = found.timing.drive
    longest = float(longest_lag(found).max())
    text = ' or '.join(map(str, found.timing.delays)) or 'not known, no commands'
    bandwidth = min(_BANDWIDTH, _LAG / longest) if longest else _BANDWIDTH
    return {
        'input_delay': (int(delay) if isfinite(delay) else 0, 'samples from a torque '
                        f'to the motion: {text}'),
        'actuator_lag': ([rounded(x) for x in lag], 'the lag of the drives'),
        'switching': ('implicit_observer', 'estimates P; docs/theory.md'),
        'observer_bandwidth': (in_digits(bandwidth, 2, np.floor), (
            f'{_LAG:g} / T with the longest lag of the drives that is possible, '
            f'T = {longest:.3g} s' if longest else 'no lag of the drives is visible'))}


def _law_values(found: Identification, law: str, why: str, slower: float, resolution: float
                ) -> Gains:
    """Return a law and its own gains with their reasons, the pole as a part of the fastest."""
    if law == 'chattering':
        return {'law': (law, why)}
    period, lag, n = found.clock.period, found.timing.drive[1], len(found.joints)
    possible = found.timing.delays or {0: lag}
    late, slowest, most = max((lateness(float(x.max()), period, d), float(x.max()), d)
                              for d, x in possible.items())
    pole = in_digits(slower * largest_pole(late), 2, np.floor)
    text = (f'a double pole at p = {pole:g} rad/s, p (T + h (1 + d)) = {pole * late:.2g} ≤ '
            f'{SLOWNESS:g} with T = {slowest:.3g} s, h = {period:g} s, d = {most}')
    ratio = estimator_bandwidth(1.0, resolution)
    return {'law': (law, why), 'kp': ([pole ** 2] * n, text),
            'kv': ([2.0 * pole] * n, '2 p'),
            'estimator_bandwidth': (ratio * pole,
                                    f'{ratio:g} p for positions to {resolution:.2g} rad')}
