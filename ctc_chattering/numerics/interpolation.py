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
Polynomials between two states, and cubic splines through long series.

`trajectory/` and `bags/` interpolate desired motions with the polynomials, `bags/recording.py`
resamples recordings with the spline. A polynomial spans a time h [s] and is evaluated at a share
s in [0, 1] of it, or at an array of them. At s = 0 its value is the start value to the last bit.
"""

from __future__ import annotations

from typing import Any

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Value and two derivatives of a polynomial.
CurvePoint = tuple[Any, Any, Any]


def linear(s: float, h: float, x0: float, x1: float) -> CurvePoint:
    """Evaluate the straight line from `x0` to `x1`."""
    d = x1 - x0
    x = x0 + s * d
    return x, d / h, 0.0


def cubic(
        s: float,
        h: float,
        x0: float,
        v0: float,
        x1: float,
        v1: float) -> CurvePoint:
    """Evaluate the cubic with velocities at its ends."""
    v0 = v0 * h
    v1 = v1 * h
    d = x1 - x0
    c2 = 3.0 * d - 2.0 * v0 - v1
    c3 = v0 + v1 - 2.0 * d
    x = x0 + s * (v0 + s * (c2 + s * c3))
    dx = v0 + s * (2.0 * c2 + s * 3.0 * c3)
    ddx = 2.0 * c2 + s * 6.0 * c3
    return x, dx / h, ddx / (h * h)


def quintic(
        s: Any,
        h: float,
        x0: float,
        v0: float,
        a0: float,
        x1: float,
        v1: float,
        a1: float) -> CurvePoint:
    """Evaluate the quintic with accelerations `a0`, `a1` at its ends."""
    v0 = v0 * h
    v1 = v1 * h
    a0 = a0 * h * h
    a1 = a1 * h * h
    d = x1 - x0
    c2 = 0.5 * a0
    c3 = 10.0 * d - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1
    c4 = -15.0 * d + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1
    c5 = 6.0 * d - 3.0 * (v0 + v1) - 0.5 * (a0 - a1)
    x = x0 + s * (v0 + s * (c2 + s * (c3 + s * (c4 + s * c5))))
    dx = v0 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))
    ddx = 2.0 * c2 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))
    return x, dx / h, ddx / (h * h)


def interpolated(t: Array, x: Array, new_t: Array) -> Array:
    """
    Evaluate a cubic spline through `x`, shape (M, n).

    Parameters
    ----------
    t, x : array, shape (N,) and (N, n)
        Times, rising, and values.
    new_t : array, shape (M,)
        Times, rising.

    """
    from scipy.interpolate import CubicSpline  # type: ignore[import-untyped]  # Takes time.
    # Column by column, since coefficients of all columns of a long series need much memory.
    columns = [CubicSpline(t, column)(new_t) for column in x.T]
    return np.column_stack(columns)
