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
Gains of `observer_feedback` for an identified robot.

`identified_robot` calls this with the numbers of a run. The trial runs choose among the options
that it returns, and `sentences` gives the reasons of the gains.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from math import floor, isfinite
from typing import Any, NamedTuple

from ctc_chattering.control.recommended_gains import (
    estimator_bandwidth,
    largest_pole,
    lateness,
    observer_bandwidth,
    RECOMMENDED_LAW,
    RECOMMENDED_SWITCHING,
)
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.findings import Finding, Reason, Severity
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import MeasuredPerturbation
from ctc_chattering.identification.perturbation_bound import bound_perturbation, PerturbationBound
from ctc_chattering.identification.verdict import verdicts
from ctc_chattering.number_format import round_number, round_towards
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@dataclasses.dataclass(frozen=True)
class GainLimits:
    """Limits of the recommended gains."""

    #: Time in which friction may change its sign [s].
    reversal_s: float = 0.02
    #: Time in which the rate of the drives must reach the weight of the arm [s]. They may begin
    #: without torque.
    carried_s: float = 0.03
    #: Range of possible lags up to which a lag is known [s].
    known_lag_s: float = 0.003
    #: Smallest rate to ask for [N·m/s].
    min_rate: float = 1.0
    #: Largest observer bandwidth [rad/s].
    max_bandwidth: float = 1200.0
    #: Parts of the fastest pole that the trial runs try in turn.
    pole_parts: tuple[float, ...] = (1.0, 0.7, 0.5, 0.35, 0.25)


GAIN_LIMITS = GainLimits()
#: Parameters of the controller.
Gains = dict[str, Any]


class RateLimit(NamedTuple):
    """`torque_rate_limit`, shape (n,) [N·m/s], with findings on the drives."""

    rate: Array
    findings: tuple[Finding, ...]


def torque_rate(
    identified: Identification,
    fastest: Array,
    declared: Sequence[float] = (),
    weight: Array | float = 0.0,
) -> RateLimit:
    """
    Return the rate limit for the law.

    Friction and motion need a rate, and so does carrying the arm at the start, when drives may be
    without torque. The limit is never above the drive's own rate. A drive that is slower than the
    configured limit makes the loop diverge. One that is faster costs little. Where the lag is
    inverted, commands change by up to R (2 T + h) a period. For drives whose rate is known, R is
    so small that this is within what they do in a period, if that is enough.

    Parameters
    ----------
    identified : Identification
        Numbers of a run.
    fastest : ndarray, shape (n,)
        Change of the model's torque as fast as the limits allow [N·m/s].
    declared : sequence of float, shape (n,), optional
        Rate that the drives allow [N·m/s].
    weight : ndarray, shape (n,), or float
        Largest torque of the model at rest, in the poses of the run [N·m].

    """
    friction = np.array([joint.at_rest for joint in identified.friction])
    reversal = 2.0 * friction / GAIN_LIMITS.reversal_s
    needed = np.maximum(reversal, fastest).clip(min=GAIN_LIMITS.min_rate)
    identified_rate = [np.nan if x.value is None else x.value - x.half for x in identified.rate]
    drive = np.array(declared or identified_rate or [np.nan] * len(needed))
    drive = np.where(drive > 0.0, drive, np.nan)
    smallest = drive / (1.0 + 2.0 * longest_lag(identified) / identified.clock.period)
    findings = [
        Finding(
            Reason.SLOW_DRIVE,
            Severity.CARE,
            joint,
            {'rate': drive[joint], 'needed': needed[joint], 'reversal_s': GAIN_LIMITS.reversal_s},
        )
        for joint in np.flatnonzero(drive < needed).tolist()
    ]
    if np.isnan(drive).any():
        findings.append(Finding(Reason.NO_RATE, Severity.NOTE))
    # Lags that may be anything are those of elastic joints, say: fast commands make them swing.
    lags = np.array(list(identified.timing.delays.values()))
    is_known = len(lags) and np.ptp(lags, axis=(0, 1)).max() <= GAIN_LIMITS.known_lag_s
    wanted = np.maximum(needed, weight / GAIN_LIMITS.carried_s if is_known else 0.0)
    rate = np.where(np.isfinite(drive), np.clip(wanted, smallest, drive), wanted)
    return RateLimit(rate, tuple(findings))


def longest_lag(identified: Identification) -> Array:
    """Return the longest possible lag of each drive, shape (n,) [s]."""
    timing = identified.timing
    possible = [lags[2] for lags in timing.delays.values()] or [timing.drive.lag]
    return np.asarray(np.max(possible, axis=0))


class LatestTorque(NamedTuple):
    """Slowest possible pair of delay and lag [s, s, samples]."""

    lateness: float
    lag: float
    delay: int


class GainBasis(NamedTuple):
    """
    Numbers that the gains follow from.

    Attributes
    ----------
    run : MeasuredPerturbation
        P of the run.
    bound : PerturbationBound
        ka and its parts.
    delays : tuple of int
        Possible delays of the torque [samples].
    period : float
        Sample period h [s].
    longest_lag : float
        Longest possible lag of any drive [s].
    latest : LatestTorque
        Slowest pair of delay and lag.
    resolution : float
        Step or noise of the positions [rad].
    estimator_ratio : float
        Bandwidth of the estimator over the pole.

    """

    run: MeasuredPerturbation
    bound: PerturbationBound
    delays: tuple[int, ...]
    period: float
    longest_lag: float
    latest: LatestTorque
    resolution: float
    estimator_ratio: float


