"""A smooth start: from any state into a given motion, without a step in the acceleration."""

from __future__ import annotations

from math import isfinite
from typing import Protocol

from ctc_chattering.core.grid import NANOSECONDS, seconds
from ctc_chattering.core.model import Vector
from ctc_chattering.core.polynomial import quintic
from ctc_chattering.core.trajectory import Point
from ctc_chattering.errors import ParameterError


class Motion(Protocol):
    """A motion as a function of time."""

    def at(self, t: int) -> Point:
        """Return position, velocity and acceleration, each of shape (n,), at `t` [ns]."""


class Blend:
    """
    The motion m(t) plus a correction that fades.

    On every joint the correction is the quintic that takes q0 - m(t0), dq0 - dm(t0) and
    ddq0 - ddm(t0) to zero over `duration`: position, velocity and acceleration are continuous
    where those of m are. On `t0` it is the state given and from the end of the correction on it is
    m, both to the last bit; before `t0` it rests at q0.

    Parameters
    ----------
    motion : Motion
        The motion m to merge into.
    t0 : int
        Instant of the start [ns].
    q0, dq0 : sequence of float, shape (n,)
        Position [rad] and velocity [rad/s] to start from.
    duration : float
        Time that the correction takes [s].
    ddq0 : sequence of float, shape (n,), optional
        Acceleration to start from [rad/s²]; 0 if empty.

    Raises
    ------
    ParameterError
        If the duration is less than a nanosecond, or a state is not n finite numbers.

    """

    def __init__(self, motion: Motion, t0: int, q0: Vector, dq0: Vector, duration: float,
                 ddq0: Vector = ()) -> None:
        span = round(duration * NANOSECONDS) if isfinite(duration) else 0
        if span < 1:
            raise ParameterError('duration', duration, 'a finite number of seconds >= 1e-9')
        there = motion.at(t0)
        n = len(there[0])
        self._start: Point = (tuple(q0), tuple(dq0), tuple(ddq0) or (0.0,) * n)
        for name, row in zip(('q0', 'dq0', 'ddq0'), self._start):
            if len(row) != n or not all(map(isfinite, row)):
                raise ParameterError(name, tuple(row), f'{n} finite numbers, one per joint')
        self._motion = motion
        self._t0, self._end = t0, t0 + span
        self._span = seconds(span)
        self._steps = [
            (q - m, dq - dm, ddq - ddm)
            for q, dq, ddq, m, dm, ddm in zip(*self._start, *there)]

    @property
    def end(self) -> int:
        """Instant from which on it is the motion itself [ns]."""
        return self._end

    def at(self, t: int) -> Point:
        """Return position, velocity and acceleration, each of shape (n,), at `t` [ns]."""
        if t >= self._end:
            return self._motion.at(t)
        if t <= self._t0:
            rest = (0.0,) * len(self._steps)
            return self._start if t == self._t0 else (self._start[0], rest, rest)
        s = seconds(t - self._t0) / self._span
        fading = [quintic(s, self._span, *step, 0.0, 0.0, 0.0) for step in self._steps]
        return tuple(  # type: ignore[return-value]
            tuple(x + y for x, y in zip(row, more))
            for row, more in zip(self._motion.at(t), zip(*fading)))
