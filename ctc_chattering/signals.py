"""SIGINT and SIGTERM as a list that fills, to be looked at when it suits."""

from __future__ import annotations

import signal
from types import FrameType

#: Signals that ask a process to end.
STOP = (signal.SIGINT, signal.SIGTERM)


def collect() -> list[int]:
    """Take `STOP` from now on; return the list of the signals that have come."""
    caught: list[int] = []

    def on_signal(number: int, _frame: FrameType | None) -> None:
        caught.append(number)

    for number in STOP:
        signal.signal(number, on_signal)
    return caught