class Draw(NamedTuple):
    """
    Simulated robot within the intervals.

    Attributes
    ----------
    delay : int
        Delay of its drives [samples].
    lag : ndarray, shape (n,)
        Lag of its drives [s].
    model_scale : float
        Factor of M, C and G that the controller has.
    friction_end : int
        End of the interval of friction, -1 or 1.
    values : dict
        Values of plant and controller.

    """

    delay: int
    lag: Array
    model_scale: float
    friction_end: int
    values: dict[str, dict[str, Any]]


class FailedDraw(NamedTuple):
    """
    Simulated robot on which gains failed.

    Attributes
    ----------
    number : int
        Number of the draw, from 1.
    draw : Draw
        The robot.
    failure : str
        Why the run has no errors, empty if it has.
    joint : str
        Joint with the largest error in proportion to the allowed one, if any.
    error, allowed : float
        Its RMS error, and the allowed one [rad].
    saturated : float
        Part of the time with a torque at its limit.

    """

    number: int
    draw: Draw
    failure: str = ''
    joint: str = ''
    error: float = 0.0
    allowed: float = 0.0
    saturated: float = 0.0


class GainTrial(NamedTuple):
    """Trial runs with one pole [rad/s]: draws, and the first failure."""

    pole: float
    draws: int
    failed: FailedDraw | None = None


@dataclasses.dataclass(frozen=True)
class Recommendation:
    """
    Gains for the controller of n joints.

    Attributes
    ----------
    values : dict
        Parameters of the controller. Those of an unusable joint are None.
    basis : GainBasis
        Numbers that they follow from.
    findings : tuple of Finding
        Doubts about the gains.
    options : tuple of dict
        `values`, and more careful ones, each more than the one before.
    trials : tuple of GainTrial
        Results of trial runs, if any.

    """

    values: Gains
    basis: GainBasis
    findings: tuple[Finding, ...] = ()
    options: tuple[Gains, ...] = ()
    trials: tuple[GainTrial, ...] = ()

    @property
    def pole(self) -> float:
        """Double pole of the loop [rad/s]."""
        return pole_of(self.values)


def pole_of(gains: Gains) -> float:
    """Return the double pole of a loop with these gains [rad/s]."""
    return float(0.5 * gains['kv'][0])


def recommend(
    identified: Identification,
    run: MeasuredPerturbation,
    model: Model,
    rate: Sequence[float] = (),
    corrected: bool = False,
) -> Recommendation:
    """
    Return gains.

    Parameters
    ----------
    identified : Identification
        Numbers of a run.
    run : MeasuredPerturbation
        P of the run.
    model : Model
        The controller's.
    rate : sequence of float, shape (n,), optional
        Rate that the drives allow [N·m/s].
    corrected : bool
        Whether the model has the identified bodies.

    """
    timing, period = identified.timing, identified.clock.period
    delay, lag, _ = timing.drive
    bound = bound_perturbation(identified, run, model, corrected)
    weight = [np.abs(model.gravity_torque(q.tolist())) for q in identified.positions.poses]
    drives = torque_rate(identified, bound.change, rate, np.max(weight, axis=0))
    level = [max(0.0, x.coulomb.value or 0.0) for x in identified.friction]
    usable = [x.usable for x in verdicts(identified)]
    possible = timing.delays or {0: lag}
    # The coarsest step of an encoder, or the noise of positions, if that is more.
    steps = [x.value or 0.0 for x in identified.encoder]
    resolution = max(float(identified.positions.noise.max()), *steps)
    basis = GainBasis(
        run=run,
        bound=bound,
        delays=tuple(timing.delays),
        period=period,
        longest_lag=float(longest_lag(identified).max()),
        latest=max(
            LatestTorque(lateness(float(lags.max()), period, k), float(lags.max()), k)
            for k, lags in possible.items()
        ),
        resolution=resolution,
        estimator_ratio=estimator_bandwidth(1.0, resolution),
    )

    def of_usable(values: Sequence[float] | Array) -> list[float | None]:
        return [round_number(float(x), 6) if good else None for x, good in zip(values, usable)]

    bandwidth = observer_bandwidth(basis.longest_lag, GAIN_LIMITS.max_bandwidth)
    shared: Gains = {
        'law': RECOMMENDED_LAW,
        'input_delay': int(delay) if isfinite(delay) else 0,
        'actuator_lag': [round_number(x) for x in lag],
        'switching': RECOMMENDED_SWITCHING,
        'observer_bandwidth': round_towards(bandwidth, 2, floor),
        'ka': of_usable(bound.ka),
        'friction_level': of_usable(level),
        'torque_rate_limit': of_usable(drives.rate),
    }
    options = tuple(
        {**shared, **_pole_gains(basis, factor, len(lag))} for factor in GAIN_LIMITS.pole_parts
    )
    return Recommendation(
        options[0],
        basis,
        (*run.outliers(), *run.break_away(), *bound.findings, *drives.findings),
        options,
    )


def _pole_gains(basis: GainBasis, factor: float, n: int) -> Gains:
    """Return the gains of n joints for a part of the fastest pole."""
    pole = round_towards(factor * largest_pole(basis.latest.lateness), 2, floor)
    return {
        'kp': [pole**2] * n,
        'kv': [2.0 * pole] * n,
        'estimator_bandwidth': basis.estimator_ratio * pole,
    }
