"""Matching the joints of a message to our own by name, never by place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from operator import itemgetter

from ctc_chattering.errors import RejectedMessage

Pick = Callable[[Sequence[float]], Sequence[float]]


class Joints:
    """
    Finds our joints among a message's names, and remembers where they stood.

    Parameters
    ----------
    names : sequence of str
        Our joints in our order.

    """

    def __init__(self, names: Sequence[str]) -> None:
        self._ours = tuple(names)
        self._known = frozenset(names)
        self._theirs: tuple[str, ...] | None = None
        self._pick: Pick | None = None

    def concerned(self, names: Sequence[str]) -> bool:
        """Return whether any joint of ours is among `names`."""
        return names is self._theirs or not self._known.isdisjoint(names)

    def select(self, names: tuple[str, ...], *rows: Sequence[float]) -> list[Sequence[float]]:
        """
        Return our joints' values out of each row of a message.

        Parameters
        ----------
        names : tuple of str
            Joints of the message.
        *rows : sequence of float
            A value for each of them.

        Raises
        ------
        RejectedMessage
            If a joint of ours is missing, a name stands there twice, a row has another length,
            or a value of ours is not finite.

        """
        pick = self.pick(names)
        if pick is None:
            raise RejectedMessage('joints', (
                f'joints {list(names)}; needed: each of {list(self._ours)} once'))
        n = len(names)
        if any(len(row) != n for row in rows):
            lengths = sorted({len(row) for row in rows})
            raise RejectedMessage('length', (
                f'{" or ".join(map(str, lengths))} values for {n} joints'))
        values = [pick(row) for row in rows]
        if not isfinite(sum([sum(row) for row in values])):
            raise RejectedMessage('not_finite', f'{[list(row) for row in values[:3]]}')
        return values

    def pick(self, names: tuple[str, ...]) -> Pick | None:
        """
        Return a function that takes our joints' values out of a row of the message's.

        None if a joint of ours is missing, or any name stands there twice.
        """
        if names is not self._theirs and names != self._theirs:
            self._theirs, self._pick = names, self._find(names)
        return self._pick

    def _find(self, names: tuple[str, ...]) -> Pick | None:
        if len(set(names)) != len(names) or not self._known.issubset(names):
            return None
        if names == self._ours:
            return _all
        if len(self._ours) == 1:
            index = names.index(self._ours[0])
            return lambda row: (row[index],)
        return itemgetter(*(names.index(name) for name in self._ours))


def _all(row: Sequence[float]) -> Sequence[float]:
    return row
