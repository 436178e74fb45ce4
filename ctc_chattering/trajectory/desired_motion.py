"""The desired motion as a controller has it: the reference, and the way back to it."""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.trajectory.buffer import Point, Trajectory
from ctc_chattering.trajectory.rejoining import Rejoining


class DesiredMotion:
    """
    Points of the reference at the instants that a law needs, led back to after a pause.

    Parameters
    ----------
    grace : int
        How long the reference may be late [ns].
    period, delay : int
        Control period [ns], and number of samples that the law looks ahead.

    """

    def __init__(self, grace: int, period: int, delay: int) -> None:
        self._trajectory = Trajectory(grace)
        self._lags = [k * period for k in range(delay + 1)]
        self.restart()

    def __len__(self) -> int:
        """Return the number of points held."""
        return len(self._trajectory)

    def restart(self) -> None:
        """Forget when the robot was driven last: time begins again."""
        self._rejoining = Rejoining(self._trajectory)

    def extend(self, times: Sequence[int], points: Sequence[Point], most: int | None) -> None:
        """
        Add a chunk of the reference.

        Parameters
        ----------
        times : sequence of int
            Instants [ns], increasing.
        points : sequence of (position, velocity, acceleration)
            Each of shape (n,) [rad, rad/s, rad/s²].
        most : int or None
            Number of points to keep, beside a longer chunk; None for all.

        """
        self._trajectory.extend(times, points)
        if most is not None:
            self._trajectory.limit(max(most, len(times)))

    def pass_over(self, t: int, driven: bool) -> None:
        """Forget what is past at `t` [ns]; `driven` is whether torques may be sent there."""
        self._trajectory.forget(t)
        if not driven:
            self._rejoining.pause(t)

    def reference(self, t: int, wait: bool) -> list[Point] | None:
        """
        Return the reference at `t` [ns] and one point for each sample of delay.

        None if it is not known yet; with `wait` it must not be extrapolated either.
        """
        end = self._trajectory.end
        if (wait and end is not None and t + self._lags[-1] > end
                and not self._trajectory.ends_at_rest):
            return None
        points = [self._trajectory.at(t + lag) for lag in self._lags]
        return None if points[0] is None else [point for point in points if point is not None]

    def begin(self, t: int, q: Vector, dq: Vector, duration: float) -> bool:
        """
        Note that the robot is driven at `t` [ns]; return whether a way back begins there.

        The way begins at position `q` [rad] and velocity `dq` [rad/s] and takes `duration` [s].
        """
        return self._rejoining.begin(t, q, dq, duration)

    def desired(self, t: int, reference: Sequence[Point]) -> list[Point]:
        """Return what is desired at `t` [ns] and after, where `reference` is what it returned."""
        return [self._rejoining.at(t + lag, point)
                for lag, point in zip(self._lags, reference)]

    @property
    def leads_back(self) -> bool:
        """Whether the motion is on the way back to the reference."""
        return self._rejoining.active

    def late(self, t: int) -> bool:
        """Return whether a chunk that should go on at `t` [ns] has not come within the grace."""
        return self._trajectory.overdue(t)
