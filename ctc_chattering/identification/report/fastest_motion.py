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
The largest perturbation P of motions that were not recorded, as fast as the limits allow.

P is friction and what the model lacks. Friction is looked up at all speeds up to the limit, in
both directions, with the most load; errors of the model at random states within the limits of
position, velocity, acceleration and torque. Each is at the upper end of its interval, and what no
term explains is added.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from math import pi

from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.regression.identify import Identification
from ctc_chattering.identification.regression.least_squares import (
    BENT,
    stribeck_velocity,
    Term,
    TermKind,
)
from ctc_chattering.identification.report.perturbation import MeasuredPerturbation
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Random states, and speeds at which friction is looked up.
_STATES, _SPEEDS = 600, 60
#: Least and most acceleration by velocity [1/s].
_ACCELERATION, _MOST = 4.0, 15.0
#: How often, and by which factor, states are slowed down that need more than the drives give.
_SLOWED, _SLOWER = 8, 0.7
#: Range of a joint without limits [rad].
_RANGE = (-pi, pi)


@dataclasses.dataclass(frozen=True)
class MotionLimits:
    """
    What a motion may reach; n joints.

    Attributes
    ----------
    low, high : ndarray, shape (n,)
        Positions [rad].
    velocity, acceleration, effort : ndarray, shape (n,)
        Largest magnitudes [rad/s, rad/s², N·m].
    known : ndarray of bool, shape (n,)
        Whether the limit of velocity is that of a description, not of the run.

    """

    low: Array
    high: Array
    velocity: Array
    acceleration: Array
    effort: Array
    known: Array


@dataclasses.dataclass(frozen=True)
class FastestPerturbation:
    """
    Parts of the largest |P|, each of shape (n,) [N·m].

    Attributes
    ----------
    limits : MotionLimits
        Of these motions.
    friction, error, unexplained : ndarray
        Friction, errors of the model, and what no term explains.
    change : ndarray
        How fast the model's torque changes [N·m/s].

    """

    limits: MotionLimits
    friction: Array
    error: Array
    unexplained: Array
    change: Array

    @property
    def peak(self) -> Array:
        """Return the largest |P|, shape (n,)."""
        found: Array = self.friction + self.error + self.unexplained
        return found


def motion_limits(model: Model, found: Identification, run: MeasuredPerturbation
                  ) -> MotionLimits:
    """
    Return the limits that a model has from its description; of the run where it has none.

    The acceleration is that of the recorded motion, played until the velocity is at its limit.
    """
    n = model.n
    recorded = np.where(run.trusted[:, None], found.data.velocity, 0.0)
    fastest = np.abs(recorded).max(axis=0, initial=0.0)
    velocity = _array(getattr(model, 'velocity_limits', None), n)
    known = np.isfinite(velocity)
    velocity = np.where(known, velocity, fastest)
    step = np.median(np.diff(run.t))
    near = run.trusted[1:] & run.trusted[:-1] & (np.abs(np.diff(run.t)) < 1.5 * step)
    change = np.abs(np.diff(recorded, axis=0)[near]).max(axis=0, initial=0.0) / step
    ratio = change * velocity / np.maximum(np.square(fastest), 1e-12)
    low, high = np.array(getattr(model, 'position_limits', None) or [_RANGE] * n, float).T
    return MotionLimits(np.where(np.isfinite(low), low, _RANGE[0]),
                        np.where(np.isfinite(high), high, _RANGE[1]), velocity,
                        np.clip(ratio, _ACCELERATION, _MOST) * velocity,
                        _array(model.effort_limits, n), known)


def _array(limits: Sequence[float] | None, n: int) -> Array:
    """Return limits as an array, inf where there are none."""
    return np.array(limits, float) if limits else np.full(n, np.inf)


def fastest_perturbation(found: Identification, run: MeasuredPerturbation, model: Model,
                         seed: int = 1) -> FastestPerturbation:
    """
    Return the largest |P| within the limits.

    Parameters
    ----------
    found, run
        What was identified, and P of the run.
    model : Model
        As `identify` had it.
    seed : int
        Of the random states.

    """
    limits = motion_limits(model, found, run)
    q, dq, ddq = _states(limits, np.random.default_rng(seed))
    for _ in range(_SLOWED):
        tau = _torques(model, q, dq, ddq)
        beyond = (np.abs(tau) / limits.effort).max(axis=1, keepdims=True) > 1.0
        dq, ddq = np.where(beyond, _SLOWER * dq, dq), np.where(beyond, _SLOWER ** 2 * ddq, ddq)
    allowed = ~beyond[:, 0] if not beyond.all() else np.ones(len(q), bool)
    q, dq, ddq, tau = (x[allowed] for x in (q, dq, ddq, tau))
    error = _error(found, tau, (q, dq, ddq))
    most = np.abs(tau).max(axis=0)
    load = np.minimum(most + error, limits.effort)
    friction = np.array([_friction(found, i, limits.velocity[i], load[i])
                         for i in range(model.n)])
    often = limits.acceleration / np.maximum(limits.velocity, 1e-12)
    # Parts that hit each other do so with a momentum that grows with the speed.
    faster = limits.velocity / np.maximum(np.abs(found.data.velocity).max(axis=0), 1e-12)
    return FastestPerturbation(limits, friction, error,
                               run.tail + run.impact * np.maximum(faster, 1.0), often * most)


