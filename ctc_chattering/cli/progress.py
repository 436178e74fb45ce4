"""Progress of a run in simulated seconds."""

from __future__ import annotations

import sys
from types import TracebackType

from tqdm import tqdm


class Progress:
    """
    A bar from 0 to `total` seconds; call it with the time reached.

    Parameters
    ----------
    title : str
    total : float
        Simulated seconds; 0 for a run without an end.

    """

    def __init__(self, title: str, total: float) -> None:
        form = '{desc} {bar} {n:.1f}/{total:.1f} s [{elapsed}]' if total else '{desc} {n:.1f} s'
        self._bar = tqdm(total=total or None, desc=title, bar_format=form,
                         mininterval=0.2 if sys.stderr.isatty() else 2.0)

    def __enter__(self) -> Progress:
        """Show the bar."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        """Leave the bar as it is."""
        self._bar.close()

    def __call__(self, time: float) -> None:
        """Move to `time` [s]."""
        total = self._bar.total
        self._bar.n = min(time, total) if total else time
        self._bar.update(0)

    def complete(self) -> None:
        """Move to the end."""
        if self._bar.total:
            self._bar.n = self._bar.total
        self._bar.refresh()

    @staticmethod
    def write(line: str) -> None:
        """Print a line above the bar."""
        tqdm.write(line)
