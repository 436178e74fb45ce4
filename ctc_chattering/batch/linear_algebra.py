"""Products and symmetric positive definite systems of a few unknowns, without allocation."""

from __future__ import annotations

from math import sqrt

from ctc_chattering.batch.compiler import inlined
from ctc_chattering.numerics.linear_algebra import Array


@inlined
def product(a: Array, x: Array, out: Array) -> None:
    """Set `out` to a x, shape (n,)."""
    n = len(x)
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += a[i, j] * x[j]
        out[i] = total


@inlined
def factor(a: Array, n: int, lower: Array) -> None:
    """Set `lower` to the Cholesky factor of the first `n` rows of `a`, its diagonal inverted."""
    for i in range(n):
        for j in range(i + 1):
            total = a[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            lower[i, j] = 1.0 / sqrt(total) if i == j else total * lower[j, j]


@inlined
def substitute(lower: Array, n: int, x: Array) -> None:
    """Replace the first `n` elements of `x`, the right side, by the solution."""
    for i in range(n):
        total = x[i]
        for k in range(i):
            total -= lower[i, k] * x[k]
        x[i] = total * lower[i, i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= lower[k, i] * x[k]
        x[i] = total * lower[i, i]


@inlined
def solve(a: Array, x: Array, lower: Array) -> None:
    """Replace `x`, shape (n,), by a⁻¹ x; `lower` is scratch of the shape (n, n)."""
    factor(a, len(x), lower)
    substitute(lower, len(x), x)


@inlined
def invert(a: Array, n: int, lower: Array, out: Array) -> None:
    """Set the first `n` rows of `out` to the inverse of those of `a`; `lower` is scratch."""
    factor(a, n, lower)
    for j in range(n):
        for i in range(n):
            out[j, i] = 1.0 if i == j else 0.0
        substitute(lower, n, out[j])
