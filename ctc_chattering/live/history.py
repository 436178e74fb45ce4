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

"""Samples of the last seconds."""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class History:
    """
    Rows of numbers with their times, of the last `window` seconds.

    A time before the last one, as at a new start of simulated time, clears it.

    Parameters
    ----------
    width : int
        Numbers in a row.
    window : float
        [s].
    capacity : int
        Most rows.

    Attributes
    ----------
    added : int
        Rows that were ever added.
    cleared : int
        How many of them were added before it was cleared the last time.

    """

    def __init__(self, width: int, window: float = 10.0, capacity: int = 20_000) -> None:
        self.window = window
        self._t = np.zeros(2 * capacity)
        self._rows = np.zeros((2 * capacity, width))
        self._capacity = capacity
        self._begin = self._end = 0
        self.added = self.cleared = 0

    def add(self, t: float, row: Sequence[float] | Array) -> None:
        """Append a row, shape (width,), at time `t` [s]."""
        if self._end > self._begin and t < self._t[self._end - 1]:
            self._begin = self._end = 0
            self.cleared = self.added
        if self._end == len(self._t):
            kept = slice(self._end - self._capacity, self._end)
            self._t[:self._capacity] = self._t[kept]
            self._rows[:self._capacity] = self._rows[kept]
            self._begin, self._end = max(0, self._begin - kept.start), self._capacity
        self._t[self._end], self._rows[self._end] = t, row
        self._end += 1
        self.added += 1
        self._begin = max(self._begin, self._end - self._capacity)

    def read(self) -> tuple[Array, Array]:
        """Return times, shape (N,), and rows, shape (N, width), of the window."""
        t, rows = self._t[self._begin:self._end], self._rows[self._begin:self._end]
        if len(t):
            first = int(np.searchsorted(t, t[-1] - self.window))
            self._begin += first
            t, rows = t[first:], rows[first:]
        return t, rows

    @property
    def last(self) -> tuple[float, Array] | None:
        """Return the last time and row; None without one."""
        if self._end == self._begin:
            return None
        return float(self._t[self._end - 1]), self._rows[self._end - 1]
