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

from collections.abc import Mapping, Sequence
from typing import Any

from ctc_chattering.analysis.tables import rounded
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.regression.identify import Identification
from ctc_chattering.identification.regression.joint_friction import JointFriction
from ctc_chattering.identification.regression.weak_form import position_noise
from ctc_chattering.identification.report.recommendation import GAINS, Recommendation
from ctc_chattering.identification.report.verdict import Verdict
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


def missing_gains(verdicts: Sequence[Verdict]) -> list[str]:
    """
    Return which gains are missing of joints that are not usable, and what to record.

    A parameter file has values for all joints of a robot: with one of these there is none.
    """
    joints: dict[str, list[str]] = {}
    for x in verdicts:
        if not x.usable:
            joints.setdefault('; '.join(x.reasons), []).append(x.joint)
    return [f'{", ".join(names)}: no ka, friction_level, torque_rate_limit, nor friction of the '
            f'plant: {reasons}' for reasons, names in joints.items()]


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
    limits = getattr(model, 'position_limits', None)
    start = q[0].copy()
    if limits:
        start = np.clip(start, *np.array(limits).T)
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
