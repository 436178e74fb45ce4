"""
From one law to another without a step of the torque.

The new law begins from the perturbation that the old one estimates; if it acts on v and the old
one did not, with v = 0. What its first torque then still differs from the last one sent is added
to it, and fades: after j samples there remains 1 - j / J of it, with J h = `FADE`. Anti-windup
keeps it out of the filter (3), as what the limits take from a torque. Between the two laws of the
paper the chattering term comes and goes at once instead.
"""

from __future__ import annotations

from ctc_chattering.control.laws.base import Law, State
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Time over which the difference of two laws fades [s].
FADE = 0.2


class Handover:
    """
    Makes the torque continuous where the law changes.

    Attributes
    ----------
    sent : array, shape (n,), or None
        The torque sent last [N·m]; None for none since the start or a reset.

    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the torque sent last and what is left of a difference."""
        self.sent: Array | None = None
        self._difference: Array = np.zeros(0)
        self._samples = self._left = 0
        self._fresh = False

    def initialize(self, before: Law, law: Law, now: State, period: float) -> None:
        """
        Have a law take over from another one at the measured state `now`.

        Parameters
        ----------
        before, law : Law
            The old and the new one.
        now : State
            Measured.
        period : float
            h [s].

        """
        law.initialize(now, before.estimate(now))
        before.suspend()
        if self.sent is not None and not (before.of_the_paper and law.of_the_paper):
            self._samples = self._left = max(round(FADE / period), 1)
            self._fresh = True

    def added(self, torque: Array) -> Array | None:
        """Return what is added to the torque of the law, shape (n,) [N·m]; None for nothing."""
        if not self._left:
            return None
        if self._fresh and self.sent is not None:
            self._difference, self._fresh = self.sent - torque, False
        share = self._left / self._samples
        self._left -= 1
        added: Array = share * self._difference
        return added
