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
Bayesian linear regression of all torques, judged on held-out time.

The torque of joint j in a window is linear in the unknowns x, which have deviation 1 before any
data (`prior.py`):

    tau_j = model_j + X_j x + r_j,    r_j of variance σ_j² and correlation length L_j,    (BR1)

so x minimizes (x - x₀)ᵀ (x - x₀) + Σ_j |r_j|² / σ_j² with windows weighted by W_j. With
H = I + Σ_j X_jᵀ W_j X_j / σ_j² its covariance is

    H⁻¹ (I + Σ_j L_j X_jᵀ W_j X_j / σ_j²) H⁻¹.                                            (BR2)

σ_j and L_j are those of the torque that is *not* predicted in blocks of time that were left out.
So a part that a flexible model explains only of its own data counts as noise. L_j widens the
intervals, and is no weight: a joint that is predicted badly would be left to itself. Windows that
a joint rests in have its static friction as further variance. Windows far beyond the others, as
of a contact, lose weight. `selection` fits the terms of friction with this module.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from functools import cached_property
from typing import NamedTuple

from ctc_chattering.identification.friction_terms import FrictionTerm, NOT_NEGATIVE, TermKind
from ctc_chattering.identification.prior import BodyPrior, covariance_of, PhysicalBounds
from ctc_chattering.identification.windows import Windows
from ctc_chattering.numerics.linear_algebra import Array, Flags
import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit  # type: ignore[import-untyped]

#: Blocks of time of which one is left out at a time.
BLOCKS = 10
#: Rounds in which noise and weights follow from what is not predicted.
ROUNDS = 10
#: A joint rests in a window from this share of its time on.
RESTING_SHARE = 0.5
#: Fewest windows of a joint in motion that are fitted.
FEWEST_WINDOWS = 20
#: Deviations at which a window has half its weight.
OUTLIER_DEVIATIONS = 10.0
#: Smallest noise of a torque, as a part of its deviation.
MIN_NOISE = 1e-4
#: Probability of an interval.
CONFIDENCE = 0.95


@dataclasses.dataclass(frozen=True)
class Observations:
    """
    J windows with the torques of n joints.

    Attributes
    ----------
    windows : Windows
        Terms of the model.
    torque : ndarray, shape (J, n)
        Measured or commanded torque, 0 where it is not known [N·m].
    used : ndarray of bool, shape (J, n)
        Windows with a known torque in which the joint moves. A joint with few has none.
    drive_sign : ndarray, shape (J, n)
        Sign of the torque of each drive as it is predicted, for dead bands.

    """

    windows: Windows
    torque: Array
    used: Flags
    drive_sign: Array

    @classmethod
    def of(cls, windows: Windows, torque: Array) -> Observations:
        """Return windows with their torques, nan where unknown."""
        is_known = np.isfinite(torque)
        used = is_known & (windows.resting < RESTING_SHARE)
        used &= used.sum(axis=0) >= FEWEST_WINDOWS
        return cls(windows, np.where(is_known, torque, 0.0), used, mean_sign(windows.model_torque))

    def scaled(self, constant: Array) -> Observations:
        """Return it with torques times constants, shape (n,)."""
        return dataclasses.replace(self, torque=self.torque * constant)

    @property
    def joint_count(self) -> int:
        """Return the number of joints."""
        return int(self.torque.shape[1])

    @cached_property
    def beyond_model(self) -> Array:
        """Torque beyond the model, (J, n) [N·m], 0 if unused."""
        return np.where(self.used, self.torque - self.windows.model_torque, 0.0)

    @cached_property
    def deviation(self) -> Array:
        """Deviation of the torque, (n,) [N·m], 1 without motion."""
        sizes = [
            float(torque[used].std()) if used.any() else 0.0
            for torque, used in zip(self.torque.T, self.used.T)
        ]
        return np.array([size or 1.0 for size in sizes])

    @cached_property
    def fastest(self) -> Array:
        """Largest velocity, (n,) [rad/s], 1 at rest."""
        speed = np.abs(self.windows.velocity).max(axis=0, initial=0.0)
        return np.where(speed > 0.0, speed, 1.0)

    @property
    def moving(self) -> Flags:
        """Joints with enough windows in motion, shape (n,)."""
        return np.asarray(self.used.any(axis=0))


