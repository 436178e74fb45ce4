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
Integration of ddq = f(q, dq, u), and event location.

`simulation/motion.py` moves the plant with it. `runge_kutta` is for motions that a step resolves.
`extrapolated_euler` is for those with a damping that a step does not resolve: with that damping
implicit it is stable for any step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ctc_chattering.compiled.compilable import function
from ctc_chattering.numerics.linear_algebra import Array

#: Torques in the middle and at the end of a step, each of shape (n,) [N·m].
Load = tuple[Array, Array]


@function
def simpson(x: Array, sixth: float, k1: Array, k2: Array, k3: Array, k4: Array) -> Array:
    """Add Simpson's mean of slopes, shape (n,)."""
    return x + sixth * (k1 + 2.0 * (k2 + k3) + k4)


@function
def runge_kutta(
        f: Callable[[Any, Array, Array, Array], Array],
        system: Any,
        q: Array,
        dq: Array,
        ddq: Array,
        load: Load,
        h: float) -> tuple[Array, Array]:
    """
    Return q and dq after a Runge-Kutta step.

    Parameters
    ----------
    f : callable
        ddq = f(system, q, dq, u).
    system : Any
        First argument of `f`.
    q, dq : array, shape (n,)
        Position [rad] and velocity [rad/s].
    ddq : array, shape (n,)
        f(system, q, dq, load) at the start [rad/s²].
    load : Load
        Torques u(t + h/2) and u(t + h).
    h : float
        Step [s].

    """
    half = 0.5 * h
    sixth = h / 6.0
    middle, end = load
    v2 = dq + half * ddq
    a2 = f(system, q + half * dq, v2, middle)
    v3 = dq + half * a2
    a3 = f(system, q + half * v2, v3, middle)
    v4 = dq + h * a3
    a4 = f(system, q + h * v3, v4, end)
    end_q = simpson(q, sixth, dq, v2, v3, v4)
    end_dq = simpson(dq, sixth, ddq, a2, a3, a4)
    return end_q, end_dq


#: Weights of the results of 1, 2, 3 and 4 steps that cancel the errors in h, h² and h³.
_WEIGHTS = (-1.0 / 6.0, 4.0, -13.5, 32.0 / 3.0)


@function
def extrapolated_euler(
        f: Callable[[Any, Array, Array, Array, float], Array],
        system: Any,
        q: Array,
        dq: Array,
        load: Array,
        h: float) -> tuple[Array, Array]:
    """
    Return q and dq after extrapolated Euler steps.

    The result is of fourth order.

    Parameters
    ----------
    f : callable
        (dq(t + s) - dq(t)) / s = f(system, q, dq, u, s) of an Euler step s, implicit in the
        damping. A damping D of an inertia M multiplies dq by 1 / (1 + s D / M).
    system : Any
        First argument of `f`.
    q, dq : array, shape (n,)
        Position [rad] and velocity [rad/s].
    load : array, shape (n,)
        Mean torque over the step [N·m].
    h : float
        Step [s].

    """
    end_q = q
    end_dq = 0.0 * dq
    for i in range(4):
        s = h / (i + 1)
        moved = 0.0 * q
        v = dq
        for _ in range(i + 1):
            v = v + s * f(system, q + moved, v, load, s)
            moved = moved + s * v
        weight = _WEIGHTS[i]
        end_q = end_q + weight * moved
        end_dq = end_dq + weight * v
    return end_q, end_dq


#: Every eighth step of the root search bisects, which ends a slow regula falsi.
_BISECTION_INTERVAL = 8
#: Enough steps for 40 bisections.
_MAX_STEPS = 330


@function
def first_negative(
        f: Callable[[Any, float], float],
        system: Any,
        end: float,
        f_end: float,
        tol: float) -> float:
    """
    Return the first s at which f(system, s) < 0.

    It is in (0, end], with a sign change within `tol` before it. The method is the regula falsi
    with the Illinois rule, and bisection where that is slow. `f` may be 0 at 0 and rise from there
    (a joint that starts to slide). The sign change after the rise is the result.

    Parameters
    ----------
    f : callable
        Not negative just after 0.
    system : Any
        First argument of `f`.
    end : float
        Where `f` is negative.
    f_end : float
        f(system, end).
    tol : float
        Sufficient width of the bracket.

    """
    high = end
    f_high = f_end
    low = 0.5 * end
    f_low = f(system, low)
    while f_low < 0.0:
        high = low
        f_high = f_low
        low *= 0.5
        if low < tol:
            return high
        f_low = f(system, low)
    retained = 0  # Side of the bracket that the last step kept: -1 low, +1 high.
    for step in range(_MAX_STEPS):
        if high - low <= tol:
            break
        bisects = step % _BISECTION_INTERVAL == _BISECTION_INTERVAL - 1
        share = 0.5 if bisects else f_low / (f_low - f_high)
        s = low + (high - low) * share
        if not low < s < high:
            s = 0.5 * (low + high)
        value = f(system, s)
        if value < 0.0:
            high = s
            f_high = value
            if retained < 0:
                f_low *= 0.5
            retained = -1
        else:
            low = s
            f_low = value
            if retained > 0:
                f_high *= 0.5
            retained = 1
    return high
