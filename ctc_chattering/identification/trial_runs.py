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
Parameter file of an identified robot, and trials of its gains.

`identified_robot` writes the file, and runs the trials before. In a trial, model and friction are
at ends of their intervals, and the controller has the recommended gains. The gains survive if no
error is above that of law `compensation`. Else the next more careful option is tried.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import dataclasses
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.findings import Finding, Reason, Severity
from ctc_chattering.identification.friction import JointFriction
from ctc_chattering.identification.gains import (
    Draw,
    FailedDraw,
    GainTrial,
    pole_of,
    Recommendation,
)
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import MeasuredPerturbation
from ctc_chattering.number_format import round_number
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.runs.score import Score, score
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
import numpy.typing as npt

#: Gains of the laws of the paper, where those of the recorded run are not known.
PAPER_GAINS = (100.0, 50.0)
#: Variance of the rounding to a step, over its square.
STEP_VARIANCE = 1.0 / 12.0
#: Largest friction of the load, as a part of the load.
MAX_LOAD_FRICTION = 0.9
#: Time in which a trial is judged [s].
WHOLE_TRIAL = (0.0, np.inf)
#: Robots that are tried with machine code.
COMPILED_COUNT = 24
#: Robots that are tried in plain Python.
PLAIN_COUNT = 8
Values = dict[str, dict[str, Any]]


@dataclasses.dataclass(frozen=True)
class MotionOfFile:
    """Motion of the parameter file: a sinusoid for each joint."""

    #: Part of the range and of the speed of the recorded motion.
    range_part: float = 0.5
    duration_s: float = 10.0
    #: Smooth start.
    start_s: float = 2.0
    first_frequency_hz: float = 0.8
    last_frequency_hz: float = 1.0


@dataclasses.dataclass(frozen=True)
class TrialLimits:
    """Trials, and the errors that gains may have in them."""

    #: All joints reverse in this time. Drives begin without torque, and a fall of the arm counts.
    duration_s: float = 2.5
    start_s: float = 1.0
    #: Smallest error of M, C and G, as a part of them.
    min_model_error: float = 0.05
    max_model_error: float = 0.2
    #: Frequencies of errors of the model and of unexplained torque, as a disturbance [rad/s].
    unexplained_frequencies: tuple[float, float] = (2.0, 20.0)
    #: Part of the samples that may be at the limit of the torque.
    max_saturated: float = 0.02
    #: Errors as a part of the amplitude: too large for any gains, and small enough for all. The
    #: recorded gains may be those of a simulation, and track better than any law needs to.
    max_tracking_error: float = 0.5
    min_tracking_error: float = 0.05
    #: Encoder steps that are no error.
    min_error_steps: float = 3.0


MOTION = MotionOfFile()
TRIAL = TrialLimits()