@dataclasses.dataclass(frozen=True)
class Unknowns:
    """
    The m unknowns of the regression: bodies, then friction.

    Attributes
    ----------
    prior : BodyPrior
        Of bodies, rotors and gravity.
    terms : tuple of FrictionTerm
        Columns of friction.

    """

    prior: BodyPrior
    terms: tuple[FrictionTerm, ...]

    @property
    def body_count(self) -> int:
        """Return the number of unknowns of the bodies."""
        return int(self.prior.transform.shape[1])

    @property
    def count(self) -> int:
        """Return the number m of unknowns."""
        return self.body_count + len(self.terms)

    @cached_property
    def mean(self) -> Array:
        """Unknowns before any data, shape (m,)."""
        return np.concatenate((self.prior.mean, np.zeros(len(self.terms))))

    @cached_property
    def bounds(self) -> PhysicalBounds:
        """Bounds of all unknowns."""
        positive = {
            self.body_count + k: 0.0
            for k, term in enumerate(self.terms)
            if term.kind in NOT_NEGATIVE
        }
        return self.prior.bounds.with_minimum(positive)

    def term(self, index: int) -> FrictionTerm:
        """Return the term of friction of an unknown."""
        return self.terms[index - self.body_count]

    def of_joint(self, joint: int) -> list[int]:
        """Return the indices of the terms of friction of a joint."""
        return [self.body_count + k for k, term in enumerate(self.terms) if term.joint == joint]

    def index(self, joint: int, term_kind: TermKind) -> int | None:
        """Return the index of a term of friction, if any."""
        for k in self.of_joint(joint):
            if self.term(k).kind == term_kind:
                return k
        return None

    def row(self, joint: int, term_kind: TermKind) -> Array:
        """
        Return the weights of x for a coefficient, shape (m,).

        They are 0 without such a term.
        """
        weights = np.zeros(self.count)
        index = self.index(joint, term_kind)
        if index is not None:
            weights[index] = self.term(index).size
        return weights

    def columns(self, data: Observations, joint: int) -> Array:
        """Return X of a joint, (J, m) [N·m], 0 if unused."""
        columns = np.zeros((len(data.torque), self.count))
        columns[:, : self.body_count] = data.windows.bodies[:, joint] @ self.prior.transform
        for k in self.of_joint(joint):
            columns[:, k] = self.term(k).column(data.windows, data.drive_sign)
        columns[~data.used[:, joint]] = 0.0
        return columns


@dataclasses.dataclass(frozen=True)
class Noise:
    """
    Torque that is not predicted, of n joints in J windows.

    Attributes
    ----------
    deviation : ndarray, shape (n,)
        σ [N·m].
    correlation : ndarray, shape (n,)
        L [windows].
    weights : ndarray, shape (J, n)
        W: 1 for a window like the others, less for an outlier or a joint that rests.

    """

    deviation: Array
    correlation: Array
    weights: Array

    @property
    def information(self) -> Array:
        """1 / σ² of each joint, shape (n,) [1/(N·m)²]."""
        return 1.0 / np.square(self.deviation)


@dataclasses.dataclass(frozen=True)
class Fit:
    """
    Solution of (BR1), of m unknowns, J windows and n joints.

    Attributes
    ----------
    data : Observations
        The windows.
    unknowns : Unknowns
        The columns.
    noise : Noise
        Torque that is not predicted.
    value : ndarray, shape (m,)
        x, within physical bounds.
    covariance : ndarray, shape (m, m)
        Of x.
    spread : ndarray, shape (m, m)
        Covariance of x by drawing blocks of time.
    left_out : ndarray, shape (BLOCKS, m)
        x, within physical bounds, without each block of time.

    """

    data: Observations
    unknowns: Unknowns
    noise: Noise
    value: Array
    covariance: Array
    spread: Array
    left_out: Array

    @cached_property
    def held_out(self) -> Array:
        """
        Torque of each block, predicted by the others, (J, n) [N·m].

        It is that beyond the model.
        """
        columns = [
            self.unknowns.columns(self.data, joint) for joint in range(self.data.joint_count)
        ]
        return _predicted(columns, blocks_of_time(len(self.data.torque)), self.left_out)

    def half_interval(self, weights: Array) -> Array:
        """Return half the interval of sums by weights, (..., m)."""
        normal = float(stdtrit(np.inf, 0.5 + 0.5 * CONFIDENCE))
        blocks = float(stdtrit(BLOCKS - 1.0, 0.5 + 0.5 * CONFIDENCE))
        halves = [
            factor * np.sqrt(np.maximum(((weights @ matrix) * weights).sum(axis=-1), 0.0))
            for factor, matrix in ((normal, self.covariance), (blocks, self.spread))
        ]
        return np.asarray(np.maximum(*halves))

    def torque(self, joint: int, kinds: Sequence[TermKind] | None = None) -> Array:
        """
        Return the torque beyond the model, (J,) [N·m].

        Given kinds of friction, it is theirs alone.
        """
        columns = self.unknowns.columns(self.data, joint)
        if kinds is None:
            return columns @ self.value
        chosen = [k for k in self.unknowns.of_joint(joint) if self.unknowns.term(k).kind in kinds]
        return columns[:, chosen] @ self.value[chosen]

    def body_change(self) -> Array:
        """Return the change of all body parameters, shape (P,)."""
        change = self.unknowns.prior.transform @ self.value[: self.unknowns.body_count]
        return np.asarray(change)


