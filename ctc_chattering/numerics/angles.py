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
Positions of joints that turn endlessly: only the part beyond whole turns counts.

An angle q that follows another one stands for the representative of q modulo 2π that is nearest
to where the mean of both velocities leads within the time h in between::

    q + 2π k,  k = round((q0 + h (dq0 + dq) / 2 - q) / 2π)                                (AN1)
"""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, pi

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: A turn [rad].
TURN = 2.0 * pi
#: Turns beyond which an angle has no digits left for its part.
_MOST_TURNS = 2.0 ** 52


def turns_to(angle: float, target: float) -> int:
    """Return the whole turns to add to an angle that bring it nearest to `target`."""
    turns = (target - angle) / TURN
    return round(turns) if -_MOST_TURNS < turns < _MOST_TURNS else 0


def turned(angle: float, turns: int) -> float:
    """Return an angle and so many whole turns; the angle itself, bit by bit, for none."""
    return angle + TURN * turns if turns else angle


def nearest(angle: float, target: float) -> float:
    """Return the representative of an angle that is nearest to `target`."""
    return turned(angle, turns_to(angle, target))


def expected(angle: float, velocity_before: float, velocity: float, h: float) -> float:
    """Return where the mean of two velocities leads from an angle within the time `h` [s]."""
    return angle + 0.5 * h * (velocity_before + velocity)


def within_turn(angle: float, least: float) -> float:
    """Return the representative of an angle from `least` on to before `least` + 2π."""
    return angle - TURN * floor((angle - least) / TURN)


def unwrapped(t: Array, q: Array, dq: Array | None, continuous: Sequence[bool]) -> Array:
    """
    Return positions in which each angle follows the one before, by (AN1).

    Parameters
    ----------
    t : ndarray, shape (N,)
        Times, rising [s].
    q : ndarray, shape (N, n)
        Positions [rad or m]; they are not changed.
    dq : ndarray, shape (M, n), or None
        Velocities of the first M ≤ N positions [rad/s]; nan where they are unknown.
    continuous : sequence of bool, shape (n,)
        Which joints turn endlessly.

    """
    result = q
    # Joint by joint, for long series.
    for joint in np.flatnonzero(continuous).tolist():
        step = np.diff(q[:, joint])
        if dq is not None:
            velocity = np.nan_to_num(dq[:, joint], nan=0.0)
            mean = 0.5 * (velocity[1:] + velocity[:-1])
            step[:len(mean)] -= mean * np.diff(t[:len(velocity)])
        turns = np.rint(step / TURN)
        if turns.any():
            result = q.copy() if result is q else result
            result[1:, joint] -= TURN * np.cumsum(turns)
    return result


def unwrapped_beside(t: Array, q: Array, dq: Array, target: Array, continuous: Sequence[bool],
                     gaps: Sequence[int]) -> Array:
    """
    Return `unwrapped` positions that begin, also after gaps, nearest to a motion.

    Parameters
    ----------
    t, q, dq, continuous
        As of `unwrapped`, with all velocities.
    target : ndarray, shape (N, n)
        Desired positions [rad or m].
    gaps : sequence of int
        Indices of the samples before which many are missing.

    """
    if not any(continuous):
        return q
    result: Array = q.copy()
    for part in np.split(np.arange(len(t)), gaps):
        result[part] = unwrapped(t[part], q[part], dq[part], continuous)
        for joint in np.flatnonzero(continuous).tolist():
            first = part[0], joint
            result[part, joint] += TURN * turns_to(float(result[first]), float(target[first]))
    return result
