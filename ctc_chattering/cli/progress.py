"""Progress of a run in simulated seconds."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import Any

from tqdm import tqdm


class Progress:
    """
    A bar from 0 to `total` seconds, shown from the first call with the time reached on.

    Parameters
    ----------
    title : str
    total : float
        Simulated seconds; 0 for a run without an end.

    """

    def __init__(self, title: str, total: float) -> None:
        self._title, self._total = title, total
        self._bar: Any = None

    def _shown(self) -> Any:
        """Return the bar."""
        if self._bar is None:
            self._bar = _bar(self._title, self._total)
        return self._bar

    def __enter__(self) -> Progress:
        """Return itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        """Leave the bar as it is."""
        if self._bar is not None:
            self._bar.close()

    def __call__(self, time: float) -> None:
        """Move to `time` [s]."""
        bar = self._shown()
        bar.n = min(time, self._total) if self._total else time
        bar.update(0)

    def complete(self) -> None:
        """Move to the end."""
        bar = self._shown()
        bar.n = self._total or bar.n
        bar.refresh()

    @staticmethod
    def write(line: str) -> None:
        """Print a line above the bar."""
        tqdm.write(line)


def _bar(title: str, total: float) -> Any:
    form = '{desc} {bar} {n:.1f}/{total:.1f} s [{elapsed}]' if total else '{desc} {n:.1f} s'
    return tqdm(total=total or None, desc=title, bar_format=form,
                mininterval=0.2 if sys.stderr.isatty() else 2.0)
