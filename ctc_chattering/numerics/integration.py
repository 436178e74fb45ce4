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


"""Integration of ddq = f(q, dq, u): a step of Runge and Kutta, and the instants of events."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ctc_chattering.compiled.compilable import function
from ctc_chattering.numerics.linear_algebra import Array

Load = tuple[Array, Array, Array]


@function
def simpson(x: Array, sixth: float, k1: Array, k2: Array, k3: Array, k4: Array) -> Array:
    """Return x + sixth (k1 + 2 (k2 + k3) + k4), shape (n,)."""
    return x + sixth * (k1 + 2.0 * (k2 + k3) + k4)


@function
def runge_kutta(f: Callable[[Any, Array, Array, Array], Array], system: Any, q: Array, dq: Array,
                load: Load, h: float) -> tuple[Array, Array]:
    """
    Return q and dq after `h`, by the classical method of Runge and Kutta of fourth order.

    Parameters
    ----------
    f : callable
        ddq = f(system, q, dq, u).
    system : Any
        Handed on to `f`.
    q, dq : array, shape (n,)
        Position [rad] and velocity [rad/s].
    load : (u(t), u(t + h/2), u(t + h))
        Torques, each of shape (n,) [N·m].
    h : float
        Step [s].

    """
    half = 0.5 * h
    a = f(system, q, dq, load[0])
    v2 = dq + half * a
    b = f(system, q + half * dq, v2, load[1])
    v3 = dq + half * b
    c = f(system, q + half * v2, v3, load[1])
    v4 = dq + h * c
    d = f(system, q + h * v3, v4, load[2])
    return simpson(q, h / 6.0, dq, v2, v3, v4), simpson(dq, h / 6.0, a, b, c, d)


#: Enough for 40 bisections, one step in eight.
_MAX_STEPS = 330


@function
def first_negative(f: Callable[[Any, float], float], system: Any, end: float, f_end: float,
                   tol: float) -> float:
    """
    Return s in (0, end] with f(system, s) < 0 and a sign change within `tol` before it.

    The regula falsi with the Illinois rule, bisecting where that is slow. `f` may be 0 at 0 and
    rise from there (a joint that starts to slide): the sign change after the rise is found.

    Parameters
    ----------
    f : callable
        Not negative just after 0.
    system : Any
        Handed on to `f`.
    end : float
        Where `f` is negative.
    f_end : float
        f(system, end).
    tol : float
        Width of the bracket that is small enough.

    """
    high, f_high = end, f_end
    low, f_low = 0.5 * end, f(system, 0.5 * end)
    while f_low < 0.0:
        high, f_high = low, f_low
        low *= 0.5
        if low < tol:
            return high
        f_low = f(system, low)
    kept = 0
    for step in range(_MAX_STEPS):
        if high - low <= tol:
            break
        s = low + (high - low) * (0.5 if step % 8 == 7 else f_low / (f_low - f_high))
        if not low < s < high:
            s = 0.5 * (low + high)
        value = f(system, s)
        if value < 0.0:
            high, f_high = s, value
            if kept < 0:
                f_low *= 0.5
            kept = -1
        else:
            low, f_low = s, value
            if kept > 0:
                f_high *= 0.5
            kept = 1
    return high
