"""Back to a reference that has moved on while the robot was not driven."""

from __future__ import annotations

from typing import cast

from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.trajectory.buffer import Point, Trajectory
from ctc_chattering.trajectory.smooth_start import Motion, smooth_start, Transition

#: Time without a torque after which the robot may be far from the reference [ns].
PAUSE = NANOSECONDS // 10


class Rejoining:
    """
    Replaces the desired motion after a pause: it begins where the robot is.

    After an outage of states, a restart of the robot's driver, or while the controller was
    disabled, the reference has moved on, and the error would be a step. Time is that of the
    stamps: in simulated time that stands still there is no pause.

    Parameters
    ----------
    reference : Trajectory or Motion
        What to lead back to; asked only at instants for which there is a point.

    """

    def __init__(self, reference: Trajectory | Motion) -> None:
        self._reference = cast('Motion', reference)
        self._driven: int | None = None
        self._transition: Transition | None = None

    def pause(self, t: int) -> None:
        """Note that at `t` [ns] the robot is not driven, for another reason than the reference."""
        if self._driven is None:
            self._driven = t

    def begin(self, t: int, q: Vector, dq: Vector, duration: float) -> bool:
        """
        Note that the robot is driven at `t` [ns]; return whether a way back begins there.

        Parameters
        ----------
        t : int
            Instant [ns].
        q, dq : sequence of float, shape (n,)
            Position [rad] and velocity [rad/s] of the robot.
        duration : float
            Time that the way back takes [s]; 0 for none.

        """
        paused = self._driven is not None and t - self._driven > PAUSE and duration > 0.0
        self._driven = t
        if paused:
            self._transition = smooth_start(
                self._reference, t, (q, dq, (0.0,) * len(q)), duration)
        return paused

    @property
    def active(self) -> bool:
        """Whether the desired motion is another one than the reference."""
        return self._transition is not None

    def at(self, t: int, point: Point) -> Point:
        """Return what is desired at `t` [ns], where the reference has `point`."""
        if self._transition is None:
            return point
        if t >= self._transition.end:
            self._transition = None
            return point
        return self._transition.at(t)
