"""
Which publisher sent a message, where several publish on a topic that only one may command.

A subscriber is not told who sent a message, but every publisher numbers its own: 1, 2, 3, … The
first one heard has control; its next message is known by its number. All others are refused for as
long as it speaks. If another one's number meets the owner's, the message itself must tell, where
it can: the owner's goes on from the one before. Where it cannot, the other one came from behind
and so is the faster one: the owner is the one that stays behind.
"""

from __future__ import annotations

from collections.abc import Callable

#: Publishers beside the owner that are remembered.
_MANY = 16


class Arbiter:
    """
    Gives control of a topic to its first publisher.

    Parameters
    ----------
    lapse : int
        Silence after which another one may take over [ns].
    trusting : bool
        Whether a message that either of two publishers may have sent is taken if it is plausible.

    """

    def __init__(self, lapse: int, trusting: bool) -> None:
        self._lapse = lapse
        self._trusting = trusting
        self._next: int | None = None
        self._heard = 0
        self._others: dict[int, int] = {}

    def admits(self, number: int | None, now: int, alone: Callable[[], bool],
               plausible: Callable[[], bool] = lambda: True) -> bool:
        """
        Return whether a message is the owner's.

        Parameters
        ----------
        number : int or None
            The publisher's number of the message; None where the middleware has none: then
            nobody is heard while there are several.
        now : int
            Any clock that only goes forward [ns].
        alone : callable
            Returns whether the topic has one publisher at the most; asked in doubt only.
        plausible : callable
            Returns whether the message goes on from the owner's last one; asked in doubt only.

        """
        if number == self._next and number not in self._others and number is not None:
            self._next = number + 1
            self._heard = now
            return True
        return self._judge(number, now, alone, plausible)

    def pass_over(self, number: int | None, now: int) -> None:
        """Note a message that concerns nobody: only its number counts."""
        if number is None:
            return
        if number == self._next and number not in self._others:
            self._next = number + 1
        else:
            self._note(number, now)

    def _judge(self, number: int | None, now: int, alone: Callable[[], bool],
               plausible: Callable[[], bool]) -> bool:
        if number is None:
            return alone()
        if number == self._next:  # And one of the others' as well.
            if now - self._others[number] > self._lapse or (self._trusting and plausible()):
                self._next, self._heard = number + 1, now
                return True
            self._note(number, now)
            return False
        if self._next is None or now - self._heard > self._lapse or alone():
            self._others.pop(number, None)
            self._next, self._heard = number + 1, now
            return True
        self._note(number, now)
        return False

    def _note(self, number: int, now: int) -> None:
        """Remember what comes next from a publisher that has no control."""
        self._others.pop(number, None)
        self._others[number + 1] = now
        if len(self._others) > _MANY:
            del self._others[next(iter(self._others))]