def parameter_values(
    identified: Identification,
    recommended: Recommendation,
    model: Model,
    shared: Mapping[str, Any],
    gains: tuple[Any, Any] | None,
) -> Values:
    """
    Return the values by node and parameter.

    Parameters
    ----------
    identified : Identification
        Numbers of a run. The motion of the reference is within its positions.
    recommended : Recommendation
        Gains for it.
    model : Model
        The controller's. Its limits of position are kept.
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
        '/**': {
            'joint_names': list(identified.joints),
            'control_period': round(identified.clock.period, 9),
            **shared,
        },
        'plant': {
            'experiment': 'identified',
            'pacing': 'lockstep',
            'duration': MOTION.duration_s,
            'initial_position': _rounded(start),
            **_plant(identified),
        },
        'controller': {**_loop_gains(gains, len(start)), **recommended.values},
        'reference': {'start_duration': MOTION.start_s, **_reference(identified, model)},
    }


def _loop_gains(gains: tuple[Any, Any] | None, n: int) -> dict[str, Any]:
    """Return kp and kv of n joints."""
    return {
        name: np.broadcast_to(x, max(n, np.size(x))).tolist()
        for name, x in zip(('kp', 'kv'), gains or PAPER_GAINS)
    }


def _plant(identified: Identification) -> dict[str, Any]:
    """Return the friction, the sensors and the drives of the plant."""
    friction, drive = identified.friction, identified.timing.drive
    coulomb = np.array([max(0.0, x.coulomb.number()) for x in friction])

    def numbers(name: str) -> Array:
        return np.array([getattr(x, name).value or 0.0 for x in friction])

    offset = np.array([_clear_offset(x) for x in friction])
    asymmetry = offset / np.where(coulomb > 0.0, coulomb, np.inf)
    velocity = numbers('stribeck_velocity')
    return {
        'coulomb_friction': _rounded(coulomb),
        'viscous_friction': _rounded(numbers('viscous').clip(0.0)),
        'stribeck_friction': _rounded(numbers('stribeck').clip(0.0)),
        'load_friction': _rounded(numbers('load').clip(0.0, MAX_LOAD_FRICTION)),
        # A joint without Stribeck friction has a usual velocity.
        'stribeck_velocity': _rounded(np.where(velocity == 0.0, 0.05, velocity)),
        'friction_asymmetry': _rounded(asymmetry.clip(-1.0, 1.0)),
        'fault_damping': _rounded(np.maximum(5.0 * coulomb, 1e-3)),
        'input_delay': int(drive.delay) if np.isfinite(drive.delay) else 0,
        'actuator_lag': _rounded(drive.lag),
        'torque_rate_limit': [
            np.inf if x.value is None else round_number(x.value, 6) for x in identified.rate
        ],
        **_sensors(identified),
    }


def _sensors(identified: Identification) -> dict[str, Any]:
    """Return the step or noise of positions, and noise of velocities."""
    step = np.array([x.value or 0.0 for x in identified.encoder])
    rounding = STEP_VARIANCE * np.square(step)
    variance = np.square(identified.positions.noise) - rounding
    noise = np.sqrt(np.where(variance > rounding, variance, 0.0))
    positions = {'encoder_resolution': _rounded(step), 'position_noise': _rounded(noise)}
    if any(x.value is None and not x.absent for x in identified.noise):
        return {**positions, 'velocity_sensor': 'difference'}
    return {**positions, 'velocity_noise': _rounded([x.number() for x in identified.noise])}


def _clear_offset(friction: JointFriction) -> float:
    """
    Return half the difference of both directions [N·m].

    It is 0 where it is not clear.
    """
    coulomb = friction.coulomb.number()
    offset = friction.forwards.number() - coulomb
    smallest = max(friction.forwards.half, 0.01 * abs(coulomb))
    return offset if abs(offset) > smallest else 0.0


def _reference(identified: Identification, model: Model) -> dict[str, Any]:
    """Return a sinusoid for each joint within its recorded range."""
    (low, high), n = identified.positions.ends, len(identified.joints)
    limit = np.asarray(getattr(model, 'velocity_limits', None) or np.inf)
    fastest = np.minimum(np.abs(identified.fit.data.windows.velocity).max(axis=0), limit)
    frequency = np.linspace(MOTION.first_frequency_hz, MOTION.last_frequency_hz, n)
    largest = np.minimum(0.5 * (high - low), fastest / (2.0 * np.pi * frequency))
    amplitude = MOTION.range_part * largest
    return {
        'center': _rounded(0.5 * (low + high)),
        'amplitude': _rounded(amplitude),
        'frequency': _rounded(frequency, 3),
        'phase': _rounded(0.5 * np.arange(n), 3),
    }


def _rounded(values: npt.ArrayLike, digits: int = 6) -> list[float]:
    """Return values to some digits."""
    return [round_number(x, digits) for x in np.asarray(values, float).tolist()]


def trial_runs(
    identified: Identification,
    run: MeasuredPerturbation,
    recommended: Recommendation,
    setups: Sequence[Setup],
    count: int = COMPILED_COUNT,
    seed: int = 1,
) -> Recommendation:
    """
    Return the recommendation that survives all draws.

    Parameters
    ----------
    identified, run
        Numbers of a run, and its P.
    recommended : Recommendation
        With its options.
    setups : sequence of Setup
        As `setups_tried` returns them.
    count, seed : int
        Number of draws, and their seed.

    """
    *tried, plain = setups
    draws = list(draw_robots(identified, run, plain.plant, count, seed))
    allowed = [
        _allowed_error(plain, score(plain.changed(draw.values), WHOLE_TRIAL)) for draw in draws
    ]
    trials: list[GainTrial] = []
    for option, setup in zip(recommended.options, tried):
        failures = (
            _find_failure(
                number,
                draw,
                score(setup.changed(draw.values), WHOLE_TRIAL),
                errors,
                identified.joints,
            )
            for number, (draw, errors) in enumerate(zip(draws, allowed), 1)
        )
        trials.append(GainTrial(pole_of(option), count, next(filter(None, failures), None)))
        if trials[-1].failed is None:
            return dataclasses.replace(recommended, values=option, trials=tuple(trials))
    refusal = Finding(Reason.NO_GAINS, Severity.REFUSED, values={'trial': trials[-1]})
    return dataclasses.replace(
        recommended, trials=tuple(trials), findings=(*recommended.findings, refusal)
    )


def setups_tried(
    recommended: Recommendation, values: Values, gains: tuple[Any, Any] | None = None
) -> list[Setup]:
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
    plain = {
        'law': 'compensation',
        'input_delay': loop['input_delay'],
        **_loop_gains(gains, len(values['/**']['joint_names'])),
    }
    short = {
        'plant': {**plant, 'duration': TRIAL.duration_s, 'initial_position': reference['center']},
        'reference': {**reference, 'start_duration': TRIAL.start_s},
    }
    options = [{**loop, **option} for option in recommended.options]
    return [
        parameter_file.load(None, {**values, **short, 'controller': controller})
        for controller in (*options, plain)
    ]


def draw_robots(
    identified: Identification,
    run: MeasuredPerturbation,
    plant: PlantConfig,
    count: int,
    seed: int,
) -> Iterator[Draw]:
    """
    Yield robots at the ends of the intervals.

    Parameters
    ----------
    identified, run
        Numbers of a run, and its P.
    plant : PlantConfig
        As identified.
    count, seed : int
        Number of draws, and their seed.

    """
    rng = np.random.default_rng(seed)
    lag = identified.timing.drive.lag
    drives = list(identified.timing.delays.items()) or [(plant.input_delay, np.tile(lag, (3, 1)))]
    uncertainty = identified.bodies.uncertainty if identified.bodies else 0.0
    error = min(max(TRIAL.min_model_error, uncertainty), TRIAL.max_model_error)
    for k in range(count):
        # Corners of model and friction, for every delay in turn.
        scale, friction_end = 1.0 + error * (2 * (k & 1) - 1), (k & 2) - 1
        delay, lags = drives[k // 4 % len(drives)]
        lag = lags[0] + (lags[2] - lags[0]) * rng.uniform(size=len(lag))
        rate = [
            limit if estimate.value is None else max(limit - estimate.half, 0.1 * limit)
            for limit, estimate in zip(plant.torque_rate_limit, identified.rate)
        ]
        frequency = rng.uniform(*TRIAL.unexplained_frequencies, len(lag))
        yield Draw(
            delay,
            lag,
            scale,
            friction_end,
            {
                'plant': {
                    **_friction_at(identified, plant, friction_end),
                    'torque_rate_limit': rate,
                    'input_delay': int(delay),
                    'actuator_lag': lag.tolist(),
                    'disturbance.amplitude': (run.tail + run.error).tolist(),
                    'disturbance.frequency': frequency.tolist(),
                    'noise_seed': int(rng.integers(2**31)),
                },
                'controller': {'inertia_scale': scale, 'gravity_scale': scale},
            },
        )


def _friction_at(identified: Identification, plant: PlantConfig, end: int) -> dict[str, Any]:
    """Return friction at an end of its intervals, -1 or 1."""
    values = {}
    for name in ('coulomb', 'viscous', 'stribeck', 'load'):
        middle = np.array(getattr(plant, f'{name}_friction'))
        halves = np.array([getattr(friction, name).half for friction in identified.friction])
        largest = MAX_LOAD_FRICTION if name == 'load' else np.inf
        values[f'{name}_friction'] = (middle + end * halves).clip(0.0, largest).tolist()
    return values


def _allowed_error(setup: Setup, usual: Score) -> Array:
    """Return the allowed RMS errors, those of `compensation` within bounds, (n,) [rad]."""
    amplitude = np.array(setup.reference.amplitude)
    largest = TRIAL.max_tracking_error * amplitude
    tracked = largest if usual.failure else np.minimum(usual.rms, largest)
    steps = TRIAL.min_error_steps * np.array(setup.plant.encoder_resolution)
    allowed: Array = np.maximum.reduce([tracked, TRIAL.min_tracking_error * amplitude, steps])
    return allowed


def _find_failure(
    number: int, draw: Draw, trial: Score, allowed: Array, joints: Sequence[str]
) -> FailedDraw | None:
    """Return the failure of gains on a robot, if any."""
    if trial.failure:
        return FailedDraw(number, draw, trial.failure)
    joint = int(np.argmax(np.divide(trial.rms, allowed)))
    failed = FailedDraw(
        number,
        draw,
        '',
        joints[joint],
        trial.rms[joint],
        float(allowed[joint]),
        trial.saturated or 0.0,
    )
    is_wrong = failed.error > failed.allowed or failed.saturated > TRIAL.max_saturated
    return failed if is_wrong else None