class _Sums(NamedTuple):
    """
    Sums Xᵀ W X / σ² and Xᵀ W y / σ².

    They are of each block, (BLOCKS, m, m) and (BLOCKS, m), or of several.
    """

    normal: Array
    right: Array

    def without(self, block: int) -> _Sums:
        """Return the sums over all other blocks."""
        kept = np.arange(BLOCKS) != block
        return _Sums(self.normal[kept].sum(axis=0), self.right[kept].sum(axis=0))

    def drawn(self, counts: Array) -> _Sums:
        """Return the sums over blocks with these counts, shape (BLOCKS,)."""
        return _Sums(np.tensordot(counts, self.normal, 1), counts @ self.right)

    def solve(self, mean: Array) -> Array:
        """Return the most likely unknowns by their prior mean, (m,)."""
        return np.asarray(np.linalg.solve(self.information, self.right + mean), float)

    @property
    def information(self) -> Array:
        """Information of the unknowns, shape (m, m)."""
        return self.normal + np.eye(len(self.normal))


class _NormalEquations:
    """Normal equations of each block and joint, for given weights."""

    def __init__(self, data: Observations, unknowns: Unknowns) -> None:
        self.data, self.unknowns = data, unknowns
        self.block = blocks_of_time(len(data.torque))
        self.columns = np.stack(
            [unknowns.columns(data, joint) for joint in range(data.joint_count)]
        )

    def covariance(self, noise: Noise, information: Array) -> Array:
        """Return the covariance by (BR2), (m, m), where `information` is H."""
        widened = dataclasses.replace(
            noise, deviation=noise.deviation / np.sqrt(noise.correlation)
        )
        spread = self.sums(widened).drawn(np.ones(BLOCKS)).information
        inverse = covariance_of(information)
        return inverse @ spread @ inverse

    def sums(self, noise: Noise) -> _Sums:
        """Return the sums of each block."""
        m = self.unknowns.count
        normal, right = np.zeros((BLOCKS, m, m)), np.zeros((BLOCKS, m))
        for joint, information in enumerate(noise.information.tolist()):
            weights = information * noise.weights[:, joint, None]
            for k in range(BLOCKS):
                rows = self.block == k
                columns = self.columns[joint][rows]
                weighted = (weights[rows] * columns).T
                normal[k] += weighted @ columns
                right[k] += weighted @ self.data.beyond_model[rows, joint]
        return _Sums(normal, right)

    def unexplained(self, left_out: Array) -> Array:
        """Return the held-out residual of each block, (J, n) [N·m]."""
        return self.data.beyond_model - _predicted(self.columns, self.block, left_out)


