"""
Gains that follow from what was identified, each with the numbers it follows from.

The conditions are those of `docs/theory.md`: ka above |P|, room between ka and |P| for the noise
M σ / h that enters the chattering term, ω T ≤ 0.3 for the observer, and those of
`control/recommended_gains.py` for `observer_feedback`.
"""

from __future__ import annotations

import dataclasses
from math import floor, isfinite, log10

from ctc_chattering.analysis.number_format import rounded
from ctc_chattering.control.recommended_gains import (
    estimator_bandwidth,
    largest_pole,
    lateness,
    SLOWNESS,
)
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.regression.identify import Identification
from ctc_chattering.identification.regression.weak_form import position_noise
from ctc_chattering.identification.report.perturbation import MeasuredPerturbation
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: ka over the largest |P|.
_MARGIN = 1.2
#: Deviations of noise that must have room between |P| and ka.
_ROOM = 2.0
#: Largest product of observer bandwidth and lag, and bandwidth without a lag [rad/s].
_LAG, _BANDWIDTH = 0.3, 1200.0
#: A lag above this part of a period, or a delay, asks for observer_feedback.
_SHORT_LAG = 0.25
#: Half the boundary layer that steps are computed with [rad/s].
_BOUNDARY_LAYER = 0.05
#: Positions at which inertias are looked up.
_POSITIONS = 200
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

    """

    law: str
    switching: str
    values: dict[str, tuple[object, str]]
    noise_torque: Array
    allowed: list[bool]
    verdicts: list[str]
    steps: dict[str, Array]
    period: float


def recommend(found: Identification, run: MeasuredPerturbation, model: Model, positions: Array
              ) -> Recommendation:
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

    """
    period, peak = found.clock.period, run.peak
    noise = _noise_torque(found, model, positions)
    ka = np.array([_rounded_up(_MARGIN * p) for p in peak])
    verdicts, allowed = [], []
    for name, k, p, w in zip(found.joints, ka, peak, noise):
        fits = bool(w <= (k - p) / _ROOM * 1.001)
        allowed.append(fits)
        verdicts.append(_verdict(name, k, p, w, period, fits))
    delay, lag, _ = found.timing.drive
    slow = not isfinite(delay) or bool(lag.max() > _SHORT_LAG * period)
    law = 'observer_feedback' if slow or not all(allowed) else 'chattering'
    values = _values(found, law, ka, peak, _resolution(found, positions))
    kv = values['kv'][0][0] if 'kv' in values else GAINS[1]  # type: ignore[index]
    return Recommendation(law, 'implicit_observer', values, noise, allowed, verdicts,
                          _steps(found, ka, noise, kv), period)


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
               *(x.or_zero() for x in found.encoder))


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
            f'{noise:.3g} N*m, exceed {room}; it is from control_period = {least:.2g} s on')


def _values(found: Identification, law: str, ka: Array, peak: Array, resolution: float
            ) -> dict[str, tuple[object, str]]:
    """Return the parameters of the controller with their reasons."""
    delay, lag, _ = found.timing.drive
    whole, period = int(delay) if isfinite(delay) else 0, found.clock.period
    values: dict[str, tuple[object, str]] = {
        'law': (law, _law_reason(found, law)),
        'ka': ([float(x) for x in ka], _ka_reason(found, peak)),
        'input_delay': (whole, _delay_reason(found)),
        'switching': ('implicit_observer', 'estimates P; docs/theory.md')}
    possible = found.timing.delays or {whole: lag}
    longest = max(float(x.max()) for x in possible.values())
    bandwidth = min(_BANDWIDTH, _LAG / longest) if longest else _BANDWIDTH
    values['observer_bandwidth'] = (_rounded_down(bandwidth), (
        f'{_LAG:g} / T with the longest lag of the drives that is possible, T = {longest:.3g} s'
        if longest else 'no lag of the drives shows'))
    values['friction_level'] = ([max(0.0, x.coulomb.or_zero()) for x in found.friction],
                                'the Coulomb friction')
    values['actuator_lag'] = ([rounded(x) for x in lag], 'the lag of the drives')
    if law == 'observer_feedback':
        late, slowest, most = max((lateness(float(x.max()), period, d), float(x.max()), d)
                                  for d, x in possible.items())
        pole = _rounded_down(largest_pole(late))
        why = (f'a double pole at p = {pole:g} rad/s, p (T + h (1 + d)) = {pole * late:.2g} ≤ '
               f'{SLOWNESS:g} with T = {slowest:.3g} s, h = {period:g} s, d = {most}')
        values['kp'] = ([pole ** 2] * len(ka), why)
        values['kv'] = ([2.0 * pole] * len(ka), why)
        ratio = estimator_bandwidth(1.0, resolution)
        values['estimator_bandwidth'] = (
            ratio * pole, f'{ratio:g} p for positions to {resolution:.2g} rad')
    return values


