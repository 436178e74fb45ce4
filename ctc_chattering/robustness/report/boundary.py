"""Failure probability: Wilson's interval, and where a law passes."""

from __future__ import annotations

from itertools import groupby
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri  # type: ignore[import-untyped]

from ctc_chattering.numerics.linear_algebra import Array

#: Failure probability of the boundary.
LEVEL = 0.5
#: Of all intervals.
CONFIDENCE = 0.95


def wilson(failures: npt.ArrayLike, runs: npt.ArrayLike, confidence: float = CONFIDENCE
           ) -> tuple[Array, Array]:
    """
    Return Wilson's interval of a probability, without correction for continuity.

    Parameters
    ----------
    failures, runs : array_like of int
        Failures among independent runs; arrays that broadcast. Without a run: 0 and 1.
    confidence : float
        Probability that the interval contains the true one.

    Returns
    -------
    (ndarray, ndarray)
        Lower and upper ends.

    """
    k, n = np.broadcast_arrays(np.asarray(failures, float), np.asarray(runs, float))
    z2 = float(ndtri(0.5 + 0.5 * confidence)) ** 2
    p = k / np.maximum(n, 1.0)
    centre = (k + 0.5 * z2) / (n + z2)
    half = np.sqrt(z2 * (n * p * (1.0 - p) + 0.25 * z2)) / (n + z2)
    return (np.where(k > 0.0, centre - half, 0.0), np.where(k < n, centre + half, 1.0))


def share(failures: npt.ArrayLike, runs: npt.ArrayLike) -> Array:
    """Return failures / runs; nan without a run."""
    k, n = np.broadcast_arrays(np.asarray(failures, float), np.asarray(runs, float))
    found: Array = np.divide(k, n, out=np.full(k.shape, np.nan), where=n > 0.0)
    return found


def side(failures: npt.ArrayLike, runs: npt.ArrayLike, level: float = LEVEL
         ) -> npt.NDArray[np.int_]:
    """Return -1 where the interval is below `level`, 1 where it is above, 0 where it has both."""
    low, high = wilson(failures, runs)
    return (low > level).astype(int) - (high < level)


def passing_ranges(values: npt.ArrayLike, probability: npt.ArrayLike, level: float = LEVEL
                   ) -> list[tuple[float, float]]:
    """
    Return first and last value of each stretch of `values` where the law passes.

    Parameters
    ----------
    values : array_like, shape (n,)
        Grid of one axis.
    probability : array_like, shape (n,)
        Failure probability there; nan where nothing is known.
    level : float
        A law passes where the probability is less.

    """
    pairs: Any = zip(np.asarray(values).tolist(), np.asarray(probability).tolist())
    found = []
    for passes, stretch in groupby(pairs, key=lambda pair: pair[1] < level):
        if passes:
            mine = [value for value, _ in stretch]
            found.append((mine[0], mine[-1]))
    return found
