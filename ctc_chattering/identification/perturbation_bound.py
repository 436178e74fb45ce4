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
Bound of the perturbation P, which the gain ka must hold.

`gains.py` recommends ka from here. The bound is the largest of what the run shows and of what
friction and errors of the model may reach at random states within the limits.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil, pi
from typing import NamedTuple

from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.findings import Finding, Reason, Severity
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import largest_friction, MeasuredPerturbation
from ctc_chattering.number_format import round_towards
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Ratio of ka to the largest |P|.
MARGIN = 1.2


class MotionLimits(NamedTuple):
    """
    Limits of a motion of n joints.

    Attributes
    ----------
    position : ndarray, shape (n, 2)
        Lowest and highest [rad].
    velocity, acceleration, effort : ndarray, shape (n,)
        Largest magnitudes [rad/s, rad/s², N·m].

    """

    position: Array
    velocity: Array
    acceleration: Array
    effort: Array

    @classmethod
    def of(
            cls,
            model: Model,
            identified: Identification,
            run: MeasuredPerturbation) -> MotionLimits:
        """
        Return the limits of a description, or of the run.

        The acceleration is that of the recorded motion, played until the velocity is at its limit.
        It is 4 to 15 times the velocity.
        """
        n = model.n
        windows = identified.fit.data.windows
        fastest = np.abs(windows.velocity[run.trusted]).max(axis=0, initial=0.0)
        change = np.abs(windows.acceleration[run.trusted]).max(axis=0, initial=0.0)
        velocity = np.array(getattr(model, 'velocity_limits', None) or [np.inf] * n, float)
        velocity = np.where(np.isfinite(velocity), velocity, fastest)
        ratio = change * velocity / np.maximum(np.square(fastest), 1e-12)
        whole_turn = (-pi, pi)
        position = np.array(getattr(model, 'position_limits', None) or [whole_turn] * n, float)
        return cls(
            position=np.where(np.isfinite(position), position, whole_turn),
            velocity=velocity,
            acceleration=velocity * ratio.clip(4.0, 15.0),
            effort=np.array(model.effort_limits or [np.inf] * n, float))


def _draw_states(limits: MotionLimits, seed: int) -> Array:
    """
    Return random positions, velocities and accelerations, shape (3, 600, n).

    Half of them are as fast as allowed [rad, rad/s, rad/s²].
    """
    rng = np.random.default_rng(seed)
    shape = (600, len(limits.velocity))
    q = rng.uniform(limits.position[:, 0], limits.position[:, 1], shape)
    speed = rng.uniform(-1.0, 1.0, (2, *shape))
    speed[:, ::2] = np.sign(speed[:, ::2])
    return np.array([q, speed[0] * limits.velocity, speed[1] * limits.acceleration])


def _torques(model: Model, states: Array) -> Array:
    """Return the torques of a model, shape (S, n) [N·m]."""
    return np.array([model.inverse_dynamics(*state) for state in zip(*states.tolist())])


def _slow_down(states: Array, model: Model, effort: Array) -> Array:
    """
    Return the states that efforts allow, slowed down if need be.

    If efforts allow none, all are returned.
    """
    for _ in range(8):
        load = np.abs(_torques(model, states)) / effort
        is_beyond = load.max(axis=1) > 1.0
        states[1, is_beyond] *= 0.7
        states[2, is_beyond] *= 0.7 ** 2
    return states if is_beyond.all() else states[:, ~is_beyond]


def _largest_error(identified: Identification, states: Array, corrected: bool) -> Array:
    """Return the largest error of the model's torque, shape (n,) [N·m]."""
    bodies = identified.bodies
    if bodies is None:
        return np.zeros(states.shape[2])
    errors = []
    for state in zip(*states):
        error = bodies.torque_error(*state)
        if not corrected:
            error = error + np.abs(bodies.torque_change(*state))
        errors.append(error)
    return np.asarray(np.max(errors, axis=0))


class PerturbationBound(NamedTuple):
    """
    Gain ka with its parts; arrays of shape (n,) [N·m].

    Attributes
    ----------
    ka, peak : ndarray
        The gain, and the largest |P| it is for.
    friction : ndarray
        The largest friction as fast as the limits allow.
    error : ndarray
        The largest error of the model there.
    velocity : ndarray
        Limits of the velocity [rad/s].
    change : ndarray
        Change of the model's torque there [N·m/s].
    findings : tuple of Finding
        Drives that cannot give as much.

    """

    ka: Array
    peak: Array
    friction: Array
    error: Array
    velocity: Array
    change: Array
    findings: tuple[Finding, ...]


def bound_perturbation(
        identified: Identification,
        run: MeasuredPerturbation,
        model: Model,
        corrected: bool) -> PerturbationBound:
    """
    Return ka for motions within the limits.

    Parameters
    ----------
    identified, run
        Result of `identify`, and P of the run.
    model : Model
        The model that P is about.
    corrected : bool
        Whether it has the identified bodies.

    """
    limits = MotionLimits.of(model, identified, run)
    states = _slow_down(_draw_states(limits, seed=1), model, limits.effort)
    error = _largest_error(identified, states, corrected)
    torque = np.abs(_torques(model, states)).max(axis=0)
    load = np.minimum(torque + error + run.peak, limits.effort)
    speeds = np.linspace(0.0, limits.velocity, 60)
    loads = np.broadcast_to(load, speeds.shape)
    # Each number of the friction is at the upper end of its interval.
    friction = largest_friction(identified, speeds, loads, 1.0).max(axis=0)
    peak = np.maximum(run.peak, friction + error + run.tail)
    ka = np.array([round_towards(MARGIN * p, 3, ceil) for p in peak])
    change = torque * (limits.acceleration / np.maximum(limits.velocity, 1e-12))
    return PerturbationBound(
        ka=np.minimum(ka, limits.effort),
        peak=peak,
        friction=friction,
        error=error,
        velocity=limits.velocity,
        change=change,
        findings=tuple(_find_weak_drives(peak, ka, limits.effort)))


def _find_weak_drives(peak: Array, ka: Array, effort: Array) -> Iterator[Finding]:
    """Yield the joints whose drive cannot give ka."""
    for joint in np.flatnonzero(ka > effort).tolist():
        yield Finding(Reason.KA_CUT, Severity.CARE, joint, {
            'peak': peak[joint], 'ka': ka[joint], 'effort': effort[joint]})
