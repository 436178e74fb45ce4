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
Perturbation P of a run, which the chattering term must hold, and its bound for other motions.

P is the torque that the controller's model lacks: friction, and errors of the model.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import dataclasses
from math import floor, log10, pi
from typing import NamedTuple

from ctc_chattering.analysis.tables import rounded
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.findings import Estimate, Finding, Reason, Severity
from ctc_chattering.identification.friction import JointFriction
from ctc_chattering.identification.friction_terms import TermKind
from ctc_chattering.identification.identify import Identification
from ctc_chattering.numerics.linear_algebra import Array, Flags
import numpy as np

#: Bounds of what is unexplained beyond which a window is an outlier.
OUTLIER_BOUNDS = 3.0
#: Part of P beyond which it is.
OUTLIER_PART = 0.1
#: Torque of a joint at rest beyond the friction of sliding, in bounds of what is unexplained.
RESTING_TAILS = 3.0
#: Such torque as a part of the friction.
RESTING_PART = 0.1
#: Share of a window in which a joint that slides may rest.
SLIDING_SHARE = 1e-9
#: Windows beside an outlier that share samples with it.
BESIDE = 4
#: Fewest windows from which a tail is extrapolated.
FEWEST_OF_TAIL = 100
#: ka over the largest |P|.
MARGIN = 1.2
#: Random states within the limits.
STATES = 600
#: Speeds at which friction is looked up.
SPEEDS = 60
#: Least acceleration by velocity of a motion as fast as the limits allow [1/s].
LEAST_ACCELERATION = 4.0
#: Largest one [1/s].
MOST_ACCELERATION = 15.0
#: Steps in which states are slowed down that need more than the drives give.
SLOWING_STEPS = 8
#: Factor of the velocity in each of these.
SLOWER = 0.7
#: Range of a joint without limits [rad].
WHOLE_TURN = (-pi, pi)


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
    def residual(self) -> Array:
        """P that is not predicted, shape (J, n) [N·m]; nan where nothing is."""
        return self.measured - self.predicted

    @property
    def peak(self) -> Array:
        """
        Largest |P| of each joint, shape (n,) [N·m].

        That of the envelope with what is not predicted, and what was measured where the joint
        does not slide, before it breaks away.
        """
        slides = np.isfinite(self.predicted) & self.trusted[:, None]
        sliding = np.where(slides, self.envelope, 0.0).max(axis=0, initial=0.0) + self.tail
        at_rest = [tail_bound(np.abs(torque[self.trusted & ~slide]))
                   for torque, slide in zip(self.measured.T, slides.T)]
        return np.asarray(np.maximum(sliding, at_rest))

    def outliers(self) -> Iterator[Finding]:
        """Yield the joints of which windows were left out of the peak."""
        residual = np.abs(np.nan_to_num(self.residual))
        far = (residual > OUTLIER_BOUNDS * self.tail) & ~self.trusted[:, None]
        for joint in np.flatnonzero(far.any(axis=0)).tolist():
            size = np.where(far[:, joint], residual[:, joint], 0.0)
            k = int(np.argmax(size))
            yield Finding(Reason.OUTLIERS, Severity.CARE, joint, {
                'count': np.count_nonzero(size), 'torque': size[k], 't': self.t[k]})

    def break_away(self) -> Iterator[Finding]:
        """Yield the joints with more friction at rest, or breaking away, than sliding shows."""
        at_rest = self.trusted[:, None] & ~np.isfinite(self.predicted)
        excess = np.abs(self.measured) - self.envelope
        for joint in range(len(self.tail)):
            beyond = tail_bound(np.maximum(excess[at_rest[:, joint], joint], 0.0))
            level = float(np.median(self.envelope[:, joint]))
            if beyond > max(RESTING_TAILS * self.tail[joint], RESTING_PART * level):
                yield Finding(Reason.BREAK_AWAY, Severity.CARE, joint, {'torque': beyond})