def _states(limits: MotionLimits, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return random q, dq and ddq, each of shape (S, n); half of them as fast as allowed."""
    shape = (_STATES, len(limits.low))
    q = rng.uniform(limits.low, limits.high, shape)
    fast = np.arange(_STATES)[:, None] % 2 == 0
    speed, change = (np.where(fast, np.sign(x), x)
                     for x in rng.uniform(-1.0, 1.0, (2, *shape)))
    return q, speed * limits.velocity, change * limits.acceleration


def _torques(model: Model, q: Array, dq: Array, ddq: Array) -> Array:
    """Return the torques of a model, shape (S, n) [N·m]."""
    return np.array([model.inverse_dynamics(*rows)
                     for rows in zip(q.tolist(), dq.tolist(), ddq.tolist())])


def _error(found: Identification, tau: Array, states: tuple[Array, Array, Array]) -> Array:
    """Return the largest torque of errors of the model, shape (n,) [N·m]."""
    fit, spread = found.selected.fit, found.selected.spread
    mine = [k for k, term in enumerate(fit.terms)
            if term.kind in (TermKind.MODEL, TermKind.SCALE, *BENT)]
    if not mine:
        return np.zeros(tau.shape[1])
    columns = np.stack([_error_column(fit.terms[k], tau) for k in mine], axis=2)
    models = [j for j, k in enumerate(mine) if fit.terms[k].kind == TermKind.MODEL]
    if models and found.columns is not None:
        which = [int(fit.terms[mine[j]].which) for j in models]
        every = np.array([found.columns.at(*rows) for rows in zip(*states)])
        columns[:, :, models] = every @ found.selected.mixing[:, which]
    covariance = spread.covariance[np.ix_(mine, mine)]
    half = spread.factor * np.sqrt(np.maximum(
        np.einsum('snp,pq,snq->sn', columns, covariance, columns), 0.0))
    largest: Array = (np.abs(columns @ fit.value[mine]) + half).max(axis=0)
    return largest


def _error_column(term: Term, tau: Array) -> Array:
    """Return the column of what a drive makes of the torque, shape (S, n) [N·m]; else 0."""
    column = np.zeros_like(tau)
    if term.kind != TermKind.MODEL:
        joints = range(tau.shape[1]) if term.joint < 0 else [term.joint]
        mine = tau[:, joints]
        column[:, joints] = {TermKind.SCALE: -mine, TermKind.DEAD_BAND: np.sign(mine),
                             TermKind.FADING: mine * np.abs(mine)}[term.kind]
    return column


def _friction(found: Identification, i: int, fastest: float, load: float) -> float:
    """Return the largest friction of joint i up to a speed [rad/s], under a load [N·m]."""
    fit, spread = found.selected.fit, found.selected.spread
    speed = np.linspace(0.0, fastest, _SPEEDS)
    largest = 0.0
    if not fit.terms:
        return largest
    for way in (TermKind.FORWARDS, TermKind.BACKWARDS):
        columns = np.stack([_column(term, way, speed, load) if term.joint == i
                            else np.zeros(_SPEEDS) for term in fit.terms], axis=1)
        half = spread.factor * np.sqrt(np.maximum(
            np.einsum('sp,pq,sq->s', columns, spread.covariance, columns), 0.0))
        largest = max(largest, float((np.abs(columns @ fit.value) + half).max()))
    return largest


def _column(term: Term, way: TermKind, speed: Array, load: float) -> Array:
    """Return the column of a term of friction at speeds in one direction, in that direction."""
    if term.kind == TermKind.VISCOUS:
        return speed
    if term.kind == TermKind.STRIBECK:
        found: Array = np.exp(-np.square(speed / stribeck_velocity(term.which)))
        return found
    if term.kind == TermKind.LOAD:
        return np.full_like(speed, load)
    return np.full_like(speed, float(term.kind == way))
