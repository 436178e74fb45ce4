"""Matching the joints of a message to our own by name, never by place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import itemgetter

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
