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

"""Parameter file of an identified robot, and trials of gains on simulated robots like it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import dataclasses
from typing import Any, NamedTuple

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.findings import ALL_JOINTS, Finding, Reason, Severity
from ctc_chattering.identification.friction import JointFriction
from ctc_chattering.identification.gains import GAINS, Recommendation
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import MeasuredPerturbation
from ctc_chattering.number_format import round_number
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.runs.score import Score, score
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
import numpy.typing as npt

#: Part of the range and of the speed of the recorded motion that the new one takes.
MOTION_PART = 0.5
#: Duration of the run [s].
RUN_S = 10.0
#: Smooth start of the run [s].
START_S = 2.0
#: Variance of the rounding to a step, by its square.
STEP_NOISE = 1.0 / 12.0
#: Frequency of the first joint [Hz].
FIRST_FREQUENCY = 0.8
#: Frequency of the last joint [Hz].
LAST_FREQUENCY = 1.0
#: Part of the Coulomb friction below which its directions are alike.
LEAST_OFFSET = 0.01
#: Largest friction of the load as a part of it.
MOST_LOAD = 0.9
#: Stribeck velocity of a joint without Stribeck friction [rad/s].
STRIBECK_VELOCITY = 0.05
#: Robots that are tried, with machine code, unless another number is asked for.
COUNT = 24
#: Robots that are tried in plain Python.
COUNT_PLAIN = 8
#: Smooth start of a trial [s].
TRIAL_START_S = 1.0
#: Duration of a trial [s]. In it all joints reverse. Drives begin without torque, and what the arm
#: falls by counts.
TRIAL_S = 2.5
#: Part of M, C and G that may be wrong in any case.
MODEL_DOUBT = 0.05
#: Largest such part.
MOST_MODEL_DOUBT = 0.2
#: Frequencies of errors of the model and of unexplained torque, as a disturbance [rad/s].
UNEXPLAINED_FREQUENCIES = (2.0, 20.0)
#: Part of the samples that may be at the limit of the torque.
SATURATED = 0.02
#: Part of the amplitude that an error may be.
TRACKING_PART = 0.5
#: Steps of the encoder that are no error.
ENCODER_STEPS = 3.0
#: Time in which a trial is judged [s].
WHOLE_TRIAL = (0.0, np.inf)
Values = dict[str, dict[str, Any]]


def parameter_values(identified: Identification, recommended: Recommendation, model: Model,
                     shared: Mapping[str, Any], gains: tuple[Any, Any] | None) -> Values:
    """
    Return the values by node and parameter.

    Parameters
    ----------
    identified : Identification
        As of `identify`; the motion of the reference is within its positions.
    recommended : Recommendation
        Gains for it.
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
        'plant': {'experiment': 'identified', 'pacing': 'lockstep', 'duration': RUN_S,
                  'initial_position': _rounded(start), **_plant(identified)},
        'controller': {**_loop_gains(gains, len(start)),
                       **{name: value for name, (value, _) in recommended.values.items()}},
        'reference': {'start_duration': START_S, **_reference(identified, model)}}


def _loop_gains(gains: tuple[Any, Any] | None, n: int) -> dict[str, Any]:
    """Return kp and kv of n joints."""
    return {name: np.broadcast_to(x, max(n, np.size(x))).tolist()
            for name, x in zip(('kp', 'kv'), gains or GAINS)}


def _plant(identified: Identification) -> dict[str, Any]:
    """Return the friction, the sensors and the drives of the plant."""
    friction, (delay, lag, _) = identified.friction, identified.timing.drive
    coulomb = np.array([max(0.0, x.coulomb.number()) for x in friction])
    viscous = np.array([x.viscous.value or 0.0 for x in friction])
    stribeck = np.array([x.stribeck.value or 0.0 for x in friction])
    load = np.array([x.load.value or 0.0 for x in friction])
    offset = np.array([_clear_offset(x) for x in friction])
    asymmetry = offset / np.where(coulomb > 0.0, coulomb, np.inf)
    return {
        'coulomb_friction': _rounded(coulomb),
        'viscous_friction': _rounded(viscous.clip(0.0)),
        'stribeck_friction': _rounded(stribeck.clip(0.0)),
        'load_friction': _rounded(load.clip(0.0, MOST_LOAD)),
        'stribeck_velocity': _rounded(
            [x.stribeck_velocity.value or STRIBECK_VELOCITY for x in friction]),
        'friction_asymmetry': _rounded(asymmetry.clip(-1.0, 1.0)),
        'fault_damping': _rounded(np.maximum(5.0 * coulomb, 1e-3)),
        'input_delay': int(delay) if np.isfinite(delay) else 0,
        'actuator_lag': _rounded(lag),
        'torque_rate_limit': [np.inf if x.value is None else round_number(x.value, 6)
                              for x in identified.rate],
        **_sensors(identified)}


