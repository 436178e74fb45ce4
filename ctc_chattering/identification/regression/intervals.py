"""
Intervals of 95 % by a moving block bootstrap, because residuals of neighbouring windows correlate.

Blocks of windows, with the rows of all joints, are drawn with replacement (Künsch 1989). A block
is many times longer than the correlation of the residuals and of their products with the columns:
noise of positions enters neighbouring windows with opposite signs, and at the ends of a block it
has no partner. With blocks of 5 correlations, intervals were 1.4 times as long as with 40.
"""

from __future__ import annotations

import dataclasses
from math import sqrt

from ctc_chattering.identification.regression.least_squares import Fit, normal_equations, solved
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.special import stdtrit  # type: ignore[import-untyped]

#: Resamples, and their seed.
_COUNT, _SEED = 400, 1
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
    scores = np.einsum('jip,ji->jp', fit.design * fit.weight[:, None], fit.residual)
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
    y = fit.residual + fit.design @ fit.value
    normal, right = (np.concatenate((np.zeros((1, *x.shape[1:])), np.cumsum(x, axis=0)))
                     for x in normal_equations(fit.design, y, fit.weight))
    count = len(y)
    first = np.arange(count - length + 1)
    inside = np.ones(len(first), bool)
    for start in starts[1:]:
        inside &= (first + length <= start) | (first >= start)
    if not inside.any():
        inside[:] = True
    first = first[inside]
    blocks = max(2, count // length)
    rng = np.random.default_rng(_SEED)
    values = []
    for _ in range(_COUNT):
        drawn = rng.choice(first, blocks)
        values.append(solved((normal[drawn + length] - normal[drawn]).sum(axis=0),
                             (right[drawn + length] - right[drawn]).sum(axis=0)))
    # Blocks are drawn around their own mean, which takes a share of the variance.
    correction = blocks / (blocks - 1.0)
    covariance = correction * np.atleast_2d(np.cov(np.array(values).T))
    return Spread(covariance, float(stdtrit(blocks - 1.0, 0.975)), length)
