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

"""Sensors: step of the encoders, noise of the velocities, period of the stamps."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import NamedTuple

from ctc_chattering.identification.findings import Estimate, Finding, Gap, Reason, Severity
from ctc_chattering.identification.recording import KEPT_VELOCITY_ROWS, Recording
from ctc_chattering.identification.weak_form import (
    deviation,
    position_noise,
    smooth,
    velocity_deviation,
)
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Part of the steps that must be a multiple of an encoder's.
MULTIPLES = 0.98
#: Difference from a multiple, as a part of the step.
MULTIPLE_ERROR = 0.02
#: Fewest steps of an encoder.
FEWEST_STEPS = 20
#: Smallest step that counts, relative to the position: less is rounding of numbers.
ROUNDING = 1e-13
#: Half an interval of a velocity over the change of the position, in deviations of independent
#: samples: few are.
INDEPENDENT = 20.0
#: Deviation of noise by differences of successive samples over that of the samples, at least: a
#: filter makes it smaller.
LEAST_WHITE = 0.8
#: The same at most: differences of positions make it larger.
MOST_WHITE = 1.5
#: Deviation of a velocity from the change of the position, as a part of it, that is rounding.
EXACT = 1e-3
#: Part by which velocities may differ from changes of positions.
MOST_RATIO_ERROR = 0.1
#: Samples that a step is computed from, at most.
MOST_SAMPLES = 200_000
#: Poses that are kept.
POSES = 20
#: RMS velocity of a joint that rests, in deviations of what positions show.
RESTING_DEVIATIONS = 3.0
#: RMS velocity of a joint that rests, at least [rad/s].
RESTING_VELOCITY = 1e-6


@dataclasses.dataclass(frozen=True)
class Clock:
    """
    The stamps of a recording.

    Attributes
    ----------
    period : float
        Mean step [s].
    missing : int
        Samples that are missing.

    """

    period: float
    missing: int


def clock(recording: Recording, period: float) -> Clock:
    """Return what the stamps of a checked recording say."""
    step = np.diff(recording.t)
    return Clock(period, max(round(float(step.sum()) / period) - len(step), 0))


def encoder_step(q: Array) -> Estimate:
    """
    Return the step of an encoder from positions q, shape (N,) [rad].

    It is the least difference of two positions, improved by all small ones, if nearly all
    differences are multiples of it.
    """
    levels = np.unique(q[:MOST_SAMPLES])
    rounding = ROUNDING * max(1.0, float(np.abs(q).max()))
    steps = np.diff(levels)
    steps = np.sort(steps[steps > rounding])
    if len(steps) < FEWEST_STEPS:
        return Estimate.unknown(Gap.HARDLY_MOVES)
    step = float(steps[:max(1, len(steps) // 100)].mean())
    small = steps[steps < 20.0 * step]
    step = float(small.sum() / np.rint(small / step).sum())
    off = np.abs(small / step - np.rint(small / step))
    if (off < MULTIPLE_ERROR + rounding / step).mean() < MULTIPLES:
        return Estimate.unknown(Gap.NO_STEP)
    return Estimate(step, unit='rad')


class Positions(NamedTuple):
    """
    Summary of recorded positions, which are large; n joints [rad].

    Attributes
    ----------
    ends : ndarray, shape (2, n)
        Of the range, but for 2 % at both.
    noise : ndarray, shape (n,)
        Deviation from local cubics.
    poses : ndarray, shape (K, n)
        Some of them, the first one first.

    """

    ends: Array
    noise: Array
    poses: Array

    @classmethod
    def of(cls, recordings: Sequence[Recording], period: float) -> Positions:
        """Return that of recordings with about this period [s]."""
        columns = []
        step = max(1, sum(len(x.q) for x in recordings) // POSES)
        for i in range(len(recordings[0].joints)):  # Joint by joint, for long series.
            q = np.concatenate([x.q[:, i] for x in recordings])
            noise = position_noise(q[:, None], period)[0]
            columns.append((np.percentile(q, (2.0, 98.0)), noise, q[::step].copy()))
        ends, noises, poses = map(np.array, zip(*columns))
        return cls(ends.T, noises, poses.T)


class VelocityNoise(NamedTuple):
    """
    Noise of measured velocities.

    Attributes
    ----------
    estimates : list of Estimate, length n
        Deviation of each joint's [rad/s].
    findings : list of Finding
        Joints whose velocity is none of their position.

    """

    estimates: list[Estimate]
    findings: list[Finding]


def velocity_noise(recording: Recording, period: float) -> VelocityNoise:
    """
    Return the noise of the measured velocity of each joint.

    The velocity is compared with that of the smoothed positions, beside a lag. Where it is no such
    velocity, its noise is not known, and the joint is refused. What is left is noise only where
    successive samples differ as much as independent ones.
    """
    if recording.dq is None:
        unknown = Estimate.unknown(Gap.NO_VELOCITIES)
        return VelocityNoise([unknown] * len(recording.joints), [])
    dq, q = recording.dq[:KEPT_VELOCITY_ROWS], recording.q[:KEPT_VELOCITY_ROWS]
    known = velocity_deviation(period) * position_noise(q, period)
    estimates, findings = [], []
    for joint in range(len(recording.joints)):
        comparison = _compare(q[:, joint], dq[:, joint], period, float(known[joint]))
        off = abs(comparison.ratio - 1.0) - comparison.error
        if off > MOST_RATIO_ERROR:
            estimates.append(Estimate.unknown(Gap.OTHER_VELOCITY))
            findings.append(_other_unit(joint, comparison))
        else:
            estimates.append(_noise(comparison, float(known[joint])))
    return VelocityNoise(estimates, findings)


class _VelocityComparison(NamedTuple):
    """A measured velocity as a factor of the change of the position, and what is left of it."""

    ratio: float
    error: float
    residual: Array
    speed: float


def _compare(q: Array, dq: Array, period: float, known: float) -> _VelocityComparison:
    """Return the comparison of a velocity [rad/s] with a position [rad], shape (N,) each."""
    # What goes with the acceleration is a lag; joints that stop or jerk have more.
    columns = np.column_stack([smooth(q, period, order) for order in (1, 2)])
    limit = np.percentile(np.abs(columns[:, 1]), 95.0)
    calm = (np.abs(columns[:, 1]) <= limit) & np.isfinite(dq)
    columns, target = columns[calm], dq[calm]
    sizes = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    value = np.linalg.lstsq(columns / sizes, target, rcond=None)[0] / sizes
    residual = target - columns @ value
    speed = float(sizes[0]) / np.sqrt(max(len(target), 1))
    rests = speed <= max(RESTING_DEVIATIONS * known, RESTING_VELOCITY)
    error = INDEPENDENT * float(np.sqrt(np.square(residual).mean())) / float(sizes[0])
    return _VelocityComparison(1.0 if rests else float(value[0]), error, residual, speed)


def _other_unit(joint: int, comparison: _VelocityComparison) -> Finding:
    """Return the finding of a velocity that is none of its position."""
    return Finding(Reason.VELOCITY, Severity.REFUSED, joint, {
        'ratio': comparison.ratio, 'error': comparison.error,
        'low': 1.0 - MOST_RATIO_ERROR, 'high': 1.0 + MOST_RATIO_ERROR})


def _noise(comparison: _VelocityComparison, known: float) -> Estimate:
    """Return the noise of a velocity; `known` is that of the smoothed positions [rad/s]."""
    spread = deviation(comparison.residual)
    apart = deviation(np.diff(comparison.residual)) / np.sqrt(2.0)
    size = float(np.sqrt(max(spread ** 2 - known ** 2, 0.0)))
    if LEAST_WHITE * size <= apart <= MOST_WHITE * size:
        return Estimate(size, unit='rad/s')
    if spread <= max(RESTING_DEVIATIONS * known, EXACT * comparison.speed):
        return Estimate.none(at_most=max(spread, RESTING_VELOCITY), unit='rad/s')
    return Estimate.unknown(Gap.FILTERED)
