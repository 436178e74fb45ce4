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

"""Samples of the last seconds, and what of them the pages do not have."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ctc_chattering.analysis.interactive_plots import packed
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class History:
    """
    Rows of numbers with their times, of the last `window` seconds.

    A time before the last one, as at a new start of simulated time, clears it; of rows of one time
    the first is kept.

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

    def clear(self) -> None:
        """Forget all rows."""
        self._begin = self._end = 0
        self.cleared = self.added

    def add(self, t: float, row: Sequence[float] | Array) -> None:
        """Append a row, shape (width,), at time `t` [s]."""
        if self._end > self._begin and t <= self._t[self._end - 1]:
            if t == self._t[self._end - 1]:
                return
            self.clear()
        if self._end == len(self._t):
            kept = slice(self._end - self._capacity, self._end)
            self._t[:self._capacity] = self._t[kept]
            self._rows[:self._capacity] = self._rows[kept]
            self._begin, self._end = max(0, self._begin - kept.start), self._capacity
        self._t[self._end], self._rows[self._end] = t, row
        self._end += 1
        self.added += 1
        self._begin = max(self._begin, self._end - self._capacity)

    def read(self, last: float | None = None) -> tuple[Array, Array]:
        """Return times, shape (N,), and rows, shape (N, width), of the `last` seconds."""
        t, rows = self._t[self._begin:self._end], self._rows[self._begin:self._end]
        if len(t):
            first = int(np.searchsorted(t, t[-1] - (self.window if last is None else last)))
            t, rows = t[first:], rows[first:]
        return t, rows


class Mark(NamedTuple):
    """How far a track was sent: rows added, how many before it was cleared, and time 0 [s]."""

    added: int
    cleared: int
    begin: float


class Track(History):
    """
    Signals that one message has, as columns of the rows.

    Parameters
    ----------
    **signals : int
        Number of columns of each signal, in their order.

    """

    def __init__(self, **signals: int) -> None:
        super().__init__(sum(signals.values()))
        self._signals = signals

    def mark(self, begin: float) -> Mark:
        """Return how far `packed` reaches now, with times from `begin` on [s]."""
        return Mark(self.added, self.cleared, begin)

    def packed(self, since: Mark | None, begin: float) -> bytes:
        """Return the rows after a mark as a message to the pages, empty without any."""
        now = self.mark(begin)
        fresh = since is None or since[1:] != now[1:]
        t, rows = self.read()
        if since is not None and not fresh:
            count = min(len(t), now.added - since.added)
            t, rows = t[len(t) - count:], rows[len(t) - count:]
        if not len(t):
            return b''
        ends = np.cumsum(list(self._signals.values()))
        parts = np.split(rows, ends[:-1], axis=1)
        return packed(t - begin, dict(zip(self._signals, parts)), run=0, fresh=fresh)