def blocks_of_time(count: int) -> npt.NDArray[np.intp]:
    """Return the block of each window, shape (count,)."""
    return np.minimum(np.arange(count) * BLOCKS // max(count, 1), BLOCKS - 1)


def fit(data: Observations, unknowns: Unknowns) -> Fit:
    """Return the solution of (BR1) with noise, intervals and held-out values."""
    equations, mean, bounds = _NormalEquations(data, unknowns), unknowns.mean, unknowns.bounds
    noise = _first_noise(data)
    for _ in range(ROUNDS):
        sums = equations.sums(noise)
        left_out = np.stack([sums.without(k).solve(mean) for k in range(BLOCKS)])
        shown = _shown_noise(
            data, unknowns, equations.unexplained(left_out), left_out.mean(axis=0)
        )
        noise = _between(noise, shown)
    sums = equations.sums(noise)
    whole = sums.drawn(np.ones(BLOCKS))
    without = [sums.without(k) for k in range(BLOCKS)]
    return Fit(
        data,
        unknowns,
        noise,
        bounds.nearest(whole.solve(mean), whole.information),
        equations.covariance(noise, whole.information),
        _block_spread(sums, mean),
        np.stack([bounds.nearest(x.solve(mean), x.information) for x in without]),
    )


def _predicted(
    columns: Sequence[Array] | Array, block: npt.NDArray[np.intp], values: Array
) -> Array:
    """Return the torque of each block by its values, (J, n)."""
    predicted = np.zeros((len(block), len(columns)))
    for k, value in enumerate(values):
        rows = block == k
        predicted[rows] = np.stack([x[rows] @ value for x in columns], axis=1)
    return predicted


def _block_spread(sums: _Sums, mean: Array) -> Array:
    """
    Return the covariance of x by drawing blocks, (m, m).

    Blocks are drawn with replacement.
    """
    draws = np.random.default_rng(0).multinomial(BLOCKS, [1.0 / BLOCKS] * BLOCKS, 100)
    values = [sums.drawn(counts).solve(mean) for counts in draws]
    deviations = np.array(values) - np.mean(values, axis=0)
    # Blocks are drawn around their own mean, which takes a share of the variance.
    correction = BLOCKS / (BLOCKS - 1.0)
    return np.asarray(correction * deviations.T @ deviations / len(draws))


def _first_noise(data: Observations) -> Noise:
    """Return the first noise, 1 % of the torque."""
    count = np.maximum(data.used.sum(axis=0), 1)
    power = np.square(data.beyond_model).sum(axis=0) / count
    floor = MIN_NOISE * data.deviation
    # From small noise the data decide on the unknowns first. From large noise these might stay as
    # expected, and the noise remain large.
    return Noise(
        0.01 * np.sqrt(power) + floor, np.ones(data.joint_count), 1.0 - data.windows.resting
    )


def _between(noise: Noise, shown: Noise) -> Noise:
    """Return noise between two rounds, so that weights and residuals settle."""
    return Noise(
        np.sqrt(noise.deviation * shown.deviation),
        np.sqrt(noise.correlation * shown.correlation),
        shown.weights,
    )


def _shown_noise(data: Observations, unknowns: Unknowns, residual: Array, value: Array) -> Noise:
    """
    Return the noise of a held-out residual, (J, n) [N·m].

    The unknowns x are `value`.
    """
    deviation, correlation = data.deviation.copy(), np.ones(data.joint_count)
    weights = np.ones_like(residual)
    for joint in np.flatnonzero(data.moving).tolist():
        used, floor = data.used[:, joint], MIN_NOISE * data.deviation[joint]
        r, resting = residual[used, joint], data.windows.resting[used, joint]
        # The deviation of a normal variable is 1.4826 times its median magnitude.
        typical = 1.4826 * float(np.median(np.abs(r))) + floor
        static = static_friction(unknowns, joint, value)
        outlier = 1.0 + np.square(r / (OUTLIER_DEVIATIONS * typical))
        w = resting_weight(resting, static, typical) / outlier
        weights[used, joint] = w
        deviation[joint] = np.sqrt(float(w @ np.square(r)) / w.sum()) + floor
        series = np.zeros(len(used))
        series[used] = np.sqrt(w) * r
        correlation[joint] = correlation_length(series)
    return Noise(deviation, correlation, weights)


def static_friction(unknowns: Unknowns, joint: int, value: Array) -> float:
    """Return the Coulomb friction of a joint by x [N·m]."""
    return abs(float(unknowns.row(joint, TermKind.COULOMB) @ value))


def resting_weight(resting: Array, static: float, noise: float) -> Array:
    """
    Return the weight of windows in which a joint rests.

    A resting joint has any friction up to the static one, which is a uniform distribution.
    """
    return np.asarray(1.0 / (1.0 + np.square(resting * static / noise) / 3.0))


def correlation_length(x: Array) -> float:
    """
    Return the sum of autocorrelations of a series [samples].

    It ends where these are noise.

    Parameters
    ----------
    x : ndarray, shape (J,)
        Series, 0 where there is no value.

    """
    count = len(x)
    power = float(x.dot(x))
    if power == 0.0:
        return 1.0
    spectrum = np.fft.rfft(x, 2 * count)
    correlation = np.fft.irfft(spectrum * spectrum.conj())[:count] / power
    small = np.flatnonzero(np.abs(correlation[1:]) < 2.0 / np.sqrt(count))
    last = int(small[0]) + 1 if len(small) else count
    return float(max(1.0, 1.0 + 2.0 * correlation[1:last].sum()))


def mean_sign(torque: Array) -> Array:
    """
    Return the mean sign in successive windows, (J, n).

    Between two windows the torque changes steadily, so that where it crosses zero its mean sign
    is between -1 and 1.
    """
    change = np.abs(np.gradient(torque, axis=0)) if len(torque) > 1 else np.zeros_like(torque)
    return np.clip(torque / np.maximum(change, 1e-300), -1.0, 1.0)