def perturbation(identified: Identification, corrected: bool) -> MeasuredPerturbation:
    """
    Return P of the identified run.

    Parameters
    ----------
    identified : Identification
        As of `identify`.
    corrected : bool
        Whether the model that P is about has the identified bodies.

    """
    fit, data = identified.fit, identified.fit.data
    windows, joints = data.windows, range(data.joint_count)
    moves = windows.resting < SLIDING_SHARE
    bodies = windows.bodies @ fit.body_change() if fit.unknowns.body_count else np.zeros_like(
        data.torque)
    is_known = data.torque != 0.0
    measured = np.where(is_known, data.torque - windows.model_torque - bodies * corrected, 0.0)
    friction = np.stack([fit.torque(joint, tuple(TermKind)) for joint in joints], axis=1)
    error = bodies * (not corrected)
    predicted = np.where(data.used & moves, friction + error, np.nan)
    residual = np.abs(measured - predicted)
    bound = np.array([tail_bound(x[np.isfinite(x)]) for x in residual.T])
    size = np.array([np.median(np.abs(x[used])) if used.any() else 0.0
                     for x, used in zip(measured.T, data.used.T)])
    limit = np.maximum(OUTLIER_BOUNDS * bound, bound + OUTLIER_PART * size)
    far: Flags = np.any(residual > limit, axis=1)
    # Windows beside one that is far share samples with it.
    trusted = np.convolve(far, np.ones(2 * BESIDE + 1), 'same') < 0.5
    load = np.maximum(np.abs(windows.load), np.abs(data.torque))
    return MeasuredPerturbation(
        windows.t, measured, predicted,
        np.abs(error) + largest_friction(identified, windows.velocity, load, 0.0), trusted,
        np.array([tail_bound(x[np.isfinite(x) & trusted]) for x in residual.T]),
        np.abs(error[trusted]).max(axis=0, initial=0.0))


def tail_bound(sizes: Array) -> float:
    """
    Return about the largest of these magnitudes, shape (N,), without single outliers.

    From the quantiles of 90 and 99 % on, the logarithm of the part beyond is taken as straight,
    which is right for exponential tails and too much for lighter ones.
    """
    largest = float(sizes.max(initial=0.0))
    if len(sizes) < FEWEST_OF_TAIL:
        return largest
    ninety, ninety_nine = np.percentile(sizes, (90.0, 99.0)).tolist()
    decades = np.log10(len(sizes) / 100.0)
    return min(largest, float(ninety_nine + (ninety_nine - ninety) * decades))


def friction_at(friction: JointFriction, velocity: Array, load: Array | float,
                halves: float = 0.0) -> Array:
    """
    Return the friction of a joint [N·m].

    Parameters
    ----------
    friction : JointFriction
        As identified.
    velocity : ndarray, shape (S,)
        Of sliding [rad/s]; the sign of a zero is its direction.
    load : ndarray, shape (S,), or float
        Magnitude of the torque of the drive [N·m].
    halves : float
        How many halves of its interval each number is larger.

    """
    def number(estimate: Estimate) -> float:
        return 0.0 if estimate.value is None else estimate.value + halves * estimate.half

    direction = np.copysign(1.0, velocity)
    coulomb = np.where(direction > 0.0, number(friction.forwards), number(friction.backwards))
    slow = np.exp(-np.square(velocity / (friction.stribeck_velocity.value or 1.0)))
    dry = coulomb + number(friction.stribeck) * slow + number(friction.load) * np.abs(load)
    return np.asarray(direction * dry + number(friction.viscous) * velocity)


def largest_friction(identified: Identification, velocity: Array, load: Array, halves: float
                     ) -> Array:
    """Return the larger friction of both directions, shape (S, n) [N·m]; `friction_at`."""
    columns = [np.maximum(*(np.abs(friction_at(
        friction, np.copysign(velocity[:, joint], sign), load[:, joint], halves))
        for sign in (1.0, -1.0))) for joint, friction in enumerate(identified.friction)]
    return np.stack(columns, axis=1)


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


def motion_limits(model: Model, identified: Identification, run: MeasuredPerturbation
                  ) -> MotionLimits:
    """
    Return the limits that a model has from its description; of the run where it has none.

    The acceleration is that of the recorded motion, played until the velocity is at its limit.
    """
    n = model.n
    fastest, change = (np.abs(x[run.trusted]).max(axis=0, initial=0.0)
                       for x in (identified.fit.data.windows.velocity,
                                 identified.fit.data.windows.acceleration))
    velocity = np.array(getattr(model, 'velocity_limits', None) or [np.inf] * n, float)
    velocity = np.where(np.isfinite(velocity), velocity, fastest)
    ratio = change * velocity / np.maximum(np.square(fastest), 1e-12)
    acceleration = velocity * ratio.clip(LEAST_ACCELERATION, MOST_ACCELERATION)
    position = np.array(getattr(model, 'position_limits', None) or [WHOLE_TURN] * n, float)
    return MotionLimits(np.where(np.isfinite(position), position, WHOLE_TURN), velocity,
                        acceleration, np.array(model.effort_limits or [np.inf] * n, float))


