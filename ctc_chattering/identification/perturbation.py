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
Perturbation P of a run, which the controller's model lacks.

P is friction, and errors of the model. The chattering term must hold it. `perturbation_bound.py`
has the bound for other motions, and the results show P over the run.
"""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses

from ctc_chattering.identification.findings import Estimate, Finding, Reason, Severity
from ctc_chattering.identification.friction import JointFriction
from ctc_chattering.identification.friction_terms import TermKind
from ctc_chattering.identification.identify import Identification
from ctc_chattering.numerics.linear_algebra import Array, Flags
import numpy as np

#: Residual of an outlier, relative to the bound of the residuals.
_OUTLIER_BOUNDS = 3.0


@dataclasses.dataclass(frozen=True)
class MeasuredPerturbation:
    """
    P over J windows of a run of n joints.

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
        """P that is not predicted, shape (J, n) [N·m], or nan."""
        return self.measured - self.predicted

    @property
    def peak(self) -> Array:
        """
        Largest |P| of each joint, shape (n,) [N·m].

        It is that of the envelope with what is not predicted, or that measured where the joint
        does not slide, before it breaks away.
        """
        slides = np.isfinite(self.predicted) & self.trusted[:, None]
        sliding = np.where(slides, self.envelope, 0.0).max(axis=0, initial=0.0) + self.tail
        at_rest = [tail_bound(np.abs(torque[self.trusted & ~is_sliding]))
                   for torque, is_sliding in zip(self.measured.T, slides.T)]
        return np.asarray(np.maximum(sliding, at_rest))

    def outliers(self) -> Iterator[Finding]:
        """Yield the joints with outliers, which the peak excludes."""
        residual = np.abs(np.nan_to_num(self.residual))
        is_far = (residual > _OUTLIER_BOUNDS * self.tail) & ~self.trusted[:, None]
        for joint in np.flatnonzero(is_far.any(axis=0)).tolist():
            size = np.where(is_far[:, joint], residual[:, joint], 0.0)
            k = int(np.argmax(size))
            yield Finding(Reason.OUTLIERS, Severity.CARE, joint, {
                'count': np.count_nonzero(size), 'torque': size[k], 't': self.t[k]})

    def break_away(self) -> Iterator[Finding]:
        """Yield the joints with more friction at rest than sliding shows."""
        at_rest = self.trusted[:, None] & ~np.isfinite(self.predicted)
        excess = np.abs(self.measured) - self.envelope
        for joint in range(len(self.tail)):
            beyond = tail_bound(np.maximum(excess[at_rest[:, joint], joint], 0.0))
            level = float(np.median(self.envelope[:, joint]))
            if beyond > max(3.0 * self.tail[joint], 0.1 * level):
                yield Finding(Reason.BREAK_AWAY, Severity.CARE, joint, {'torque': beyond})


def measure_perturbation(identified: Identification, corrected: bool) -> MeasuredPerturbation:
    """
    Return P of the identified run.

    Parameters
    ----------
    identified : Identification
        Result of `identify`.
    corrected : bool
        Whether the model that P is about has the identified bodies.

    """
    fit, data = identified.fit, identified.fit.data
    windows = data.windows
    bodies = np.zeros_like(data.torque)
    if fit.unknowns.body_count:
        bodies = windows.bodies @ fit.body_change()
    is_known = data.torque != 0.0
    measured = np.where(is_known, data.torque - windows.model_torque - bodies * corrected, 0.0)
    error = bodies * (not corrected)
    friction = [fit.torque(joint, tuple(TermKind)) for joint in range(data.joint_count)]
    slides = data.used & (windows.resting < 1e-9)
    predicted = np.where(slides, np.stack(friction, axis=1) + error, np.nan)
    residual = np.abs(measured - predicted)
    bound = np.array([tail_bound(x[np.isfinite(x)]) for x in residual.T])
    size = np.array([np.median(np.abs(x[used])) if used.any() else 0.0
                     for x, used in zip(measured.T, data.used.T)])
    limit = np.maximum(_OUTLIER_BOUNDS * bound, bound + 0.1 * size)
    is_far = np.any(residual > limit, axis=1)
    # Four windows on each side of an outlier share samples with it.
    trusted = np.convolve(is_far, np.ones(9), 'same') < 0.5
    load = np.maximum(np.abs(windows.load), np.abs(data.torque))
    envelope = np.abs(error) + largest_friction(identified, windows.velocity, load, 0.0)
    return MeasuredPerturbation(
        t=windows.t,
        measured=measured,
        predicted=predicted,
        envelope=envelope,
        trusted=trusted,
        tail=np.array([tail_bound(x[np.isfinite(x) & trusted]) for x in residual.T]),
        error=np.abs(error[trusted]).max(axis=0, initial=0.0))


def tail_bound(sizes: Array) -> float:
    """
    Return about the largest magnitude of (N,), without single outliers.

    From the quantiles of 90 and 99 % on, the logarithm of the fraction beyond is taken as
    straight. This is right for exponential tails and too much for lighter ones.
    """
    largest = float(sizes.max(initial=0.0))
    if len(sizes) < 100:
        return largest
    ninety, ninety_nine = np.percentile(sizes, (90.0, 99.0)).tolist()
    decades = np.log10(len(sizes) / 100.0)
    return min(largest, float(ninety_nine + (ninety_nine - ninety) * decades))


def friction_at(
        friction: JointFriction,
        velocity: Array,
        load: Array | float,
        halves: float = 0.0) -> Array:
    """
    Return the friction of a joint [N·m].

    Parameters
    ----------
    friction : JointFriction
        Identified friction.
    velocity : ndarray, shape (S,)
        Velocity of sliding [rad/s]. The sign of a zero is its direction.
    load : ndarray, shape (S,), or float
        Magnitude of the torque of the drive [N·m].
    halves : float
        Half intervals by which each number is larger.

    """
    def number(estimate: Estimate) -> float:
        return 0.0 if estimate.value is None else estimate.value + halves * estimate.half

    direction = np.copysign(1.0, velocity)
    coulomb = np.where(direction > 0.0, number(friction.forwards), number(friction.backwards))
    slow = np.exp(-np.square(velocity / (friction.stribeck_velocity.value or 1.0)))
    dry = coulomb + number(friction.stribeck) * slow + number(friction.load) * np.abs(load)
    return np.asarray(direction * dry + number(friction.viscous) * velocity)


def largest_friction(
        identified: Identification,
        velocity: Array,
        load: Array,
        halves: float) -> Array:
    """Return the larger friction of both directions, shape (S, n) [N·m]."""
    columns = []
    for friction, speed, torque in zip(identified.friction, velocity.T, load.T):
        forwards = friction_at(friction, np.copysign(speed, 1.0), torque, halves)
        backwards = friction_at(friction, np.copysign(speed, -1.0), torque, halves)
        columns.append(np.maximum(np.abs(forwards), np.abs(backwards)))
    return np.stack(columns, axis=1)
