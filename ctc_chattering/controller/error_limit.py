"""Whether the position error is within its limit."""

from __future__ import annotations

from ctc_chattering.numerics.linear_algebra import Vector


def joint_beyond(e: Vector, limit: Vector) -> int | None:
    """
    Return the first joint whose error is beyond its limit; None if all are within.

    Parameters
    ----------
    e : sequence of float, shape (n,)
        Position error [rad]; NaN is beyond any limit.
    limit : sequence of float, shape (n,)
        Largest magnitude allowed [rad].

    """
    for i, (x, most) in enumerate(zip(e, limit)):
        if not -most <= x <= most:
            return i
    return None
