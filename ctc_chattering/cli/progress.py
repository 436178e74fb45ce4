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

"""Progress bars."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import io
import queue
import sys
import threading
from typing import Any

from tqdm import tqdm

#: Largest number of items that wait to be printed.
_MANY = 1000
#: Time to wait at the end until the last items are printed [s].
_PATIENCE = 0.5
#: Time between lines where there is no terminal [s].
_SELDOM = 10.0


class Progress:
    """
    A bar from 0 to `total` simulated seconds, shown from the first call on.

    A thread of its own draws it, so that a terminal that is stopped, or a pipe that is not read,
    does not block the caller: output that it does not accept is dropped.

    Parameters
    ----------
    title : str
    total : float
        Simulated seconds; 0 for a run without an end.

    """

    def __init__(self, title: str, total: float) -> None:
        self._title, self._total = title, total
        self._queue: queue.Queue[float | str | None] = queue.Queue(_MANY)
        self._thread = threading.Thread(target=self._draw, daemon=True)

    def __enter__(self) -> Progress:
        """Return itself."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the bar as it is."""
        self._put(None)
        self._thread.join(_PATIENCE)

    def __call__(self, time: float) -> None:
        """Move to `time` [s], at most to the end."""
        self._put(min(time, self._total) if self._total else time)

    def write(self, line: str) -> None:
        """Print a line above the bar."""
        self._put(line)

    def _put(self, item: float | str | None) -> None:
        with suppress(queue.Full):
            self._queue.put_nowait(item)

    def _draw(self) -> None:
        """Print all items, until the end or until the output is closed."""
        form = ('{desc} {bar} {n:.1f} of {total:g} s [{elapsed}]' if self._total
                else '{desc} {n:.1f} s')
        bar = None
        with suppress(OSError):
            while (item := self._queue.get()) is not None:
                if isinstance(item, str):
                    tqdm.write(item)
                    continue
                if bar is None:
                    bar = progress_bar(
                        total=self._total or None, desc=self._title, bar_format=form)
                bar.n = item
                bar.update(0)
            if bar is not None:
                bar.close()


def progress_bar(*iterable: Any, **options: Any) -> Any:
    """Return a bar of tqdm; where the output is no terminal, it prints lines, and seldom."""
    if sys.stderr.isatty():
        return tqdm(*iterable, mininterval=0.2, **options)
    form = options.pop('bar_format', '{desc}: {n_fmt}/{total_fmt} {unit} [{elapsed}]')
    return tqdm(*iterable, file=_Lines(), mininterval=_SELDOM, maxinterval=_SELDOM,
                bar_format=form.replace('{bar} ', ''), **options)


@contextmanager
def counting_bar(**options: Any) -> Iterator[Callable[[int, int], None]]:
    """Yield a function of what is done and of all there is, which a bar shows."""
    bars: list[Any] = []

    def moved(done: int, total: int) -> None:
        if not bars:  # What is refused before the first call is one line.
            bars.append(progress_bar(total=total, **options))
        bars[0].total = total
        bars[0].update(done - bars[0].n)
    try:
        yield moved
    finally:
        for bar in bars:
            bar.close()


class _Lines(io.TextIOBase):
    """Prints what tqdm draws over itself as lines, each once."""

    _last = ''

    def write(self, text: str) -> int:
        line = text.strip()
        if line and line != self._last:
            self._last = line
            print(line, file=sys.stderr, flush=True)
        return len(text)
