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
Intervals of 95 % from blocks of windows, because residuals of neighbouring windows correlate.

The covariance of the coefficients is that of the moving block bootstrap (Künsch 1989) in its
linear approximation: of the sums of the scores over all blocks of windows, with the rows of all
joints. A block is many times longer than the correlation of the residuals and of their products
with the columns: noise of positions enters neighbouring windows with opposite signs, and at the
ends of a block it has no partner. With blocks of 5 correlations, intervals were 1.4 times as long
as with 40.

What the sensors do not explain is no noise, and more data do not make it less: the part of a
residual that lasts beyond the overlap of two windows counts as few independent errors only.
"""

from __future__ import annotations

import dataclasses
from math import sqrt

from ctc_chattering.identification.regression.least_squares import (
    Fit,
    inverted,
)
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit  # type: ignore[import-untyped]

Flags = npt.NDArray[np.bool_]
#: Distances of windows that do not overlap any more, and independent errors that a run has.
_LAGS, _ERRORS = (5, 6, 7, 8), 20.0
#: Cells of windows that make up a block.
_CELLS = 8
#: Blocks of at least so many correlation lengths, and at least so many of them in the data.
_LENGTHS, _FEWEST_BLOCKS = 40.0, 12


@dataclasses.dataclass(frozen=True)
class Spread:
    """
    How far the coefficients of a fit vary.

    Attributes
    ----------
    covariance : ndarray, shape (p, p)
        Of the coefficients.
    factor : float
        Half the interval in standard errors, for as few blocks as there are.
    block : int
        Length of a block [windows].

    """

    covariance: Array
    factor: float
    block: int

    @property
    def error(self) -> Array:
        """Return the standard errors, shape (p,)."""
        found: Array = np.sqrt(np.maximum(self.covariance.diagonal(), 0.0))
        return found

    def half(self, weights: Array) -> float:
        """Return half the interval of the sum of the coefficients with `weights`, shape (p,)."""
        return self.factor * sqrt(max(float(weights @ self.covariance @ weights), 0.0))


def correlation_length(x: Array) -> float:
    """
    Return the sum of the autocorrelations of a series, up to where they are noise [samples].

    Parameters
    ----------
    x : ndarray, shape (J,)
        Series; 0 where there is no value.

    """
    count = len(x)
    power = float(x.dot(x))
    if power == 0.0:
        return 1.0
    spectrum = np.fft.rfft(x, 2 * count)
    rho = np.fft.irfft(spectrum * spectrum.conj())[:count] / power
    small = np.flatnonzero(np.abs(rho[1:]) < 2.0 / sqrt(count))
    last = int(small[0]) + 1 if len(small) else count
    return float(max(1.0, 1.0 + 2.0 * rho[1:last].sum()))


def block_length(fit: Fit) -> int:
    """Return the length of a block for a fit [windows]; long enough for all its scores."""
    scores = fit.scores()
    longest = max((correlation_length(x) for x in scores.T), default=1.0)
    count = len(scores)
    wanted = _LENGTHS * max(longest, 2.0)
    return int(min(max(wanted, count ** (1.0 / 3.0)), max(count // _FEWEST_BLOCKS, 1)))


def spread(fit: Fit, starts: tuple[int, ...]) -> Spread:
    """
    Return the standard errors of a fit by drawing blocks of windows.

    Parameters
    ----------
    fit : Fit
        Of `solve`.
    starts : tuple of int
        First window of each stretch; no block goes over one.

    """
    length = block_length(fit)
    count = len(fit.residual)
    cell = max(1, length // _CELLS)
    edges = np.append(np.arange(0, count - cell + 1, cell), count)
    span = max(1, length // cell)
    scores = fit.scores()
    before = np.concatenate((np.zeros_like(scores[:1]), np.cumsum(scores, axis=0)))[edges]
    first = np.arange(max(len(edges) - span, 1))
    inside = np.ones(len(first), bool)
    for start in starts[1:]:
        inside &= (edges[first + span] <= start) | (edges[first] >= start)
    if not inside.any():
        inside[:] = True
    first = first[inside]
    blocks = max(2, (len(edges) - 1) // span)
    sums = before[first + span] - before[first]
    # Blocks are drawn around their own mean, which takes a share of the variance.
    correction = blocks / (blocks - 1.0)
    inverse = inverted(fit.normal())
    root = (sums - sums.mean(axis=0)) @ inverse
    covariance = correction * blocks * root.T @ root / len(root)
    lasting = (inverse @ _lasting(fit) @ inverse).diagonal()
    chance = np.maximum(covariance.diagonal(), 1e-300)
    wider = np.sqrt(np.maximum(1.0, lasting / chance))
    return Spread(covariance * np.outer(wider, wider), float(stdtrit(blocks - 1.0, 0.975)), length)


def _lasting(fit: Fit) -> Array:
    """Return the covariance of the scores that lasting errors make, shape (p, p)."""
    found = np.zeros((fit.design.shape[2],) * 2)
    for i, weight in enumerate(fit.weight):
        used: Flags = np.asarray(fit.design[:, i].any(axis=1))
        count = int(used.sum())
        variance = lasting_variance(fit.residual[:, i], used)
        if variance > 0.0:
            rows = fit.design[used, i]
            found += weight ** 2 * variance * count / _ERRORS * (rows.T @ rows)
    return found


def lasting_variance(x: Array, used: Flags) -> float:
    """
    Return the variance of a series that lasts beyond the overlap of windows.

    Parameters
    ----------
    x : ndarray, shape (J,)
        Residuals of a joint.
    used : ndarray, shape (J,)
        Where they count.

    """
    count = int(used.sum())
    y = np.where(used, x, 0.0)
    products, pairs = 0.0, 0
    for lag in _LAGS:
        products += float(y[lag:] @ y[:-lag])
        pairs += int((used[lag:] & used[:-lag]).sum())
    if not pairs:
        return 0.0
    chance = 2.0 * float(y @ y) / max(count, 1) / np.sqrt(pairs / 4.0)
    return float(max(0.0, products / pairs - chance))