def _ka_reason(found: Identification, peak: Array) -> str:
    """Return where ka comes from, and for which joints the run does not show it."""
    text = 'the largest |P| of the run, ' + ', '.join(
        f'{p:.3g} N*m' for p in peak) + f', times {_MARGIN:g}'
    unknown = [name for name, x in zip(found.joints, found.friction) if x.coulomb.value is None]
    if unknown:
        text += f'; friction of {", ".join(unknown)} is not known, so its ka is only a least value'
    return text


def _delay_reason(found: Identification) -> str:
    """Return where input_delay comes from."""
    delay, delays = found.timing.drive[0], found.timing.delays
    if not isfinite(delay):
        return 'not known: the bag has no commands'
    if len(delays) > 1:
        return f'not identifiable: one of {", ".join(map(str, delays))}, this one most likely'
    return f'the torque of a sample moves the joints {int(delay)} samples later'


def _law_reason(found: Identification, law: str) -> str:
    """Return why a law is recommended."""
    if law == 'chattering':
        return 'period, noise and drives allow a chattering term on every joint'
    if not isfinite(found.timing.drive[0]):
        return 'the delay of the torque is not known; this law needs no velocities'
    if found.timing.drive[1].max() > _SHORT_LAG * found.clock.period:
        return 'the drives have a lag, which this law inverts'
    return ('the noise of the velocities leaves no room for a chattering term; this law observes '
            'the velocity from positions')


def _steps(found: Identification, ka: Array, noise: Array, kv: float) -> dict[str, Array]:
    """
    Return the largest torque step per period of each switching, shape (n,) [N·m].

    With `sign` the term jumps by 2 ka; with `boundary_layer` by ka / φ times the noise of v; with
    the others by what the friction changes at a reversal, twice Coulomb and Stribeck friction,
    and by the noise M σ / h, but never by more than 2 ka. The noise of the feedback, M kv σ, comes
    to all of them. Six deviations of noise are counted.
    """
    most = 2.0 * ka
    loud = np.where(np.isfinite(noise), 6.0 * noise, most)
    sigma = np.array([x.value if x.value is not None else np.inf for x in found.noise])
    feedback = 6.0 * found.clock.period * kv * np.where(np.isfinite(noise), noise, 0.0)
    friction = np.array([2.0 * (max(abs(x.forwards.or_zero()), abs(x.backwards.or_zero()))
                                + x.stribeck.or_zero()) for x in found.friction])
    soft = ka / _BOUNDARY_LAYER * np.where(np.isfinite(sigma), 6.0 * sigma, np.inf)
    both = np.minimum(most, friction + loud)
    steps = {'sign': most, 'boundary_layer': np.minimum(most, soft), 'implicit': both,
             'implicit_observer': both}
    return {name: steps.get(name, most) + feedback for name in SWITCHINGS}


def _rounded_up(value: float) -> float:
    """Return a value with three digits, at least as large."""
    if value <= 0.0:
        return 0.0
    unit = 10.0 ** (floor(log10(value)) - 2)
    return rounded(float(np.ceil(value / unit - 1e-9) * unit), 6)


def _rounded_down(value: float) -> float:
    """Return a value with two digits, at most as large."""
    unit = 10.0 ** (floor(log10(value)) - 1)
    return rounded(float(np.floor(value / unit + 1e-9) * unit), 6)
