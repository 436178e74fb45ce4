"""Whether torques may be sent: the controller is enabled, and no error has tripped it."""

from __future__ import annotations

from ctc_chattering.core.model import Vector


class Guard:
    """
    Keeps the controller silent while it is disabled, or after it tripped until it is reset.

    Parameters
    ----------
    enabled : bool

    Attributes
    ----------
    enabled : bool
        Whether torques are wanted.
    tripped : int or None
        Index of the joint whose error was beyond the limit.

    """

    def __init__(self, enabled: bool) -> None:
        self.enabled = enabled
        self.tripped: int | None = None

    @property
    def allows(self) -> bool:
        """Whether torques may be sent."""
        return self.enabled and self.tripped is None

    def check(self, e: Vector, limit: Vector) -> bool:
        """
        Return whether the position error is within its limit, and trip if it is not.

        Parameters
        ----------
        e : sequence of float, shape (n,)
            Position error [rad].
        limit : sequence of float, shape (n,)
            Largest magnitude allowed [rad].

        """
        for i, (x, most) in enumerate(zip(e, limit)):
            if not -most <= x <= most:
                self.tripped = i
                return False
        return True

    def reset(self) -> None:
        """Go on after a trip."""
        self.tripped = None
