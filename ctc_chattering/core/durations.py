"""Mean and quantiles of durations over the last seconds, at the price of keeping them."""

from __future__ import annotations

from array import array
from collections import deque
from math import ceil

import numpy as np
import numpy.typing as npt


class Durations:
    """
    Keeps durations in windows, of which the last few count.

    Parameters
    ----------
    windows : int
        How many windows are looked back on.

    Attributes
    ----------
    add : callable
        Counts a duration [s].

    """

    def __init__(self, windows: int = 10) -> None:
        self._windows: deque[array[float]] = deque(maxlen=windows)
        self.rotate()

    def rotate(self) -> None:
        """Begin a new window, and forget the oldest."""
        window = array('d')
        self._windows.append(window)
        self.add = window.append

    @property
    def count(self) -> int:
        """Durations in all windows."""
        return sum(map(len, self._windows))

    def mean(self) -> float:
        """Return the mean [s]; 0 without any."""
        return float(self._together().mean()) if self.count else 0.0

    def quantile(self, share: float) -> float:
        """Return the shortest duration that `share` of all do not exceed [s]; 0 without any."""
        if not self.count:
            return 0.0
        index = max(0, ceil(share * self.count) - 1)
        return float(np.partition(self._together(), index)[index])

    def _together(self) -> npt.NDArray[np.float64]:
        return np.concatenate([np.frombuffer(window) for window in self._windows if window])
