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
Types of arrays, and the H∞ norm of a sampled system.

All folders annotate their arrays with these types. `margins/loop_margins.py` bounds with
the norm how much a loop tolerates.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]
Vector = Sequence[float]
Rows = Sequence[Sequence[float]]

#: Relative amount by which `peak_gain` may exceed the norm.
_RELATIVE_TOLERANCE = 1e-3
#: The iteration converges quadratically. Some five steps are usual.
_MAX_ITERATIONS = 30
#: Angles of the first grid on the upper half of the unit circle.
_GRID_SIZE = 100
#: Distance of an eigenvalue from the unit circle that rounding explains.
_CIRCLE_TOLERANCE = 1e-8


def peak_gain(A: Array, B: Array, C: Array) -> float:
    """
    Return the H∞ norm of C (z - A)⁻¹ B.

    The result is from above, to 0.1 %, and inf if A is not stable. The method is that of
    Bruinsma and Steinbuch, *A fast algorithm to compute the H∞ norm of a transfer function
    matrix*, Systems & Control Letters 14, 1990: γ is a singular value at z on the unit circle if
    and only if z is an eigenvalue of a pencil, so that above the norm there is none.

    Parameters
    ----------
    A, B, C : array, shape (m, m), (m, k) and (l, m)
        Matrices of the system.

    """
    from scipy import linalg  # type: ignore[import-untyped]
    poles = np.linalg.eigvals(A)
    if not np.abs(poles).max(initial=0.0) < 1.0:
        return np.inf
    m = len(A)
    A, (scale, _) = linalg.matrix_balance(A, permute=False, separate=True)
    B = B / scale[:, np.newaxis]
    C = C * scale
    upper_half = np.geomspace(1e-5, np.pi, _GRID_SIZE)
    angles = np.concatenate([[0.0], upper_half])
    level = _gain(A, B, C, angles)
    if level == 0.0:
        return 0.0
    zero = np.zeros((m, m))
    identity = np.eye(m)
    pencil_left = np.block([
        [identity, zero],
        [C.T @ C, A.T]])
    pencil_right = np.block([
        [A, B @ B.T],
        [zero, identity]])
    for _ in range(_MAX_ITERATIONS):
        level *= 1.0 + _RELATIVE_TOLERANCE
        pencil_right[:m, m:] = B @ B.T / level ** 2
        roots = linalg.eigvals(pencil_right, pencil_left)
        distance = np.abs(np.abs(roots) - 1.0)
        on_circle = distance < _CIRCLE_TOLERANCE
        if not on_circle.any():
            break
        angles = np.sort(np.abs(np.angle(roots[on_circle])))
        midpoints = 0.5 * (angles[1:] + angles[:-1])
        more_angles = np.concatenate([angles, midpoints])
        level = max(level, _gain(A, B, C, more_angles))
    return level


def _gain(A: Array, B: Array, C: Array, angles: Array) -> float:
    """Return the largest singular value at exp(j angle)."""
    z = np.exp(1j * angles)
    pencils = z[:, np.newaxis, np.newaxis] * np.eye(len(A)) - A
    inputs = B[np.newaxis]  # NumPy 1 may take B for a stack of vectors.
    responses = C @ np.linalg.solve(pencils, inputs)
    singular_values = np.linalg.svd(responses, compute_uv=False)
    return float(singular_values.max())
