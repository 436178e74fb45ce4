"""Samples that a run lacks: the recorder dropped them, or the robot did not send them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def missing(t: npt.NDArray[np.float64], period: float) -> npt.NDArray[np.int64]:
    """
    Return how many samples are missing after each sample but the last, shape (N - 1,).

    Parameters
    ----------
    t : ndarray, shape (N,)
        Times of the samples, increasing [s].
    period : float
        Sample period [s].

    """
    return np.maximum(np.rint(np.diff(t) / period).astype(np.int64) - 1, 0)
