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

"""The perturbation P of a run, which the chattering term must hold, and its prediction."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import dataclasses
from math import floor, log10, pi
from typing import NamedTuple

from ctc_chattering.analysis.tables import rounded
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.findings import Finding, Kind
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.least_squares import Data, FRICTION, TermKind
from ctc_chattering.identification.verdict import verdicts
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt

Flags = npt.NDArray[np.bool_]
#: An outlier is this many times beyond the bound of what is unexplained, and this part of P.
_FAR, _SEEN = 3.0, 0.1
#: What a joint at rest may have beyond the friction of sliding, in bounds of what is unexplained.
_TAILS = 3.0
#: Windows beside an outlier that share samples with it.
_BESIDE = 4
#: Fewest windows of which a tail is told.
_ENOUGH = 100


@dataclasses.dataclass(frozen=True)
class MeasuredPerturbation:
    """
    P over the windows of a run; J windows, n joints.

    Attributes
    ----------
    t : ndarray, shape (J,)
        Centres of the windows [s].
    measured, predicted : ndarray, shape (J, n)
        Torque less the model's, and friction plus errors of the model as identified, nan where a
        joint does not slide [N·m].
    envelope : ndarray, shape (J, n)
        Largest |P| that what was identified allows at the state of a window, at a stop or
        a break-away as well [N·m].
    trusted : ndarray of bool, shape (J,)
        Windows that are no outliers of any joint, nor beside one.
    tail, error : ndarray, shape (n,)
        Bound of what is not predicted in trusted windows, and largest error of the model there
        [N·m].

    """

    t: Array
    measured: Array
    predicted: Array
    envelope: Array
    trusted: Flags
    tail: Array
    error: Array

    @property
    def rest(self) -> Array:
        """Return what is not predicted of P, shape (J, n) [N·m]; NaN where nothing is."""
        return self.measured - self.predicted

    @property
    def peak(self) -> Array:
        """
        Largest |P| of each joint, shape (n,) [N·m].

        That of the envelope with what is not predicted, and what was measured where the joint
        does not slide, before it breaks away.
        """
        slides = np.isfinite(self.predicted) & self.trusted[:, None]
        known = np.where(slides, self.envelope, 0.0).max(axis=0, initial=0.0) + self.tail
        held = [tail_bound(np.abs(x[self.trusted & ~mine]))
                for x, mine in zip(self.measured.T, slides.T)]
        return np.asarray(np.maximum(known, held))

    def outliers(self) -> Iterator[Finding]:
        """Yield for each joint which windows were left out of the peak."""
        rest = np.abs(self.rest)
        far = np.where(np.isfinite(rest), rest, 0.0) > _FAR * self.tail
        far &= ~self.trusted[:, None]
        for i in range(self.measured.shape[1]):
            size = np.where(far[:, i], rest[:, i], 0.0)
            if size.any():
                k = int(np.argmax(size))
                yield Finding(
                    Kind.DOUBT, i, f'{int(far[:, i].sum())} windows of 0.1 s have a torque '
                    f'that nothing explains, up to {size[k]:.3g} N*m at {self.t[k]:.2f} s: a '
                    'contact, or wrong stamps; they are not in the largest |P|',
                    'look at the recording there')

    def break_away(self, joints: Sequence[str]) -> Iterator[Finding]:
        """Yield the joints with more friction at rest, or breaking away, than sliding shows."""
        held = self.trusted[:, None] & ~np.isfinite(self.predicted)
        more = np.abs(self.measured) - self.envelope
        for i, name in enumerate(joints):
            beyond = tail_bound(np.maximum(more[held[:, i], i], 0.0))
            level = float(np.median(self.envelope[:, i]))
            if beyond > _TAILS * self.tail[i]:
                yield Finding(
                    Kind.BREAK_AWAY, i, f'at rest or breaking away |P| is up to {beyond:.3g} N*m '
                    f'more than {name} shows while it slides: Stribeck friction below the '
                    'velocities shown, or a joint that is held by something else',
                    'record slower reversals, as those of `ctc excite`',
                    beyond / max(level, 1e-300))


def perturbation(found: Identification) -> MeasuredPerturbation:
    """Return P of the identified run."""
    data = found.data
    used, (error, _) = data.used(), found.selected.torque(data, (TermKind.MODEL,))
    for i, mine in enumerate(used.T):
        if mine.any():
            # Of a window in which the joint does not slide: between those in which it does.
            error[:, i] = np.interp(np.arange(len(mine)), np.flatnonzero(mine), error[mine, i])
    predicted = np.where(used, found.selected.torque(data)[0], np.nan)
    rest = np.abs(data.residual - predicted)
    bound = np.array([tail_bound(x[np.isfinite(x)]) for x in rest.T])
    size = np.array([np.median(np.abs(x[mine])) if mine.any() else 0.0
                     for x, mine in zip(data.residual.T, used.T)])
    far: Flags = np.any(rest > np.maximum(_FAR * bound, bound + _SEEN * size), axis=1)
    # Windows beside one that is far share samples with it.
    trusted = np.convolve(far, np.ones(2 * _BESIDE + 1), 'same') < 0.5
    return MeasuredPerturbation(
        data.t, data.residual, predicted,
        np.abs(error) + _largest_friction(
            found, data.velocity, np.maximum(data.load, np.abs(data.torque)), 0.0), trusted,
        np.array([tail_bound(x[np.isfinite(x) & trusted]) for x in rest.T]),
        np.abs(error[trusted]).max(axis=0, initial=0.0))


def tail_bound(sizes: Array) -> float:
    """
    Return what about the largest of these magnitudes is, shape (N,), without single outliers.

    From the quantiles of 90 and 99 % on, the logarithm of the part beyond is taken as straight,
    which is right for exponential tails and too much for lighter ones.
    """
    largest = float(sizes.max(initial=0.0))
    if len(sizes) < _ENOUGH:
        return largest
    most, high = np.percentile(sizes, (90.0, 99.0)).tolist()
    return min(largest, float(high + (high - most) * np.log10(len(sizes) / 100.0)))


def friction_at(found: Identification, velocity: Array, load: Array | float
                ) -> tuple[Array, Array]:
    """
    Return friction, and half its interval, each of shape (S, n) [N·m].

    Parameters
    ----------
    found : Identification
        What was identified.
    velocity : ndarray, shape (S, n)
        Of sliding [rad/s]; the sign of a zero is its direction.
    load : ndarray, shape (n,) or (S, n), or float
        Torque of the drives [N·m].

    """
    states = Data.at(np.copysign(1.0, velocity), velocity, np.broadcast_to(load, velocity.shape),
                     np.zeros((*velocity.shape, found.data.more.shape[2])))
    return found.selected.torque(states, FRICTION)


def _largest_friction(found: Identification, velocity: Array, load: Array, halves: float) -> Array:
    """Return the larger friction of both directions, with halves of its interval, (S, n)."""
    both = [np.abs(value) + halves * half for value, half in (
        friction_at(found, np.copysign(velocity, sign), load) for sign in (1.0, -1.0))]
    return np.maximum(*both)


#: Random states, and speeds at which friction is looked up.
_STATES, _SPEEDS = 600, 60
#: Least and most acceleration by velocity [1/s].
_ACCELERATION = 4.0, 15.0
#: How often, and by which factor, states are slowed down that need more than the drives give.
_SLOWED, _SLOWER = 8, 0.7
#: Range of a joint without limits [rad].
_RANGE = (-pi, pi)


class MotionLimits(NamedTuple):
    """
    What a motion may reach; n joints.

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


