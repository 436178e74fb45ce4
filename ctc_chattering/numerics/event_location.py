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

"""The first instant at which a function of time turns negative: events of the integrator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ctc_chattering.numerics.compilable import function

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
