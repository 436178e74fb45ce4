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

from collections import deque
from itertools import islice
from typing import Any, NamedTuple

from ctc_chattering.analysis.interactive_plots import packed
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class Mark(NamedTuple):
    """How far a track was sent: rows added, how many before it was cleared, and time 0 [s]."""

    added: int
    cleared: int
    begin: float


class Track:
    """
    Signals that one message has: rows of numbers with their times, the last `most` of them.

    A time before the last one, as at a new start of simulated time, clears it; of rows of one time
    the first is kept.

    Parameters
    ----------
    most : int
        Number of rows.
    **signals : int
        Number of columns of each signal, in their order.

    """

    def __init__(self, most: int = 10_000, **signals: int) -> None:
        self._signals = signals
        self._rows: deque[tuple[float, Any]] = deque(maxlen=most)
        self._added = self._cleared = 0

    def clear(self) -> None:
        """Forget all rows."""
        self._rows.clear()
        self._cleared = self._added

    def add(self, t: float, row: Array) -> None:
        """Append a row at time `t` [s]."""
        if self._rows and t <= self._rows[-1][0]:
            if t == self._rows[-1][0]:
                return
            self.clear()
        self._rows.append((t, row))
        self._added += 1

    def mark(self, begin: float) -> Mark:
        """Return how far `packed` reaches now, with times from `begin` on [s]."""
        return Mark(self._added, self._cleared, begin)

    def packed(self, since: Mark | None, begin: float) -> bytes:
        """Return the rows after a mark as a message to the pages, empty without any."""
        now, count = self.mark(begin), len(self._rows)
        fresh = since is None or since[1:] != now[1:]
        first = 0 if fresh or since is None else max(0, count - (now.added - since.added))
        if first == count:
            return b''
        t, rows = map(np.array, zip(*islice(self._rows, first, None)))
        ends = np.cumsum(list(self._signals.values()))
        parts = np.split(rows, ends[:-1], axis=1)
        return packed(t - begin, dict(zip(self._signals, parts)), run=0, fresh=fresh)
