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
Sensors: encoders, velocities and stamps.

`identify` takes these numbers from recordings for the results, and for the sensors of trial runs.
"""

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

#: Largest relative difference between a velocity and the change of its position.
_MAX_RATIO_ERROR = 0.1
#: RMS velocity of a joint at rest, in deviations of what positions show.
_RESTING_DEVIATIONS = 3.0
#: RMS velocity below which a joint is at rest in any case [rad/s].
_RESTING_VELOCITY = 1e-6


@dataclasses.dataclass(frozen=True)
class Clock:
    """
    Stamps of a recording.

    Attributes
    ----------
    period : float
        Mean step [s].
    missing : int
        Samples that are missing.

    """

    period: float
    missing: int

    @classmethod
    def of(cls, recording: Recording, period: float) -> Clock:
        """Return the clock of a checked recording."""
        step = np.diff(recording.t)
        return cls(period, max(round(float(step.sum()) / period) - len(step), 0))


def estimate_encoder_step(q: Array) -> Estimate:
    """
    Return the step of an encoder [rad] from positions, shape (N,).

    It is the least difference of two positions, improved by all small ones, if nearly all
    differences are multiples of it.
    """
    levels = np.unique(q[:200_000])
    # Smaller steps are rounding of numbers.
    rounding = 1e-13 * max(1.0, float(np.abs(q).max()))
    steps = np.diff(levels)
    steps = np.sort(steps[steps > rounding])
    if len(steps) < 20:
        return Estimate.unknown(Gap.HARDLY_MOVES)
    step = float(steps[:max(1, len(steps) // 100)].mean())
    multiples = steps[steps < 20.0 * step]
    step = float(multiples.sum() / np.rint(multiples / step).sum())
    ratio = multiples / step
    is_multiple = np.abs(ratio - np.rint(ratio)) < 0.02 + rounding / step
    if is_multiple.mean() < 0.98:
        return Estimate.unknown(Gap.NO_STEP)
    return Estimate(step, unit='rad')


class Positions(NamedTuple):
    """
    Summary of recorded positions of n joints [rad].

    Attributes
    ----------
    ends : ndarray, shape (2, n)
        Ends of the range, without 2 % of the samples at each.
    noise : ndarray, shape (n,)
        Deviation from local cubics.
    poses : ndarray, shape (K, n)
        About 20 of them, the first one first.

    """

    ends: Array
    noise: Array
    poses: Array

    @classmethod
    def of(cls, recordings: Sequence[Recording], period: float) -> Positions:
        """Return the summary of recordings with about this period [s]."""
        step = max(1, sum(len(x.q) for x in recordings) // 20)
        columns = []
        for joint in range(len(recordings[0].joints)):  # Joint by joint, for long series.
            q = np.concatenate([x.q[:, joint] for x in recordings])
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
        Deviation of each joint's velocity [rad/s].
    findings : list of Finding
        Joints whose velocity does not match their position.

    """

    estimates: list[Estimate]
    findings: list[Finding]


def estimate_velocity_noise(recording: Recording, period: float) -> VelocityNoise:
    """
    Return the noise of the measured velocity of each joint.

    The velocity is compared with that of the smoothed positions, beside a lag. Where it does not
    match, its noise is not known, and the joint is refused. The residual is noise only where
    successive samples differ as much as independent ones.
    """
    if recording.dq is None:
        unknown = Estimate.unknown(Gap.NO_VELOCITIES)
        return VelocityNoise([unknown] * len(recording.joints), [])
    dq = recording.dq[:KEPT_VELOCITY_ROWS]
    q = recording.q[:KEPT_VELOCITY_ROWS]
    shown = velocity_deviation(period) * position_noise(q, period)
    estimates = []
    findings = []
    for joint in range(len(recording.joints)):
        smoothing_noise = float(shown[joint])
        comparison = _compare(q[:, joint], dq[:, joint], period, smoothing_noise)
        if abs(comparison.ratio - 1.0) - comparison.error > _MAX_RATIO_ERROR:
            estimates.append(Estimate.unknown(Gap.OTHER_VELOCITY))
            findings.append(_other_velocity_unit(joint, comparison))
        else:
            estimates.append(_estimate_noise(comparison, smoothing_noise))
    return VelocityNoise(estimates, findings)


class _VelocityComparison(NamedTuple):
    """
    Measured velocity, as a factor of the change of the position.

    Attributes
    ----------
    ratio, error : float
        Factor, with half its interval.
    residual : ndarray, shape (rows,)
        Velocity beyond that [rad/s].
    speed : float
        RMS velocity [rad/s].

    """

    ratio: float
    error: float
    residual: Array
    speed: float


def _compare(q: Array, dq: Array, period: float, smoothing_noise: float) -> _VelocityComparison:
    """Return a velocity [rad/s] compared with a position [rad], each (N,)."""
    # The part along the acceleration is a lag. Joints that stop or jerk have more.
    columns = np.column_stack([smooth(q, period, order) for order in (1, 2)])
    acceleration = np.abs(columns[:, 1])
    is_calm = (acceleration <= np.percentile(acceleration, 95.0)) & np.isfinite(dq)
    columns = columns[is_calm]
    target = dq[is_calm]
    sizes = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    value = np.linalg.lstsq(columns / sizes, target, rcond=None)[0] / sizes
    residual = target - columns @ value
    speed = float(sizes[0]) / np.sqrt(max(len(target), 1))
    is_at_rest = speed <= max(_RESTING_DEVIATIONS * smoothing_noise, _RESTING_VELOCITY)
    # Half an interval is 20 deviations of independent samples, since few are independent.
    error = 20.0 * float(np.sqrt(np.square(residual).mean())) / float(sizes[0])
    return _VelocityComparison(1.0 if is_at_rest else float(value[0]), error, residual, speed)


def _other_velocity_unit(joint: int, comparison: _VelocityComparison) -> Finding:
    """Return the finding on a velocity of another unit."""
    return Finding(Reason.VELOCITY, Severity.REFUSED, joint, {
        'ratio': comparison.ratio, 'error': comparison.error,
        'low': 1.0 - _MAX_RATIO_ERROR, 'high': 1.0 + _MAX_RATIO_ERROR})


def _estimate_noise(comparison: _VelocityComparison, smoothing_noise: float) -> Estimate:
    """Return the noise of a velocity beyond that of smoothing [rad/s]."""
    spread = deviation(comparison.residual)
    step_deviation = deviation(np.diff(comparison.residual)) / np.sqrt(2.0)
    size = float(np.sqrt(max(spread ** 2 - smoothing_noise ** 2, 0.0)))
    # A filter makes steps smaller, and differences of positions make them larger.
    if 0.8 * size <= step_deviation <= 1.5 * size:
        return Estimate(size, unit='rad/s')
    # A thousandth of the velocity is rounding.
    if spread <= max(_RESTING_DEVIATIONS * smoothing_noise, 1e-3 * comparison.speed):
        return Estimate.none(at_most=max(spread, _RESTING_VELOCITY), unit='rad/s')
    return Estimate.unknown(Gap.FILTERED)
