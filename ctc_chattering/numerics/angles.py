# Copyright 2026 The ctc_chattering maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Positions of joints that turn endlessly.

Of such a position only the fraction of a turn counts. Controller, reference and bags bring angles
of a driver onto one continuous motion. An angle q that follows q0 after a time h stands for one of
its representatives q + 2π k. It is the one nearest to the prediction of the mean velocity::

    q + 2π k,  k = round((q0 + h (dq0 + dq) / 2 - q) / 2π)                                (AN1)
"""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, pi

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: A turn [rad].
TURN = 2.0 * pi
#: From this number of turns on, the fraction of a turn is below the resolution of a float.
_MAX_TURNS = 2.0 ** 52


def turns_to(angle: float, target: float) -> int:
    """Return whole turns that bring an angle near `target`."""
    turns = (target - angle) / TURN
    if not -_MAX_TURNS < turns < _MAX_TURNS:
        return 0
    return round(turns)


def turned(angle: float, turns: int) -> float:
    """Add whole turns to an angle, which none leaves unchanged."""
    return angle + TURN * turns if turns else angle


def nearest(angle: float, target: float) -> float:
    """Return an angle's representative nearest to `target`."""
    return turned(angle, turns_to(angle, target))


def expected(angle: float, velocity_before: float, velocity: float, h: float) -> float:
    """Predict an angle after `h` [s] from two velocities."""
    doubled_mean = velocity_before + velocity
    return angle + 0.5 * h * doubled_mean


def within_half_turn(difference: Array) -> Array:
    """Return differences of angles without whole turns [rad]."""
    wrapped: Array = difference - TURN * np.rint(difference / TURN)
    return wrapped


def within_turn(angle: float, lower: float) -> float:
    """Return an angle's representative in [`lower`, `lower` + 2π)."""
    turns = floor((angle - lower) / TURN)
    return angle - TURN * turns


def unwrapped(
        t: Array,
        q: Array,
        dq: Array | None,
        continuous: Sequence[bool]) -> Array:
    """
    Return positions with continuous angles, by (AN1).

    Parameters
    ----------
    t : ndarray, shape (N,)
        Times, rising [s].
    q : ndarray, shape (N, n)
        Positions [rad or m]. They are not changed, and returned themselves if they are continuous.
    dq : ndarray, shape (M, n), or None
        Velocities of the first M ≤ N positions [rad/s], with nan where they are unknown.
    continuous : sequence of bool, shape (n,)
        Flags of the joints that turn endlessly.

    """
    result = q
    # Joint by joint, to save memory with long series.
    for joint in np.flatnonzero(continuous).tolist():
        step = np.diff(q[:, joint])
        if dq is not None:
            velocity = np.nan_to_num(dq[:, joint], nan=0.0)
            mean = 0.5 * (velocity[1:] + velocity[:-1])
            h = np.diff(t[:len(velocity)])
            step[:len(mean)] -= mean * h
        turns = np.rint(step / TURN)
        if not turns.any():
            continue
        if result is q:
            result = q.copy()
        result[1:, joint] -= TURN * np.cumsum(turns)
    return result


def unwrapped_beside(
        t: Array,
        q: Array,
        dq: Array,
        target: Array,
        continuous: Sequence[bool],
        gaps: Sequence[int]) -> Array:
    """
    Return `unwrapped` positions beside a desired motion.

    They begin, also after gaps, nearest to it.

    Parameters
    ----------
    t, q, dq, continuous
        As in `unwrapped`, with all velocities.
    target : ndarray, shape (N, n)
        Desired positions [rad or m].
    gaps : sequence of int
        Indices of the samples behind a gap of many samples.

    """
    joints = np.flatnonzero(continuous).tolist()
    if not joints:
        return q
    result: Array = q.copy()
    for rows in np.split(np.arange(len(t)), gaps):
        result[rows] = unwrapped(t[rows], q[rows], dq[rows], continuous)
        begin = rows[0]
        for joint in joints:
            turns = turns_to(result[begin, joint], target[begin, joint])
            result[rows, joint] += TURN * turns
    return result
