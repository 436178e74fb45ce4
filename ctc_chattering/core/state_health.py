"""Whether states reach a controller in real time as they should, by rates."""

from __future__ import annotations

from collections.abc import Mapping

from ctc_chattering.core.grid import seconds
from ctc_chattering.core.rates import Rates

#: Likely cause of states, or commands, that come too late.
BUSY = 'this computer is too busy, or processes are stopped'
#: Part of the states refused that is a warning, and an error.
WARNING, ERROR = 0.01, 0.1
#: Kinds of refused messages that say nothing about the states of the robot.
_UNRELATED = ('second_publisher',)


class StateHealth:
    """
    Finds states that are refused, and restarts of the law, in the present.

    Parameters
    ----------
    period : int
        Control period [ns].

    """

    def __init__(self, period: int) -> None:
        self._period = period
        self._rates = Rates()
        self._kinds: tuple[str, ...] = ()

    def rotate(self, now: int, taken: int, restarts: int, refused: Mapping[str, int]) -> None:
        """
        Begin a new report.

        Parameters
        ----------
        now : int
            Time [ns].
        taken, restarts : int
            States used and restarts of the law, so far.
        refused : mapping
            Refused messages so far, by kind.

        """
        counts = {kind: n for kind, n in refused.items() if kind not in _UNRELATED}
        self._kinds = tuple(counts)
        total = sum(counts.values())
        self._rates.note(now, {
            **counts, 'all refused': total, 'states': taken + total, 'restarts': restarts})

    @property
    def restarts_per_second(self) -> float:
        """Restarts of the law per second over the last reports [1/s]."""
        return self._rates.per_second('restarts')

    @property
    def refused(self) -> float:
        """Part of the states refused over the last reports, 0 to 1."""
        return self._rates.fraction('all refused', 'states')

    @property
    def poor(self) -> bool:
        """Whether it is worth a warning."""
        return self.restarts_per_second > 0.0 or self.refused > WARNING

    @property
    def bad(self) -> bool:
        """Whether it is so bad that the robot cannot be controlled."""
        return self.restarts_per_second >= 1.0 or self.refused > ERROR

    def __str__(self) -> str:
        """Say what is found, and the likely cause."""
        kinds = ', '.join(kind for kind in self._kinds if self._rates.count(kind))
        refused = f'{100.0 * self.refused:.0f} % of the states refused'
        return (f'{self.restarts_per_second:.2g} restarts per second, {refused}'
                f'{f" ({kinds})" if kinds else ""}: {BUSY}; control_period is '
                f'{1e3 * seconds(self._period):g} ms')
