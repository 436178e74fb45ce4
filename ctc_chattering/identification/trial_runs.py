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

"""What was identified as values of a parameter file, and gains tried on robots like that."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import dataclasses
from typing import Any

from ctc_chattering.analysis.tables import rounded
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.findings import ALL_JOINTS, Finding, Reason, Severity
from ctc_chattering.identification.friction import JointFriction
from ctc_chattering.identification.gains import GAINS, Recommendation
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import MeasuredPerturbation
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.runs.score import Score, score
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
import numpy.typing as npt

#: Part of the range and of the speed of the recorded motion that the new one takes.
_PART = 0.5
#: Duration of the run, and of its smooth start [s].
_DURATION, _START = 10.0, 2.0
#: Variance of the rounding to a step, by its square.
_STEP_NOISE = 1.0 / 12.0
#: Frequencies of the first and the last joint [Hz].
_FREQUENCIES = (0.8, 1.0)
#: Part of the Coulomb friction below which its directions are alike; largest part of the load.
_LEAST_OFFSET, _MOST_LOAD = 0.01, 0.9
#: Stribeck velocity of a joint without Stribeck friction [rad/s].
_STRIBECK = 0.05
Values = dict[str, dict[str, Any]]


def parameter_values(identified: Identification, recommended: Recommendation, model: Model,
                     shared: Mapping[str, Any], gains: tuple[Any, Any] | None) -> Values:
    """
    Return the values by node and parameter.

    Parameters
    ----------
    identified : Identification
        What was identified; the motion of the reference is within its positions.
    recommended : Recommendation
        What follows from it.
    model : Model
        The controller's; its limits of position are kept.
    shared : mapping
        Values of all nodes: model, description, gravity, locked.
    gains : (kp, kv) or None
        Of the recorded run.

    Raises
    ------
    CtcError
        If the friction of a joint is not known.

    """
    limits = getattr(model, 'position_limits', None) or [(-np.inf, np.inf)]
    start = np.clip(identified.positions.poses[0], *np.array(limits).T)
    return {
        '/**': {'joint_names': list(identified.joints),
                'control_period': round(identified.clock.period, 9), **shared},
        'plant': {'experiment': 'identified', 'pacing': 'lockstep', 'duration': _DURATION,
                  'initial_position': _rounded(start), **_plant(identified)},
        'controller': {**_loop_gains(gains, len(start)),
                       **{name: value for name, (value, _) in recommended.values.items()}},
        'reference': {'start_duration': _START, **_reference(identified, model)}}


def _loop_gains(gains: tuple[Any, Any] | None, n: int) -> dict[str, Any]:
    """Return kp and kv of n joints."""
    return {name: np.broadcast_to(x, max(n, np.size(x))).tolist()
            for name, x in zip(('kp', 'kv'), gains or GAINS)}


def _plant(identified: Identification) -> dict[str, Any]:
    """Return the friction, the sensors and the drives of the plant."""
    friction, (delay, lag, _) = identified.friction, identified.timing.drive
    coulomb = np.array([max(0.0, x.coulomb.number()) for x in friction])
    viscous, stribeck, load = (
        np.array([getattr(x, name).value or 0.0 for x in friction])
        for name in ('viscous', 'stribeck', 'load'))
    offset = np.array([_clear_offset(x) for x in friction])
    step = np.array([x.value or 0.0 for x in identified.encoder])
    # Positions have a step, or noise.
    noise = np.square(identified.positions.noise) - _STEP_NOISE * np.square(step)
    noise = np.sqrt(np.where(noise > _STEP_NOISE * np.square(step), noise, 0.0))
    unknown = any(x.value is None and not x.absent for x in identified.noise)
    return {
        'coulomb_friction': _rounded(coulomb), 'viscous_friction': _rounded(viscous.clip(0.0)),
        'stribeck_friction': _rounded(np.maximum(stribeck, 0.0)),
        'load_friction': _rounded(load.clip(0.0, _MOST_LOAD)),
        'stribeck_velocity': _rounded([x.stribeck_velocity.value or _STRIBECK for x in friction]),
        'friction_asymmetry': _rounded(np.clip(
            offset / np.where(coulomb > 0.0, coulomb, np.inf), -1.0, 1.0)),
        'fault_damping': _rounded(np.maximum(5.0 * coulomb, 1e-3)),
        'input_delay': int(delay) if np.isfinite(delay) else 0, 'actuator_lag': _rounded(lag),
        'torque_rate_limit': [np.inf if x.value is None else rounded(x.value, 6)
                              for x in identified.rate],
        'encoder_resolution': _rounded(step), 'position_noise': _rounded(noise),
        **({'velocity_sensor': 'difference'} if unknown else
           {'velocity_noise': _rounded([x.number() for x in identified.noise])})}


def _clear_offset(friction: JointFriction) -> float:
    """Return half the difference of both directions [N·m]; 0 where it is not clear."""
    forwards, coulomb = friction.forwards.number(), friction.coulomb.number()
    offset = forwards - coulomb
    clear = max(friction.forwards.half, _LEAST_OFFSET * abs(coulomb))
    return offset if abs(offset) > clear else 0.0


def _reference(identified: Identification, model: Model) -> dict[str, Any]:
    """Return a sinusoid for each joint, within the recorded range and speed, and its limit."""
    (low, high), n = identified.positions.ends, len(identified.joints)
    limit = np.asarray(getattr(model, 'velocity_limits', None) or np.inf)
    fastest = np.minimum(np.abs(identified.fit.data.windows.velocity).max(axis=0), limit)
    frequency = np.linspace(*_FREQUENCIES, n)
    amplitude = _PART * np.minimum(0.5 * (high - low), fastest / (2.0 * np.pi * frequency))
    return {'center': _rounded(0.5 * (low + high)), 'amplitude': _rounded(amplitude),
            'frequency': _rounded(frequency, 3), 'phase': _rounded(0.5 * np.arange(n), 3)}


def _rounded(values: npt.ArrayLike, digits: int = 6) -> list[float]:
    """Return values to some digits."""
    return [rounded(x, digits) for x in np.asarray(values, float).tolist()]


#: Draws, unless another number is asked for: with machine code, and in plain Python.
COUNT, COUNT_PLAIN = 24, 8
#: Smooth start and duration [s]: in it all joints reverse. Drives begin without torque, and what
#: the arm falls by counts.
_TRIAL_START, _TRIAL = 1.0, 2.5
_WINDOW = 0.0, np.inf
#: Part of M, C and G that may be wrong in any case, and at most.
_MODEL, _MOST = 0.05, 0.2
#: Frequencies of errors of the model and of what is not explained, as a disturbance [rad/s].
_UNEXPLAINED = (2.0, 20.0)
#: Part of the samples that may be at the limit of the torque.
_SATURATED = 0.02
#: Part of the amplitude that an error may be, and steps of the encoder that are no error.
_TRACKS, _STEPS = 0.5, 3.0


def trial_runs(identified: Identification, run: MeasuredPerturbation, recommended: Recommendation,
               setups: Sequence[Setup], count: int = COUNT, seed: int = 1) -> Recommendation:
    """
    Return the recommendation that survives all draws, with what the runs showed.

    Parameters
    ----------
    identified, run
        What was identified, and P of the run.
    recommended : Recommendation
        With its options.
    setups : sequence of Setup
        As `setups_tried` returns them.
    count, seed : int
        Number of draws, and their seed.

    """
    *tried, plain = setups
    draws = list(draw_robots(identified, run, plain.plant, count, seed))
    largest = [_largest_error(plain, score(plain.changed(x), _WINDOW)) for _, x in draws]
    said: list[str] = []
    for option, setup in zip(recommended.options, tried):
        failure = ''
        for k, ((text, x), most) in enumerate(zip(draws, largest), 1):
            if failure := _failure(score(setup.changed(x), _WINDOW), most, identified.joints):
                failure = f'fails in draw {k} of {count} ({text}): {failure}'
                break
        kv: Any = option['kv'][0]
        said.append(f'p = {0.5 * kv[0]:g} rad/s: '
                    + (failure or f'{count} of {count} draws survived'))
        if not failure:
            return dataclasses.replace(recommended, values=option, trials=tuple(said))
    return dataclasses.replace(recommended, trials=tuple(said), findings=(
        *recommended.findings, Finding(
            Reason.GAINS, Severity.REFUSED, ALL_JOINTS,
            'no gains survive the trial runs: ' + said[-1],
            'settle first what makes intervals long, as the other reasons say; else record a '
            'longer motion of `ctc excite`')))


def setups_tried(recommended: Recommendation, values: Values,
                 gains: tuple[Any, Any] | None = None) -> list[Setup]:
    """
    Return the setup of each option and, last, that of `compensation`.

    Parameters
    ----------
    recommended : Recommendation
        With its options.
    values : dict
        What `parameter_values` returns for it.
    gains : (kp, kv) or None
        Of the recorded run.

    """
    plant, reference, mine = (values[name] for name in ('plant', 'reference', 'controller'))
    plain = {'law': 'compensation', 'input_delay': mine['input_delay'],
             **_loop_gains(gains, len(values['/**']['joint_names']))}
    short = {'plant': {**plant, 'duration': _TRIAL, 'initial_position': reference['center']},
             'reference': {**reference, 'start_duration': _TRIAL_START}}
    options = [{**mine, **{name: x for name, (x, _) in option.items()}}
               for option in recommended.options]
    return [parameter_file.load(None, {**values, **short, 'controller': controller})
            for controller in (*options, plain)]


def draw_robots(identified: Identification, run: MeasuredPerturbation, plant: PlantConfig,
                count: int, seed: int) -> Iterator[tuple[str, Values]]:
    """
    Yield robots at the ends of the intervals: in words, and values of plant and controller.

    Parameters
    ----------
    identified, run
        What was identified, and P of the run.
    plant : PlantConfig
        As identified.
    count, seed : int
        Number of draws, and their seed.

    """
    rng = np.random.default_rng(seed)
    lag = identified.timing.drive.lag
    drives = list(identified.timing.delays.items()) or [(plant.input_delay, np.tile(lag, (3, 1)))]
    part = _model_doubt(identified)
    for k in range(count):
        # Corners of model and friction, for every delay in turn.
        model, at = 2 * (k & 1) - 1, (k & 2) - 1
        samples, lags = drives[k // 4 % len(drives)]
        late = lags[0] + (lags[2] - lags[0]) * rng.uniform(size=len(lag))
        scale = 1.0 + part * model
        friction = {f'{name}_friction': [
            min(max(0.0, x + at * getattr(of, name).half), 0.9 if name == 'load' else np.inf)
            for x, of in zip(getattr(plant, f'{name}_friction'), identified.friction)]
            for name in ('coulomb', 'viscous', 'stribeck', 'load')}
        rate = [x if of.value is None else max(x - of.half, 0.1 * x)
                for x, of in zip(plant.torque_rate_limit, identified.rate)]
        text = (f"delay {samples}, lag {late.max():.3g} s, model {scale:.3g} of the robot's, "
                f'friction {at:+.2g} of its interval')
        yield text, {
            'plant': {**friction, 'torque_rate_limit': rate,
                      'input_delay': int(samples), 'actuator_lag': late.tolist(),
                      'disturbance.amplitude': (run.tail + run.error).tolist(),
                      'disturbance.frequency': rng.uniform(*_UNEXPLAINED, len(lag)).tolist(),
                      'noise_seed': int(rng.integers(2 ** 31))},
            'controller': {'inertia_scale': scale, 'gravity_scale': scale}}


def _model_doubt(identified: Identification) -> float:
    """Return by which part the model may be wrong: by the intervals of its bodies."""
    fit = identified.fit
    parts = [_MODEL]
    for joint in np.flatnonzero(fit.data.moving).tolist():
        columns = fit.unknowns.columns(fit.data, joint)
        columns[:, fit.unknowns.body_count:] = 0.0
        half = fit.half_interval(columns[fit.data.used[:, joint]])
        parts.append(float(np.median(half) / fit.data.deviation[joint]))
    return min(_MOST, max(parts))


def _largest_error(setup: Setup, usual: Score) -> Array:
    """Return the RMS errors that are allowed, shape (n,) [rad]: those of `compensation`."""
    amplitude = _TRACKS * np.array(setup.reference.amplitude)
    return np.maximum(amplitude if usual.failure else np.minimum(usual.rms, amplitude),
                      _STEPS * np.array(setup.plant.encoder_resolution))


def _failure(trial: Score, most: Array, joints: tuple[str, ...]) -> str:
    """Return in which way a run is none to recommend; empty if it is."""
    if trial.failure:
        return trial.failure
    i = int(np.argmax(np.divide(trial.rms, most)))
    if trial.rms[i] > most[i]:
        return f'RMS error of {joints[i]} {trial.rms[i]:.2g} rad, `compensation` {most[i]:.2g} rad'
    if (trial.saturated or 0.0) > _SATURATED:
        return f'a joint is at its torque limit for {trial.saturated:.0%} of the time'
    return ''