class RandomStates(NamedTuple):
    """Random states within limits, each of shape (S, n) [rad, rad/s, rad/s²]."""

    q: Array
    dq: Array
    ddq: Array

    @classmethod
    def within(cls, limits: MotionLimits, seed: int) -> RandomStates:
        """Return states of which half are as fast as allowed."""
        rng = np.random.default_rng(seed)
        shape = (STATES, len(limits.velocity))
        q = rng.uniform(limits.position[:, 0], limits.position[:, 1], shape)
        is_fast = np.arange(STATES)[:, None] % 2 == 0
        speed, change = (np.where(is_fast, np.sign(x), x)
                         for x in rng.uniform(-1.0, 1.0, (2, *shape)))
        return cls(q, speed * limits.velocity, change * limits.acceleration)

    def torques(self, model: Model) -> Array:
        """Return the torques of a model, shape (S, n) [N·m]."""
        return np.array([model.inverse_dynamics(*rows) for rows in zip(
            self.q.tolist(), self.dq.tolist(), self.ddq.tolist())])

    def allowed(self, model: Model, effort: Array) -> RandomStates:
        """Return those, slowed down if need be, that efforts allow; all if they allow none."""
        states = self
        for _ in range(SLOWING_STEPS):
            beyond = (np.abs(states.torques(model)) / effort).max(axis=1, keepdims=True) > 1.0
            states = RandomStates(
                states.q, np.where(beyond, SLOWER * states.dq, states.dq),
                np.where(beyond, SLOWER ** 2 * states.ddq, states.ddq))
        inside = ~beyond[:, 0]
        if not inside.any():
            return states
        return RandomStates(*(x[inside] for x in states))


def _largest_error(identified: Identification, states: RandomStates, corrected: bool) -> Array:
    """Return the largest torque of errors of the model, shape (n,) [N·m]."""
    bodies = identified.bodies
    if bodies is None:
        return np.zeros(states.q.shape[1])
    errors = []
    for state in zip(*states):
        change = 0.0 if corrected else np.abs(bodies.torque_change(*state))
        errors.append(bodies.torque_error(*state) + change)
    return np.asarray(np.max(errors, axis=0))


class PerturbationBound(NamedTuple):
    """
    ka with its parts; arrays of shape (n,) [N·m].

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


def perturbation_bound(identified: Identification, run: MeasuredPerturbation, model: Model,
                       corrected: bool, seed: int = 1) -> PerturbationBound:
    """
    Return ka for motions within the limits.

    Parameters
    ----------
    identified, run
        As of `identify`, and P of the run.
    model : Model
        That P is about.
    corrected : bool
        Whether it has the identified bodies.
    seed : int
        Of the random states.

    """
    limits = motion_limits(model, identified, run)
    states = RandomStates.within(limits, seed).allowed(model, limits.effort)
    error = _largest_error(identified, states, corrected)
    torque = np.abs(states.torques(model)).max(axis=0)
    load = np.minimum(torque + error + run.peak, limits.effort)
    friction = largest_friction(
        identified, np.linspace(0.0, limits.velocity, SPEEDS),
        np.tile(load, (SPEEDS, 1)), 1.0).max(axis=0)
    peak = np.maximum(run.peak, friction + error + run.tail)
    ka = np.array([in_digits(MARGIN * p, 3, np.ceil) for p in peak])
    often = limits.acceleration / np.maximum(limits.velocity, 1e-12)
    return PerturbationBound(
        np.minimum(ka, limits.effort), peak, friction, error, limits.velocity, often * torque,
        tuple(_doubts(peak, ka, limits.effort)))


def _doubts(peak: Array, ka: Array, effort: Array) -> Iterator[Finding]:
    """Yield the joints whose drive cannot give ka."""
    for joint in np.flatnonzero(ka > effort).tolist():
        yield Finding(Reason.KA_CUT, Severity.CARE, joint, {
            'peak': peak[joint], 'ka': ka[joint], 'effort': effort[joint]})


def in_digits(value: float, digits: int, rounding: Callable[[float], float]) -> float:
    """Return a value >= 0 with some digits, rounded by `np.ceil` or `np.floor`."""
    if value <= 0.0:
        return 0.0
    unit = 10.0 ** (floor(log10(value)) - digits + 1)
    return rounded(float(rounding(round(value / unit, 9)) * unit), 6)
