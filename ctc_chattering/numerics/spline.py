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

"""Cubic splines through long series, piece by piece, so that their coefficients need no memory."""

from __future__ import annotations

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.interpolate import CubicSpline  # type: ignore[import-untyped]

#: Values of a piece, and knots around it: what one changes falls by 0.27 from knot to knot.
_PIECE, _AROUND = 8192, 40


def interpolated(t: Array, x: Array, at: Array) -> Array:
    """
    Return a cubic spline through x, shape (N, n), at the times `at`, shape (M,): shape (M, n).

    Both times rise.
    """
    found = np.empty((len(at), *x.shape[1:]))
    for first in range(0, len(at), _PIECE):
        some = at[first:first + _PIECE]
        low, high = np.searchsorted(t, (some[0], some[-1]))
        knots = slice(max(0, int(low) - _AROUND), int(high) + _AROUND)
        found[first:first + _PIECE] = CubicSpline(t[knots], x[knots])(some)
    return found
