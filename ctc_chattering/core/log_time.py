"""The simulated time with which messages are logged, told by several topics."""

from __future__ import annotations

from ctc_chattering.core.grid import NANOSECONDS

#: What one topic may be behind another one, or ahead of it [ns]: less is no leap.
_SKEW = NANOSECONDS


class LogTime:
    """
    Goes with the topics that tell the time, and does not go back because one is ahead.

    A bag is read in the order of its log times, so that the order of what was received lives on
    only if they do not decrease. Time that really leaps, as when a simulation begins anew or was
    not heard for a while, is believed when the next message of that topic goes on from there.

    Attributes
    ----------
    now : int
        The time [ns].

    """

    def __init__(self) -> None:
        self.now = 0
        self._begun = False
        self._leaps: dict[str, int] = {}

    def note(self, topic: str, said: int) -> None:
        """Take what a message of `topic` says [ns]."""
        leap = self._leaps.pop(topic, None)
        if not self._begun:
            self._begun = True
            self.now = said
        elif abs(said - self.now) <= _SKEW:
            self.now = max(self.now, said)
        elif leap is not None and 0 <= said - leap <= _SKEW:
            self.now = said
        else:
            self._leaps[topic] = said
