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


"""Types of vectors and matrices, and the H∞ norm of a sampled linear system."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]
Vector = Sequence[float]
Rows = Sequence[Sequence[float]]


#: How much more than the norm may be returned, relatively, and steps until that is so.
_MORE, _STEPS = 1e-3, 30
#: Frequencies at which to begin, and the distance from the unit circle that is rounding.
_GRID, _ON_CIRCLE = 100, 1e-8


def peak_gain(A: Array, B: Array, C: Array) -> float:
    """
    Return the H∞ norm of C (z - A)⁻¹ B, from above, to 0.1 %; inf if A is not stable.

    Bruinsma and Steinbuch, *A fast algorithm to compute the H∞ norm of a transfer function
    matrix*, Systems & Control Letters 14, 1990: γ is a singular value at z on the unit circle if
    and only if z is an eigenvalue of a pencil, so that above the norm there is none.

    Parameters
    ----------
    A, B, C : array, shape (m, m), (m, k) and (l, m)
        Of the system.

    """
    from scipy import linalg  # type: ignore[import-untyped]
    if not np.abs(np.linalg.eigvals(A)).max(initial=0.0) < 1.0:
        return np.inf
    m = len(A)
    A, (scale, _) = linalg.matrix_balance(A, permute=False, separate=True)
    B, C = B / scale[:, np.newaxis], C * scale
    angles = np.concatenate([[0.0], np.geomspace(1e-5, np.pi, _GRID)])
    level = _gain(A, B, C, angles)
    if level == 0.0:
        return 0.0
    zero, one = np.zeros((m, m)), np.eye(m)
    left, right = np.block([[one, zero], [C.T @ C, A.T]]), np.block([[A, B @ B.T], [zero, one]])
    for _ in range(_STEPS):
        level *= 1.0 + _MORE
        right[:m, m:] = B @ B.T / level ** 2
        found = linalg.eigvals(right, left)
        angles = np.sort(np.abs(np.angle(found[np.abs(np.abs(found) - 1.0) < _ON_CIRCLE])))
        if not len(angles):
            break
        level = max(level, _gain(A, B, C, np.concatenate(
            [angles, 0.5 * (angles[1:] + angles[:-1])])))
    return level


def _gain(A: Array, B: Array, C: Array, angles: Array) -> float:
    """Return the largest singular value at z = exp(j angle) for any of the angles."""
    z = np.exp(1j * angles)[:, np.newaxis, np.newaxis] * np.eye(len(A))
    return float(np.linalg.svd(C @ np.linalg.solve(z - A, B), compute_uv=False).max())
