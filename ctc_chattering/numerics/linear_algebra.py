"""
Vectors and matrices as sequences of floats.

For two to seven joints the products below take less time than numpy's. The plant integrates with
them; the control step is in arrays.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Vector = Sequence[float]
Rows = Sequence[Sequence[float]]


def dot(x: Vector, y: Vector) -> float:
    """Return xᵀ y."""
    total = 0.0
    for a, b in zip(x, y):
        total += a * b
    return total


def times(rows: Rows, x: Vector) -> list[float]:
    """Return the product of a matrix, shape (m, n), and a vector, shape (n,)."""
    return [dot(row, x) for row in rows]


def solve(rows: Rows, right: Vector) -> list[float]:
    """Solve A x = b for symmetric positive definite A by elimination (no pivoting needed)."""
    a = [list(row) for row in rows]
    x = list(right)
    n = len(x)
    for k in range(n):
        pivot, row_k = a[k][k], a[k]
        for i in range(k + 1, n):
            factor = a[i][k] / pivot
            if factor:
                row_i = a[i]
                for j in range(k + 1, n):
                    row_i[j] -= factor * row_k[j]
                x[i] -= factor * x[k]
    for k in range(n - 1, -1, -1):
        row_k = a[k]
        total = x[k]
        for j in range(k + 1, n):
            total -= row_k[j] * x[j]
        x[k] = total / row_k[k]
    return x
