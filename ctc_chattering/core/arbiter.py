"""
Which publisher sent a message, where several publish on a topic that only one may command.

A subscriber is not told who sent a message, but every publisher numbers its own: 1, 2, 3, … The
first one heard has control; its next message is known by its number. All others are refused for as
long as it speaks. Where another one's number meets the owner's, only what a message says can tell
whose it is, until the numbers have drifted apart again; then the one that came from behind, being
the faster one, is ahead. Two that stay level and say the like are never told apart.
"""

from __future__ import annotations

from collections.abc import Callable

#: Publishers beside the owner that are remembered.
_MANY = 16
#: How far apart two numbers must be again after they met.
_APART = 3


class Arbiter:
    """
    Gives control of a topic to its first publisher.

    Parameters
    ----------
    lapse : int
        Silence after which another one may take over [ns].
    trusting : bool
        Whether a message that either of two publishers may have sent is taken.

    Attributes
    ----------
    lapse : int
        As above; may be changed.
    passed_on : bool
        Becomes true when control has passed to another publisher after a silence.

    """

    def __init__(self, lapse: int, trusting: bool) -> None:
        self.lapse = lapse
        self.passed_on = False
        self._trusting = trusting
        self._next: int | None = None
        #: The owner's next number if all messages were its that were passed over since.
        self._reach = 0
        self._heard = 0
        #: The next numbers of others, and when they were last heard [ns].
        self._others: dict[int, int] = {}
        #: The same of those of which all messages were passed over.
        self._strangers: dict[int, int] = {}
        #: The next number of another one while it is in doubt which of the two is the owner's.
        self._rival: int | None = None
        #: Whether, where they last met, it was the owner that came from behind.
        self._overtaking = False
        #: What was known of the owner before the last message gave another one control.
        self._former: tuple[int | None, int, int] | None = None

    def admits(self, number: int | None, now: int, alone: Callable[[], bool],
               plausible: Callable[[], bool] | None = None) -> bool:
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
        plausible : callable, optional
            Returns whether what the message says is what the owner would say next; asked in doubt
            only. If not, the sender is known not to be the owner; if so, and it is to be taken,
            to be the owner.

        """
        if (number is not None and self._next is not None and self._rival is None
                and self._next <= number <= self._reach
                and number not in self._others and number not in self._strangers):
            self._follow(number, now)
            self._former = None
            return True
        self._former = None
        return self._judge(number, now, alone, plausible)

    def pass_over(self, number: int | None, now: int) -> None:
        """Note a message that concerns nobody, the owner's or not: only its number counts."""
        if number is None:
            return
        for known in (self._others, self._strangers):
            if number in known:
                known[number + 1] = now
                if number != self._reach:  # Otherwise it may be the owner's as well.
                    del known[number]
                break
        else:
            if number != self._reach:
                self._strangers[number + 1] = now
        if number == self._reach:
            self._reach = number + 1
        self._trim()

    def revoke(self, number: int | None, now: int) -> None:
        """Note that the message just admitted is of no use: it gives nobody control."""
        if number is not None and self._former is not None and self._next == number + 1:
            self._next, self._reach, self._heard = self._former
            self.passed_on = False
            self._note(number, now)

    def reject(self, number: int | None, now: int, alone: Callable[[], bool]) -> None:
        """Note a message that nobody can read: it is somebody's, and gives no control."""
        if number is None:
            return
        if self._next is None or now - self._heard > self.lapse:
            self._note(number, now)
        else:
            self.admits(number, now, alone, lambda: False)

    def _judge(self, number: int | None, now: int, alone: Callable[[], bool],
               plausible: Callable[[], bool] | None) -> bool:
        if number is None:
            return alone()
        if self._next is None or now - self._heard > self.lapse:
            if number != self._next:
                self._former = self._next, self._reach, self._heard
                self.passed_on = self._next is not None
            self._others.pop(number, None)
            self._follow(number, now)
            return True
        if alone():
            self._others.clear()
            self._strangers.clear()
            self._follow(number, now)
            return True
        if (self._rival is None and self._next <= number <= self._reach
                and number not in self._others):  # Of one of which nothing concerns us so far.
            seen = self._strangers.pop(number)
            if plausible is not None and now - seen <= self.lapse and not plausible():
                self._note(number, now)
                return False
            self._follow(number, now)
            self._strangers[number] = seen
            return True
        if self._rival is None and self._next <= number <= self._reach:
            # And one of the others' as well.
            seen = self._others.pop(number)
            if now - seen > self.lapse:  # One that has gone since.
                self._follow(number, now)
                return True
            if self._next != self._reach:
                return self._settle(number, now, seen, plausible)
            self._rival = number
        if self._rival is not None and number in (self._next, self._rival):
            return self._doubt(number, now, self._next, self._rival, plausible)
        self._note(number, now)
        return False

    def _settle(self, number: int, now: int, seen: int,
                plausible: Callable[[], bool] | None) -> bool:
        """Tell by a message alone whose it is: the owner's number is not known exactly."""
        if plausible is None or not plausible():
            self._note(number, now)
            return False
        self._follow(number, now)
        self._others[number] = seen
        return True

    def _follow(self, number: int, now: int) -> None:
        """Know the owner by the number after this one."""
        self._next = self._reach = number + 1
        self._heard = now
        self._rival = None
        if self._next in self._others:
            self._overtaking = True

    def _note(self, number: int, now: int) -> None:
        """Remember what comes next from a publisher that has no control."""
        self._others.pop(number, None)
        self._strangers.pop(number, None)
        self._others[number + 1] = now
        if number + 1 == self._next:
            self._overtaking = False
        self._trim()

    def _trim(self) -> None:
        for known in (self._others, self._strangers):
            if len(known) > _MANY:
                del known[next(iter(known))]

    def _doubt(self, number: int, now: int, a: int, b: int,
               plausible: Callable[[], bool] | None) -> bool:
        """Let the one of two that is at this number go on; they are known once they are apart."""
        self._heard = now
        other = b if number == a else a
        if plausible is not None and not plausible():
            self._next = self._reach = other
            self._rival = None
            self._note(number, now)
            return False
        if plausible is not None and self._trusting:
            self._follow(number, now)
            self._others[other] = now
            self._overtaking = False
            return True
        low, high = sorted((other, number + 1))
        self._next, self._rival = low, high
        if high - low < _APART:
            return self._trusting
        owner, other = (high, low) if self._overtaking else (low, high)
        self._next = self._reach = owner
        self._rival = None
        self._others[other] = now
        return owner == number + 1
