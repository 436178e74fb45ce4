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
Gains that follow from what was identified, each with the numbers it follows from.

The conditions are those of `docs/theory.md`: ka above |P|, room between ka and |P| for the noise
M σ / h that enters the chattering term, ω T ≤ 0.3 for the observer, and those of
`control/recommended_gains.py` for `observer_feedback`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import dataclasses
from math import floor, isfinite, log10
from typing import Any

from ctc_chattering.analysis.number_format import rounded
from ctc_chattering.control.recommended_gains import (
    estimator_bandwidth,
    largest_pole,
    lateness,
    SLOWNESS,
)
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.regression.finding import Finding
from ctc_chattering.identification.regression.identify import Identification
from ctc_chattering.identification.regression.weak_form import position_noise
from ctc_chattering.identification.report.inertia_error import inertia_findings
from ctc_chattering.identification.report.perturbation import MeasuredPerturbation
from ctc_chattering.identification.report.perturbation_bound import perturbation_bound
from ctc_chattering.identification.report.torque_steps import (
    longest_lag,
    torque_rate,
    torque_steps,
)
from ctc_chattering.identification.report.verdict import verdicts
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

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
    law, switching : str
        To be used.
    values : dict of str to (value, reason)
        Parameters of the controller.
    noise_torque : ndarray, shape (n,)
        M σ / h: what the noise of the velocity adds to the chattering term [N·m].
    allowed : list of bool, length n
        Whether period and noise allow a chattering term.
    verdicts : list of str, length n
        The same in numbers.
    steps : dict of str to ndarray, shape (n,)
        Largest torque step per period to be expected, by switching [N·m].
    period : float
        h [s].
    findings : tuple of Finding
        What makes gains doubtful.
    options : tuple of dict
        `values`, and more careful ones, each more than the one before.
    trials : tuple of str
        What trial runs showed; empty where there were none.

    """

    law: str
    switching: str
    values: Gains
    noise_torque: Array
    allowed: list[bool]
    verdicts: list[str]
    steps: dict[str, Array]
    period: float
    findings: tuple[Finding, ...] = ()
    options: tuple[Gains, ...] = ()
    trials: tuple[str, ...] = ()

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
    ka, peak, drives = bound.ka, bound.peak, torque_rate(found, bound.fastest.change, rate)
    texts, allowed = [], []
    for name, k, p, w in zip(found.joints, ka, peak, noise):
        fits = bool(w <= (k - p) / _ROOM * 1.001)
        allowed.append(fits)
        texts.append(_verdict(name, k, p, w, period, fits))
    delay, rates = found.timing.drive[0], drives.known
    resolution = _resolution(found, positions)
    steps = torque_steps(found, ka, noise, GAINS[1], drives.value)
    slow = (not isfinite(delay) or bool(longest_lag(found).max() > _SHORT_LAG * period)
            or bool((steps['implicit_observer'] > period * rates).any()))
    law = 'observer_feedback' if slow or not all(allowed) else 'chattering'
    shared: Gains = {
        'ka': (_usable(found, ka), bound.reason),
        'friction_level': (_usable(found, [max(0.0, x.coulomb.value or 0.0)
                                           for x in found.friction]), 'the Coulomb friction'),
        'torque_rate_limit': (_usable(found, drives.value), drives.reason)}
    why = _law_reason(found, law, all(allowed))
    laws = [(law, why)] if law == 'chattering' else []
    laws += [('observer_feedback', why if law != 'chattering' else 'the next one')]
    options = [_drive_values(found) | shared | _law_values(found, *one, resolution, slower)
               for one in laws for slower in (SLOWER if one[0] != 'chattering' else (1.0,))]
    noticed = (*run.outliers(), *run.break_away(found.joints), *bound.findings, *drives.findings,
               *inertia_findings(found, model, positions))
    return Recommendation(law, 'implicit_observer', options[0], noise, allowed, texts, steps,
                          period, noticed, tuple(options))


def _usable(found: Identification, values: Iterable[float]) -> list[float | None]:
    """Return gains, None for a joint that is not usable."""
    return [rounded(float(x), 6) if of.usable else None
            for x, of in zip(values, verdicts(found))]


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


def _verdict(name: str, ka: float, peak: float, noise: float, period: float, fits: bool) -> str:
    """Return whether a chattering term is possible, in numbers."""
    if not isfinite(noise):
        return f'{name}: no velocities, so their noise is not known'
    room = f'ka - |P| = {ka:.3g} - {peak:.3g} = {ka - peak:.3g} N*m'
    if fits:
        return (f'{name}: possible: two deviations, each M σ / h = {noise:.3g} N*m, are within '
                f'{room}')
    least = period * _ROOM * noise / max(ka - peak, 1e-12)
    return (f'{name}: not possible at h = {period:g} s: two deviations, each M σ / h = '
            f'{noise:.3g} N*m, exceed {room}; possible from control_period = {least:.2g} s on')


def _drive_values(found: Identification) -> Gains:
    """Return what the controller knows of the drives, with its reasons."""
    delay, lag, _ = found.timing.drive
    longest = float(longest_lag(found).max())
    bandwidth = min(_BANDWIDTH, _LAG / longest) if longest else _BANDWIDTH
    return {
        'input_delay': (int(delay) if isfinite(delay) else 0, _delay_reason(found)),
        'actuator_lag': ([rounded(x) for x in lag], 'the lag of the drives'),
        'switching': ('implicit_observer', 'estimates P; docs/theory.md'),
        'observer_bandwidth': (_rounded_down(bandwidth), (
            f'{_LAG:g} / T with the longest lag of the drives that is possible, '
            f'T = {longest:.3g} s' if longest else 'no lag of the drives is visible'))}


def _law_values(found: Identification, law: str, why: str, resolution: float, slower: float
                ) -> Gains:
    """Return a law and its own gains with their reasons, the pole as a part of the fastest."""
    if law == 'chattering':
        return {'law': (law, why)}
    period, lag, n = found.clock.period, found.timing.drive[1], len(found.joints)
    possible = found.timing.delays or {0: lag}
    late, slowest, most = max((lateness(float(x.max()), period, d), float(x.max()), d)
                              for d, x in possible.items())
    pole = _rounded_down(slower * largest_pole(late))
    text = (f'a double pole at p = {pole:g} rad/s, p (T + h (1 + d)) = {pole * late:.2g} ≤ '
            f'{SLOWNESS:g} with T = {slowest:.3g} s, h = {period:g} s, d = {most}')
    ratio = estimator_bandwidth(1.0, resolution)
    return {'law': (law, why), 'kp': ([pole ** 2] * n, text),
            'kv': ([2.0 * pole] * n, '2 p'),
            'estimator_bandwidth': (ratio * pole,
                                    f'{ratio:g} p for positions to {resolution:.2g} rad')}


def _delay_reason(found: Identification) -> str:
    """Return where input_delay comes from."""
    delay, delays = found.timing.drive[0], found.timing.delays
    if not isfinite(delay):
        return 'not known: the bag has no commands'
    if len(delays) > 1:
        return f'not identifiable: one of {", ".join(map(str, delays))}, this one most likely'
    return f'the torque of a sample moves the joints {int(delay)} samples later'


def _law_reason(found: Identification, law: str, quiet: bool) -> str:
    """Return why a law is recommended; `quiet` is whether noise leaves room for the term."""
    if law == 'chattering':
        return 'period, noise and drives allow a chattering term on every joint'
    if not isfinite(found.timing.drive[0]):
        return 'the delay of the torque is not known; this law needs no velocities'
    if longest_lag(found).max() > _SHORT_LAG * found.clock.period:
        return 'the drives have a lag, which this law inverts'
    if quiet:
        return 'the drives are slower than the steps of a chattering term; this law knows it'
    return ('the noise of the velocities leaves no room for a chattering term; this law observes '
            'the velocity from positions')


def _rounded_down(value: float) -> float:
    """Return a value with two digits, at most as large."""
    unit = 10.0 ** (floor(log10(value)) - 1)
    return rounded(float(np.floor(value / unit + 1e-9) * unit), 6)