def _sensors(identified: Identification) -> dict[str, Any]:
    """Return the noise of the plant's positions, which have a step or noise, and velocities."""
    step = np.array([x.value or 0.0 for x in identified.encoder])
    variance = np.square(identified.positions.noise) - STEP_NOISE * np.square(step)
    noise = np.sqrt(np.where(variance > STEP_NOISE * np.square(step), variance, 0.0))
    positions = {'encoder_resolution': _rounded(step), 'position_noise': _rounded(noise)}
    if any(x.value is None and not x.absent for x in identified.noise):
        return {**positions, 'velocity_sensor': 'difference'}
    return {**positions, 'velocity_noise': _rounded([x.number() for x in identified.noise])}


def _clear_offset(friction: JointFriction) -> float:
    """Return half the difference of both directions [N·m]; 0 where it is not clear."""
    coulomb = friction.coulomb.number()
    offset = friction.forwards.number() - coulomb
    least = max(friction.forwards.half, LEAST_OFFSET * abs(coulomb))
    return offset if abs(offset) > least else 0.0


def _reference(identified: Identification, model: Model) -> dict[str, Any]:
    """Return a sinusoid for each joint, within the recorded range and speed, and its limit."""
    (low, high), n = identified.positions.ends, len(identified.joints)
    limit = np.asarray(getattr(model, 'velocity_limits', None) or np.inf)
    fastest = np.minimum(np.abs(identified.fit.data.windows.velocity).max(axis=0), limit)
    frequency = np.linspace(FIRST_FREQUENCY, LAST_FREQUENCY, n)
    amplitude = MOTION_PART * np.minimum(0.5 * (high - low), fastest / (2.0 * np.pi * frequency))
    return {'center': _rounded(0.5 * (low + high)), 'amplitude': _rounded(amplitude),
            'frequency': _rounded(frequency, 3), 'phase': _rounded(0.5 * np.arange(n), 3)}


def _rounded(values: npt.ArrayLike, digits: int = 6) -> list[float]:
    """Return values to some digits."""
    return [round_number(x, digits) for x in np.asarray(values, float).tolist()]


def trial_runs(identified: Identification, run: MeasuredPerturbation, recommended: Recommendation,
               setups: Sequence[Setup], count: int = COUNT, seed: int = 1) -> Recommendation:
    """
    Return the recommendation that survives all draws, with the results of the runs.

    Parameters
    ----------
    identified, run
        As of `identify`, and P of the run.
    recommended : Recommendation
        With its options.
    setups : sequence of Setup
        As `setups_tried` returns them.
    count, seed : int
        Number of draws, and their seed.

    """
    *tried, plain = setups
    draws = list(draw_robots(identified, run, plain.plant, count, seed))
    allowed = [_allowed_error(plain, score(plain.changed(draw.values), WHOLE_TRIAL))
               for draw in draws]
    trials: list[str] = []
    for option, setup in zip(recommended.options, tried):
        kv: Any = option['kv'][0]
        pole = f'p = {0.5 * kv[0]:g} rad/s'
        failure = ''
        for k, (draw, errors) in enumerate(zip(draws, allowed), 1):
            trial = score(setup.changed(draw.values), WHOLE_TRIAL)
            failure = _failure(trial, errors, identified.joints)
            if failure:
                trials.append(f'{pole}: fails in draw {k} of {count} ({draw}): {failure}')
                break
        if not failure:
            trials.append(f'{pole}: {count} of {count} draws survived')
            return dataclasses.replace(recommended, values=option, trials=tuple(trials))
    refusal = Finding(
        Reason.GAINS, Severity.REFUSED, ALL_JOINTS,
        f'No gains survive the trial runs: {trials[-1]}',
        'Settle first what makes intervals long, as the other reasons say; else record a longer '
        'motion of `ctc excite`')
    return dataclasses.replace(
        recommended, trials=tuple(trials), findings=(*recommended.findings, refusal))


def setups_tried(recommended: Recommendation, values: Values,
                 gains: tuple[Any, Any] | None = None) -> list[Setup]:
    """
    Return the setup of each option and, last, that of `compensation`.

    Parameters
    ----------
    recommended : Recommendation
        With its options.
    values : dict
        As `parameter_values` returns it.
    gains : (kp, kv) or None
        Of the recorded run.

    """
    plant, reference, loop = (values[name] for name in ('plant', 'reference', 'controller'))
    plain = {'law': 'compensation', 'input_delay': loop['input_delay'],
             **_loop_gains(gains, len(values['/**']['joint_names']))}
    short = {'plant': {**plant, 'duration': TRIAL_S, 'initial_position': reference['center']},
             'reference': {**reference, 'start_duration': TRIAL_START_S}}
    options = [{**loop, **{name: x for name, (x, _) in option.items()}}
               for option in recommended.options]
    return [parameter_file.load(None, {**values, **short, 'controller': controller})
            for controller in (*options, plain)]


