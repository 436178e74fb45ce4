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
Interpolation: polynomials that meet given values at both ends of a span, and long cubic splines.

Each polynomial is evaluated at a share s in [0, 1] of the span h [s] and returns value, first and
second derivative by time. At s = 0 the value is the given one, to the last bit.
"""

from __future__ import annotations

from typing import Any, TypeVar

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

T = TypeVar('T', bound=Any)


def linear(s: float, h: float, x0: float, x1: float) -> tuple[float, float, float]:
    """Return the straight line from `x0` to `x1`."""
    d = x1 - x0
    return x0 + s * d, d / h, 0.0


def cubic(s: float, h: float, x0: float, v0: float, x1: float,
          v1: float) -> tuple[float, float, float]:
    """Return the cubic with values `x0`, `x1` and velocities `v0`, `v1` at its ends."""
    v0, v1 = v0 * h, v1 * h
    d = x1 - x0
    c2 = 3.0 * d - 2.0 * v0 - v1
    c3 = v0 + v1 - 2.0 * d
    return (x0 + s * (v0 + s * (c2 + s * c3)),
            (v0 + s * (2.0 * c2 + s * 3.0 * c3)) / h,
            (2.0 * c2 + s * 6.0 * c3) / (h * h))


def quintic(s: T, h: float, x0: float, v0: float, a0: float, x1: float, v1: float,
            a1: float) -> tuple[T, T, T]:
    """Return the quintic that has accelerations `a0` and `a1` at its ends; `s` may be an array."""
    v0, v1, a0, a1 = v0 * h, v1 * h, a0 * h * h, a1 * h * h
    d = x1 - x0
    c2 = 0.5 * a0
    c3 = 10.0 * d - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1
    c4 = -15.0 * d + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1
    c5 = 6.0 * d - 3.0 * (v0 + v1) - 0.5 * (a0 - a1)
    return (x0 + s * (v0 + s * (c2 + s * (c3 + s * (c4 + s * c5)))),
            (v0 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / h,
            (2.0 * c2 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) / (h * h))


def interpolated(t: Array, x: Array, at: Array) -> Array:
    """
    Return a cubic spline through x, shape (N, n), at the times `at`, shape (M,): shape (M, n).

    Both times rise.
    """
    from scipy.interpolate import CubicSpline  # type: ignore[import-untyped]  # Takes time.
    found = np.empty((len(at), x.shape[1]))
    # Joint by joint, for long series.
    for i, column in enumerate(x.T):
        found[:, i] = CubicSpline(t, column)(at)
    return found
