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

"""What was identified as values of a parameter file: friction for the plant, gains for the law."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import dataclasses
from typing import Any, NamedTuple

from ctc_chattering.analysis.result import simulate
from ctc_chattering.analysis.tables import rounded
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.findings import ALL_JOINTS, Estimate, Finding, Kind
from ctc_chattering.identification.friction import JointFriction
from ctc_chattering.identification.gains import GAINS, Gains, Recommendation
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import MeasuredPerturbation
from ctc_chattering.identification.weak_form import position_noise
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt

#: Part of the range and of the speed of the recorded motion that the new one takes.
_PART = 0.5
#: Duration of the run, and of its smooth start [s].
_DURATION, _START = 10.0, 2.0
#: Variance of the rounding to a step, by its square; noise of positions that is none [rad].
_STEP_NOISE, _LEAST_NOISE = 1.0 / 12.0, 1e-8
#: Frequencies of the joints [Hz]: least and most.
_SLOWEST, _FASTEST = 0.2, 1.0


def parameter_values(found: Identification, recommended: Recommendation, model: Model, q: Array,
                     shared: Mapping[str, Any], gains: tuple[Any, Any] | None
                     ) -> dict[str, dict[str, Any]]:
    """
    Return the values by node and parameter.

    Parameters
    ----------
    found : Identification
        What was identified.
    recommended : Recommendation
        What follows from it.
    model : Model
        The controller's; its limits of position are kept.
    q : ndarray, shape (N, n)
        Recorded positions [rad]: the motion of the reference is within them.
    shared : mapping
        Values of all nodes: model, description, gravity, locked.
    gains : (kp, kv) or None
        Of the recorded run.

    Raises
    ------
    CtcError
        If the friction of a joint is not known.

    """
    # Joint by joint, for long series.
    low, high = np.transpose([np.percentile(x, (2.0, 98.0)) for x in q.T])
    limits = getattr(model, 'position_limits', None) or [(-np.inf, np.inf)]
    start = np.clip(q[0], *np.array(limits).T)
    kp, kv = gains or GAINS
    controller: dict[str, Any] = {
        name: np.broadcast_to(gain, max(q.shape[1], np.size(gain))).tolist()
        for name, gain in (('kp', kp), ('kv', kv))}
    controller.update({name: value for name, (value, _) in recommended.values.items()})
    return {
        '/**': {'joint_names': list(found.joints), 'control_period': round(found.clock.period, 9),
                **shared},
        'plant': {'experiment': 'identified', 'pacing': 'lockstep', 'duration': _DURATION,
                  'initial_position': _rounded(start), **_plant(found, q)},
        'controller': controller,
        'reference': {'start_duration': _START, **_reference(found, low, high, model)}}


def _plant(found: Identification, q: Array) -> dict[str, Any]:
    """Return the friction, the sensors and the drives of the plant."""
    friction = found.friction
    coulomb = [max(0.0, x.coulomb.number()) for x in friction]
    delay, lag, _ = found.timing.drive
    values: dict[str, Any] = {
        'coulomb_friction': _rounded(coulomb),
        # What is not told from Coulomb friction is in it.
        'viscous_friction': _rounded([max(0.0, x.viscous.value or 0.0) for x in friction]),
        'fault_damping': _rounded([max(5.0 * x, 1e-3) for x in coulomb]),
        'input_delay': int(delay) if np.isfinite(delay) else 0,
        'actuator_lag': _rounded(lag), **_sensors(found, q)}
    if any(x.stribeck.value for x in friction):
        values['stribeck_friction'] = _rounded([max(x.stribeck.value or 0.0, 0.0)
                                                for x in friction])
        values['stribeck_velocity'] = _rounded([
            x.stribeck_velocity.value or 0.05 for x in friction])
    if any(x.load.value for x in friction):
        values['load_friction'] = _rounded(np.clip([x.load.value or 0.0 for x in friction],
                                                   0.0, 0.9))
    uneven = [_uneven(x, k) for x, k in zip(friction, coulomb)]
    if any(uneven):
        values['friction_asymmetry'] = _rounded(np.clip(uneven, -1.0, 1.0))
    if any(x.value is not None for x in found.rate):
        values['torque_rate_limit'] = [np.inf if x.value is None else rounded(x.value, 6)
                                       for x in found.rate]
    return values


def _sensors(found: Identification, q: Array) -> dict[str, Any]:
    """Return encoders and velocities: positions have a step, or noise; velocities may lack."""
    step = np.array([x.value or 0.0 for x in found.encoder])
    values: dict[str, Any] = {'encoder_resolution': _rounded(step)}
    noise = np.square(position_noise(q, found.clock.period)) - _STEP_NOISE * np.square(step)
    noise = np.sqrt(np.where(noise > _STEP_NOISE * np.square(step), noise, 0.0))
    if (noise > _LEAST_NOISE).any():
        values['position_noise'] = _rounded(noise)
    if any(x.value is None for x in found.noise):
        return {**values, 'velocity_sensor': 'difference'}
    return {**values, 'velocity_noise': _rounded([x.number() for x in found.noise])}


def _uneven(friction: JointFriction, coulomb: float) -> float:
    """Return which part of its Coulomb friction that of a joint differs by, if it clearly does."""
    offset = friction.offset
    clear = offset.value is not None and abs(offset.value) > max(offset.half, 0.01 * coulomb)
    return offset.number() / coulomb if coulomb and clear else 0.0


def _reference(found: Identification, low: Array, high: Array, model: Model) -> dict[str, Any]:
    """Return a sinusoid for each joint, within the recorded range and speed, and its limit."""
    amplitude = 0.5 * _PART * (high - low)
    limit = getattr(model, 'velocity_limits', None) or np.inf
    fastest = np.minimum(np.abs(found.data.velocity).max(axis=0), limit)
    n = len(amplitude)
    frequency = np.clip(_PART * fastest / (
        2.0 * np.pi * np.maximum(amplitude, 1e-6)), _SLOWEST, _FASTEST)
    frequency = np.minimum(frequency * np.linspace(0.8, 1.0, n), _FASTEST)
    amplitude = np.minimum(amplitude, _PART * np.asarray(limit) / (2.0 * np.pi * frequency))
    return {'center': _rounded(0.5 * (low + high)), 'amplitude': _rounded(amplitude),
            'frequency': _rounded(frequency, 3), 'phase': _rounded(0.5 * np.arange(n), 3)}


def _rounded(values: npt.ArrayLike, digits: int = 6) -> list[float]:
    """Return values to some digits."""
    return [rounded(x, digits) for x in np.asarray(values, float).tolist()]


Values = dict[str, dict[str, Any]]
#: Draws, unless another number is asked for: with machine code, and in plain Python.
COUNT, COUNT_PLAIN = 24, 8
#: Smooth start and duration [s], and the slowest motion [Hz]: with it all joints reverse.
_TRIAL_START, _TRIAL, _TRIAL_SLOWEST = 1.0, 2.5, 1.0
#: Part of M, C and G that may be wrong in any case, and at most.
_MODEL, _MOST = 0.05, 0.2
#: Frequencies of errors of the model and of what is not explained, as a disturbance [rad/s].
_UNEXPLAINED = (2.0, 20.0)
#: Part of the samples that may be at the limit of the torque, and how near that is.
_SATURATED, _NEAR = 0.02, 0.999
#: Part of the amplitude that an error may be, and steps of the encoder that are no error.
_TRACKS, _STEPS = 0.5, 3.0


class Draw(NamedTuple):
    """A robot within the intervals: in words, and values of plant and controller."""

    text: str
    values: Values


class _TriedRun(NamedTuple):
    """Errors of a run, shape (n,) [rad], or why there are none."""

    rms: Array | None
    saturated: Array
    failure: str


def trial_runs(found: Identification, run: MeasuredPerturbation, recommended: Recommendation,
               values_of: Callable[[Recommendation], Values],
               gains: tuple[Any, Any] | None = None, count: int = COUNT, seed: int = 1
               ) -> Recommendation:
    """
    Return the recommendation that survives all draws, with what the runs showed.

    Parameters
    ----------
    found, run
        What was identified, and P of the run.
    recommended : Recommendation
        With its options.
    values_of : callable
        Returns the parameter file of a recommendation.
    gains : (kp, kv) or None
        Of the recorded run.
    count, seed : int
        Number of draws, and their seed.

    """
    values = values_of(recommended)
    draws = list(draw_robots(found, run, values['plant'], count, seed))
    plain = _plain(values, gains or GAINS)
    usual = [_run(plain, draw) for draw in draws]
    said = []
    for option in recommended.options:
        tried = dataclasses.replace(recommended, values=option)
        text, survived = _tried(values_of(tried), draws, usual)
        said.append(f'{_name(option)}: {text}')
        if survived:
            return dataclasses.replace(tried, trials=tuple(said))
    return dataclasses.replace(recommended, trials=tuple(said), findings=(
        *recommended.findings, Finding(
            Kind.NO_NUMBER, ALL_JOINTS, 'no gains survive the trial runs: ' + said[-1],
            'settle first what makes intervals long, as the other reasons say; else record a '
            'longer motion of `ctc excite`')))


def setups_tried(recommended: Recommendation, values_of: Callable[[Recommendation], Values]
                 ) -> Iterator[Setup]:
    """Yield a setup with each law that trial runs may need; arguments as of `trial_runs`."""
    for option in recommended.options:
        values = values_of(dataclasses.replace(recommended, values=option))
        yield parameter_file.load(None, values)
    yield parameter_file.load(None, _plain(values, GAINS))


def _plain(values: Values, gains: tuple[Any, Any]) -> Values:
    """Return values with law `compensation` and these kp and kv."""
    n = len(values['/**']['joint_names'])
    return {**values, 'controller': {
        'law': 'compensation', 'input_delay': values['controller']['input_delay'],
        **{name: np.broadcast_to(x, max(n, np.size(x))).tolist()
           for name, x in zip(('kp', 'kv'), gains)}}}


def _name(option: Gains) -> str:
    """Return law and pole of an option."""
    law = str(option['law'][0])
    kv: Any = option['kv'][0] if 'kv' in option else None
    return law if kv is None else f'{law} with p = {0.5 * kv[0]:g} rad/s'


def draw_robots(found: Identification, run: MeasuredPerturbation, plant: Mapping[str, Any],
                count: int, seed: int) -> Iterator[Draw]:
    """
    Yield robots within the intervals.

    Parameters
    ----------
    found, run
        What was identified, and P of the run.
    plant : mapping
        The plant of the parameter file.
    count, seed : int
        Number of draws, and their seed.

    """
    rng = np.random.default_rng(seed)
    lag = found.timing.drive[1]
    drives = list(found.timing.delays.items()) or [(plant['input_delay'], np.tile(lag, (3, 1)))]
    part = _model_part(found)
    for k in range(count):
        # Corners of model and friction, for every delay in turn.
        model, friction = 2 * (k & 1) - 1, (k & 2) - 1
        samples, lags = drives[k // 4 % len(drives)]
        late = lags[0] + (lags[2] - lags[0]) * rng.uniform(size=len(lag))
        scale = 1.0 + part * model
        text = (f"delay {samples}, lag {late.max():.3g} s, model {scale:.3g} of the robot's, "
                f'friction {friction:+.2g} of its interval')
        yield Draw(text, {
            'plant': {**_friction(found, plant, friction), **_rate(found, plant),
                      'input_delay': int(samples), 'actuator_lag': late.tolist(),
                      'disturbance.amplitude': (run.tail + run.error).tolist(),
                      'disturbance.frequency': rng.uniform(*_UNEXPLAINED, len(lag)).tolist(),
                      'noise_seed': int(rng.integers(2 ** 31))},
            'controller': {'inertia_scale': scale, 'gravity_scale': scale}})


def _model_part(found: Identification) -> float:
    """Return by which part the model may be wrong: intervals of masses; the rest is in d(t)."""
    return min(_MOST, max([_MODEL, *(x.half for error, x in found.errors
                                     if x.value is not None and not error.unit)]))


def _friction(found: Identification, plant: Mapping[str, Any], at: float) -> dict[str, Any]:
    """Return friction at a place within its intervals, from -1 to 1."""
    def moved(name: str, numbers: Sequence[Estimate]) -> list[float]:
        return [max(0.0, x + at * of.half) for x, of in zip(plant[name], numbers)]
    values = {f'{name}_friction': moved(f'{name}_friction', [
        getattr(x, name) for x in found.friction])
        for name in ('coulomb', 'viscous', 'stribeck', 'load') if f'{name}_friction' in plant}
    if 'load_friction' in values:
        values['load_friction'] = [min(x, 0.9) for x in values['load_friction']]
    return values


def _rate(found: Identification, plant: Mapping[str, Any]) -> dict[str, Any]:
    """Return the least rate of the drives in its interval, where it is known."""
    if 'torque_rate_limit' not in plant:
        return {}
    return {'torque_rate_limit': [x if of.value is None else max(x - of.half, 0.1 * x)
                                  for x, of in zip(plant['torque_rate_limit'], found.rate)]}


def _tried(values: Values, draws: Sequence[Draw], usual: Sequence[_TriedRun]) -> tuple[str, bool]:
    """Return how many draws gains survive, in words, and whether all."""
    worst = 0.0
    for k, (draw, other) in enumerate(zip(draws, usual)):
        trial = _run(values, draw)
        failure = trial.failure or _worse(values, trial, other)
        if failure:
            return f'fails in draw {k + 1} of {len(draws)} ({draw.text}): {failure}', False
        assert trial.rms is not None
        worst = max(worst, float(trial.rms.max()))
    return (f'{len(draws)} of {len(draws)} draws survived; RMS errors at most {worst:.2g} rad'
            ), True


def _worse(values: Values, trial: _TriedRun, other: _TriedRun) -> str:
    """Return in which way a run is none to recommend; empty if it is."""
    names = values['/**']['joint_names']
    assert trial.rms is not None
    amplitude = np.array(_motion(values)['amplitude'])
    step = _STEPS * np.array(values['plant']['encoder_resolution'])
    most = np.maximum(_TRACKS * amplitude if other.rms is None else np.minimum(
        other.rms, _TRACKS * amplitude), step)
    for name, rms, limit, part in zip(names, trial.rms, most, trial.saturated):
        if not rms <= limit:
            return f'RMS error of {name} {rms:.2g} rad, `compensation` {limit:.2g} rad'
        if part > _SATURATED:
            return f'{name} is at its torque limit for {part:.0%} of the time'
    return ''


def _motion(values: Values) -> dict[str, Any]:
    """Return the reference: as fast as that of the file, with more reversals."""
    reference = values['reference']
    frequency = np.array(reference['frequency'])
    faster = np.maximum(frequency, _TRIAL_SLOWEST * np.linspace(0.8, 1.0, len(frequency)))
    return {**reference, 'frequency': faster.tolist(), 'start_duration': _TRIAL_START,
            'amplitude': (np.array(reference['amplitude']) * frequency / faster).tolist()}


def _run(values: Values, draw: Draw) -> _TriedRun:
    """Return a run from the centre of the motion."""
    motion = _motion(values)
    n = len(motion['center'])
    plant = {**values['plant'], **draw.values['plant'], 'duration': _TRIAL,
             'initial_position': motion['center']}
    controller = {**values['controller'], **draw.values['controller']}
    setup = _setup(values, plant, controller)
    try:
        run = simulate(setup, truth=True).run
    except CtcError as error:
        return _TriedRun(None, np.zeros(n), str(error))
    late = run.t >= _TRIAL_START
    model = model_of(setup.controller, setup.descriptions.get('controller', ''))
    limit = _NEAR * np.array(setup.controller.largest_torque(model.effort_limits))
    return _TriedRun(np.sqrt(np.square(run.q[late] - run.q_d[late]).mean(axis=0)),
                     (np.abs(run.tau[late]) >= limit).mean(axis=0), '')


def _setup(values: Values, plant: Mapping[str, Any], controller: Mapping[str, Any]) -> Setup:
    """Return a setup with the motion of trials, or that of the file if limits forbid it."""
    both = {'/**': values['/**'], 'plant': plant, 'controller': controller}
    try:
        return parameter_file.load(None, {**both, 'reference': _motion(values)})
    except CtcError:
        return parameter_file.load(None, {**both, 'reference': values['reference']})