class Draw(NamedTuple):
    """
    A robot within the intervals.

    Attributes
    ----------
    delay : int
        Of its drives [samples].
    lag : ndarray, shape (n,)
        Of its drives [s].
    model_scale : float
        Factor of M, C and G that the controller has.
    friction_end : int
        End of the interval of friction, -1 or 1.
    values : dict
        Values of plant and controller.

    """

    delay: int
    lag: Array
    model_scale: float
    friction_end: int
    values: Values

    def __str__(self) -> str:
        """Return it in words."""
        return (f'delay {self.delay}, lag {self.lag.max():.3g} s, model {self.model_scale:.3g} of '
                f"the robot's, friction {self.friction_end:+d} of its interval")


def draw_robots(identified: Identification, run: MeasuredPerturbation, plant: PlantConfig,
                count: int, seed: int) -> Iterator[Draw]:
    """
    Yield robots at the ends of the intervals.

    Parameters
    ----------
    identified, run
        As of `identify`, and P of the run.
    plant : PlantConfig
        As identified.
    count, seed : int
        Number of draws, and their seed.

    """
    rng = np.random.default_rng(seed)
    lag = identified.timing.drive.lag
    drives = list(identified.timing.delays.items()) or [(plant.input_delay, np.tile(lag, (3, 1)))]
    bodies = identified.bodies
    doubt = min(max(MODEL_DOUBT, bodies.uncertainty if bodies else 0.0), MOST_MODEL_DOUBT)
    for k in range(count):
        # Corners of model and friction, for every delay in turn.
        scale, friction_end = 1.0 + doubt * (2 * (k & 1) - 1), (k & 2) - 1
        delay, lags = drives[k // 4 % len(drives)]
        lag = lags[0] + (lags[2] - lags[0]) * rng.uniform(size=len(lag))
        rate = [limit if estimate.value is None else max(limit - estimate.half, 0.1 * limit)
                for limit, estimate in zip(plant.torque_rate_limit, identified.rate)]
        frequency = rng.uniform(*UNEXPLAINED_FREQUENCIES, len(lag))
        yield Draw(delay, lag, scale, friction_end, {
            'plant': {**_friction_at(identified, plant, friction_end), 'torque_rate_limit': rate,
                      'input_delay': int(delay), 'actuator_lag': lag.tolist(),
                      'disturbance.amplitude': (run.tail + run.error).tolist(),
                      'disturbance.frequency': frequency.tolist(),
                      'noise_seed': int(rng.integers(2 ** 31))},
            'controller': {'inertia_scale': scale, 'gravity_scale': scale}})


def _friction_at(identified: Identification, plant: PlantConfig, end: int) -> dict[str, Any]:
    """Return the plant's friction at an end of its intervals, -1 or 1."""
    values = {}
    for name in ('coulomb', 'viscous', 'stribeck', 'load'):
        most = MOST_LOAD if name == 'load' else np.inf
        middle = getattr(plant, f'{name}_friction')
        halves = [getattr(friction, name).half for friction in identified.friction]
        values[f'{name}_friction'] = [min(max(0.0, x + end * half), most)
                                      for x, half in zip(middle, halves)]
    return values


def _allowed_error(setup: Setup, usual: Score) -> Array:
    """Return the RMS errors that are allowed, shape (n,) [rad]: those of `compensation`."""
    amplitude = TRACKING_PART * np.array(setup.reference.amplitude)
    tracked = amplitude if usual.failure else np.minimum(usual.rms, amplitude)
    return np.maximum(tracked, ENCODER_STEPS * np.array(setup.plant.encoder_resolution))


def _failure(trial: Score, allowed: Array, joints: tuple[str, ...]) -> str:
    """Return why a run is none to recommend; empty if it is."""
    if trial.failure:
        return trial.failure
    joint = int(np.argmax(np.divide(trial.rms, allowed)))
    if trial.rms[joint] > allowed[joint]:
        return (f'RMS error of {joints[joint]} {trial.rms[joint]:.2g} rad, `compensation` '
                f'{allowed[joint]:.2g} rad')
    if (trial.saturated or 0.0) > SATURATED:
        return f'a joint is at its torque limit for {trial.saturated:.0%} of the time'
    return ''