def motion_limits(model: Model, found: Identification, run: MeasuredPerturbation) -> MotionLimits:
    """
    Return the limits that a model has from its description; of the run where it has none.

    The acceleration is that of the recorded motion, played until the velocity is at its limit.
    """
    n = model.n
    fastest, change = (np.abs(x[run.trusted]).max(axis=0, initial=0.0)
                       for x in (found.data.velocity, found.data.acceleration))
    velocity = np.array(getattr(model, 'velocity_limits', None) or [np.inf] * n, float)
    velocity = np.where(np.isfinite(velocity), velocity, fastest)
    ratio = np.clip(change * velocity / np.maximum(np.square(fastest), 1e-12), *_ACCELERATION)
    position = np.array(getattr(model, 'position_limits', None) or [_RANGE] * n, float)
    return MotionLimits(np.where(np.isfinite(position), position, _RANGE), velocity,
                        ratio * velocity, np.array(model.effort_limits or [np.inf] * n, float))


def _states(limits: MotionLimits, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return random q, dq and ddq, each of shape (S, n); half of them as fast as allowed."""
    shape = (_STATES, len(limits.velocity))
    q = rng.uniform(limits.position[:, 0], limits.position[:, 1], shape)
    fast = np.arange(_STATES)[:, None] % 2 == 0
    speed, change = (np.where(fast, np.sign(x), x) for x in rng.uniform(-1.0, 1.0, (2, *shape)))
    return q, speed * limits.velocity, change * limits.acceleration


def _torques(model: Model, q: Array, dq: Array, ddq: Array) -> Array:
    """Return the torques of a model, shape (S, n) [N·m]."""
    return np.array([model.inverse_dynamics(*rows)
                     for rows in zip(q.tolist(), dq.tolist(), ddq.tolist())])


def _largest_error(found: Identification, tau: Array, states: tuple[Array, Array, Array]) -> Array:
    """Return the largest torque of errors of the model, shape (n,) [N·m]."""
    more = (np.array([found.columns.at(*rows) for rows in zip(*states)]) if found.columns
            else np.zeros((*tau.shape, 0)))
    value, half = found.selected.torque(
        Data.at(np.ones_like(tau), states[1], tau, more), (TermKind.MODEL,))
    return np.asarray((np.abs(value) + half).max(axis=0))


#: ka over the largest |P|.
MARGIN = 1.2


class PerturbationBound(NamedTuple):
    """
    ka with its parts; arrays of shape (n,) [N·m].

    Attributes
    ----------
    ka, peak : ndarray
        The gain, and the largest |P| it is for.
    friction : ndarray
        The largest friction as fast as the limits allow.
    change : ndarray
        How fast the model's torque changes there [N·m/s].
    weight : ndarray
        The largest torque of the model at rest.
    reason : str
        The parts.
    findings : tuple of Finding
        Where a drive cannot give as much.

    """

    ka: Array
    peak: Array
    friction: Array
    change: Array
    weight: Array
    reason: str
    findings: tuple[Finding, ...]


def perturbation_bound(found: Identification, run: MeasuredPerturbation, model: Model,
                       seed: int = 1) -> PerturbationBound:
    """
    Return ka for motions within the limits.

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
    error, most = _largest_error(found, tau, (q, dq, ddq)), np.abs(tau).max(axis=0)
    friction = _largest_friction(
        found, np.linspace(0.0, limits.velocity, _SPEEDS),
        np.minimum(most + error + run.peak, limits.effort), 1.0).max(axis=0)
    peak = np.maximum(run.peak, friction + error + run.tail)
    ka = np.array([in_digits(MARGIN * p, 3, np.ceil) for p in peak])
    usable = [x.usable for x in verdicts(found)]
    speeds, *parts = (', '.join(
        f'{round(x, 6):.3g}' if good else '-' for x, good in zip(values, usable))
        for values in (limits.velocity, friction, error, run.tail, run.peak))
    reason = (f'{MARGIN:g} times the largest |P| up to {speeds} rad/s, the limits of the '
              'description, or the speed of the run where there is none: friction {}, errors of '
              'the model {}, unexplained {} N*m; in the run |P| is at most {} N*m'.format(*parts))
    often, still = limits.acceleration / np.maximum(limits.velocity, 1e-12), np.zeros_like(q)
    return PerturbationBound(
        np.minimum(ka, limits.effort), peak, friction, often * most,
        np.abs(_torques(model, q, still, still)).max(axis=0), reason,
        tuple(_doubts(found, peak, ka, limits.effort)))


def _doubts(found: Identification, peak: Array, ka: Array, effort: Array) -> Iterator[Finding]:
    """Yield the joints whose drive cannot give ka, or whose viscous friction is not known."""
    for i, one in enumerate(found.friction):
        if ka[i] > effort[i]:
            yield Finding(Kind.DOUBT, i, f'|P| reaches {peak[i]:.3g} N*m as fast as the limits '
                          f'allow; ka = {ka[i]:.3g} N*m is cut to its effort limit, '
                          f'{effort[i]:.3g} N*m', 'correct the model, or move more slowly')
        if one.coulomb.value is not None and one.viscous.value is None and (
                not one.viscous.shows_none):
            yield Finding(Kind.MOTION, i, 'ka holds at the speeds of the run only: '
                          f'{one.viscous.reason}', 'record slow reversals, and different speeds')


def in_digits(value: float, digits: int, way: Callable[[float], float]) -> float:
    """Return a value >= 0 with some digits, rounded by `np.ceil` or `np.floor`."""
    if value <= 0.0:
        return 0.0
    unit = 10.0 ** (floor(log10(value)) - digits + 1)
    return rounded(float(way(round(value / unit, 9)) * unit), 6)
