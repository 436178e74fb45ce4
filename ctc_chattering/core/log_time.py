"""The simulated time with which messages are logged, told by several topics."""

from __future__ import annotations

from ctc_chattering.core.grid import NANOSECONDS

#: What one topic may be behind another one [ns]: less is no step back in time.
_SKEW = NANOSECONDS


class LogTime:
    """
    Goes with the topics that tell the time, and does not go back because one is ahead.

    A bag is read in the order of its log times, so that the order of what was received lives on
    only if they do not decrease. Time that really goes back, as when a simulation begins anew, is
    believed when the next message of that topic goes on from there.

    Attributes
    ----------
    now : int
        The time [ns].

    """

    def __init__(self) -> None:
        self.now = 0
        self._back: dict[str, int] = {}

    def note(self, topic: str, said: int) -> None:
        """Take what a message of `topic` says [ns]."""
        back = self._back.pop(topic, None)
        if said >= self.now - _SKEW:
            self.now = max(self.now, said)
        elif back is not None and 0 <= said - back <= _SKEW:
            self.now = said
        else:
            self._back[topic] = said
