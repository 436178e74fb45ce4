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

"""What the sensors do: step of the encoders, noise and lag of the velocities, period."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses

from ctc_chattering.bags.recording import BRIDGED, Recording
from ctc_chattering.identification.findings import ALL_JOINTS, Estimate, Finding, Kind, NONE
from ctc_chattering.identification.least_squares import coefficients
from ctc_chattering.identification.weak_form import position_noise, smooth, velocity_deviation
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.stats import median_abs_deviation  # type: ignore[import-untyped]

#: Part of the steps that must be a multiple of an encoder's.
_MULTIPLES = 0.98
#: Smallest step that counts, relative to the position: less is rounding of numbers.
_ROUNDING = 1e-13
#: Shortest lag of a velocity that is named, in periods: the smoothing's own errors are less.
_SHORTEST = 0.03
#: Half an interval of a velocity over the change of the position, in deviations of independent
#: samples: few are.
_INDEPENDENT = 20.0
#: Samples that noise and step are computed from, at most.
_ENOUGH = 200_000
#: RMS velocity of a joint that rests: in deviations of what positions show, and at least [rad/s].
_RESTS, _STILL = 3.0, 1e-6


@dataclasses.dataclass(frozen=True)
class Clock:
    """
    The stamps of a recording.

    Attributes
    ----------
    period, jitter, longest : float
        Mean step, standard deviation of the steps, and the longest one [s].
    missing : int
        Samples that are missing.
    pauses : tuple of (float, float)
        Begin and length of gaps that are too long to be bridged [s].

    """

    period: float
    jitter: float
    longest: float
    missing: int
    pauses: tuple[tuple[float, float], ...]


def clock(recording: Recording) -> Clock:
    """Return what the stamps of a checked recording say."""
    step, period = np.diff(recording.t), recording.period
    near = step[np.abs(step - period) < 0.5 * period]
    long = np.flatnonzero(step > (BRIDGED + 1.5) * period)
    missing = round(float(step.sum()) / period) - len(step)
    return Clock(period, float(near.std()), float(step.max()), max(missing, 0),
                 tuple((float(recording.t[k] - recording.t[0]), float(step[k])) for k in long))


def stamp_findings(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Yield what is wrong with the stamps of checked recordings."""
    for recording in recordings:
        step, period = np.diff(recording.t), recording.period
        near = np.where(np.abs(step - period) < 0.5 * period, step, np.nan)
        tenths = np.array([np.nanmean(x) for x in np.array_split(near, 10)
                           if np.isfinite(x).any()])
        drift = float(np.ptp(tenths)) / period
        chance = np.nanstd(near) / period / np.sqrt(0.1 * len(step))
        if drift - 5.0 * chance > Kind.PERIOD_DRIFT.care:
            yield Finding(Kind.PERIOD_DRIFT, ALL_JOINTS, f'{recording.name}: the period drifts by '
                          f'{drift:.2%} during the run: delays in samples and times do not agree',
                          'stamp the states with the clock of the control loop',
                          drift - 5.0 * chance)


def encoder_step(q: Array) -> Estimate:
    """
    Return the step of an encoder from positions q, shape (N,) [rad].

    It is the least difference of two positions, improved by all small ones, if nearly all
    differences are multiples of it.
    """
    levels = np.unique(q[:_ENOUGH])
    rounding = _ROUNDING * max(1.0, float(np.abs(q).max()))
    steps = np.diff(levels)
    steps = steps[steps > rounding]
    if len(steps) < 20:
        return Estimate.none('it hardly moves')
    few = np.sort(steps)
    least = float(few[: max(1, len(few) // 100)].mean())
    small = steps[steps < 20.0 * least]
    count = np.rint(small / least)
    least = float(small.sum() / count.sum())
    off = np.abs(small / least - np.rint(small / least))
    if (off < 0.02 + rounding / least).mean() < _MULTIPLES:
        return Estimate.none('no step shows')
    return Estimate(least, unit='rad')


def velocity_noise(recording: Recording, period: float
                   ) -> tuple[list[Estimate], list[Estimate], list[Finding]]:
    """
    Return noise [rad/s] and lag [s] of the measured velocity of each joint, and findings.

    The velocity is compared with that of the smoothed positions. Where it is no such velocity,
    its noise is not known, and the joint is refused.
    """
    n = len(recording.joints)
    if recording.dq is None:
        reason = Estimate.none('no velocities in the bag')
        return [reason] * n, [reason] * n, []
    dq = recording.dq[:_ENOUGH]
    q = recording.q[:_ENOUGH]
    known = velocity_deviation(period) * position_noise(q, period)
    noise, lag, findings = [], [], []
    for i, name in enumerate(recording.joints):
        moved = smooth(q[:, i], period, 1)
        rest = dq[:, i] - moved
        use = np.isfinite(rest)
        x, y = smooth(q[:, i], period, 2)[use], rest[use]
        ratio, error = _ratio(dq[use, i], moved[use], x, max(_RESTS * known[i], _STILL))
        most = Kind.VELOCITY_RATIO.refused
        if abs(ratio - 1.0) - error > most:
            what = (f'the velocity of {name} is {ratio:.3g} ± {error:.1g} times the change of its '
                    f'position, allowed: {1.0 - most:g} to {1.0 + most:g}')
            findings.append(Finding(
                Kind.VELOCITY_RATIO, i, f'{what}: another unit, as degrees (57.3), another sign '
                'or another joint; laws that use velocities diverge with it',
                'correct the velocities in joint_states, or record without them',
                abs(ratio - 1.0) - error))
            noise.append(Estimate.none(what))
            lag.append(Estimate.none(what))
            continue
        # A lag shows where the joint accelerates, not where it stops or jerks.
        calm = np.abs(x) <= np.percentile(np.abs(x), 95.0)
        power = float(x[calm].dot(x[calm]))
        slope = -float(x[calm].dot(y[calm])) / power if power else 0.0
        left = y[calm] + slope * x[calm]
        spread = float(median_abs_deviation(left, scale='normal'))
        noise.append(Estimate(float(np.sqrt(max(spread ** 2 - known[i] ** 2, 0.0))), unit='rad/s'))
        error = 2.0 * spread / np.sqrt(power) if power else np.inf
        if error >= 0.5 * period:
            lag.append(Estimate.none('it hardly accelerates'))
        else:
            shows = abs(slope) > max(error, _SHORTEST * period)
            lag.append(Estimate(slope, float(error), 's') if shows else Estimate.none(NONE))
    return noise, lag, findings


def _ratio(dq: Array, moved: Array, change: Array, least: float) -> tuple[float, float]:
    """
    Return a velocity over that of the positions, with half its interval.

    Parameters
    ----------
    dq, moved, change : ndarray, shape (N,)
        Measured velocity, and velocity and acceleration of the smoothed positions; what goes with
        the acceleration is a lag.
    least : float
        RMS velocity below which a joint rests, and nothing is compared [rad/s].

    """
    length = float(np.linalg.norm(moved))
    if length <= least * np.sqrt(len(moved)):
        return 1.0, 0.0
    x = np.column_stack((moved, change))
    value = coefficients(x, dq)
    spread = float(np.sqrt(np.square(dq - x @ value).mean()))
    return float(value[0]), _INDEPENDENT * spread / length
