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
What an equation is written with so that one text runs as plain Python and compiled.

`function` marks a function, `record` a NamedTuple with methods. Both are ordinary Python: their
vectors are arrays of shape (n,), their matrices arrays of shape (n, n). Compiled (`build`), a
vector is one value of the processor, and the same text runs without an array being made.

Such code uses on vectors: arithmetic, comparisons, ``&``, ``|``, ``[i]``, ``.max()``, ``.min()``,
`numpy.abs`, `sign`, `sqrt`, `cbrt`, `exp`, `sin`, `tanh`, `rint`, `minimum`, `maximum` and
`where`, and the functions of this module. It changes nothing in place: memory goes in and comes
out as a record, with other fields by ``record._replace(name=value)``. The one exception are rows
that outlive a call: of an array of shape (k, n), ``rows[i]`` is a vector and ``rows[i] = x`` sets
it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Truths = npt.NDArray[np.bool_]
F = TypeVar('F', bound=Callable[..., Any])
T = TypeVar('T')

#: What has been marked.
FUNCTIONS: list[Callable[..., Any]] = []
RECORDS: list[type] = []


def function(marked: F) -> F:
    """Mark a function that may be compiled; return it as it is."""
    FUNCTIONS.append(marked)
    return marked


def record(marked: type[T]) -> type[T]:
    """
    Mark a NamedTuple whose methods may be compiled; return it as it is.

    Parameters
    ----------
    marked : type
        Its fields are numbers, arrays and other records; its methods change nothing.

    """
    RECORDS.append(marked)
    return marked


def dot(matrix: Array, x: Array) -> Array:
    """
    Return the product of a matrix and a vector, also in compiled code.

    Parameters
    ----------
    matrix : ndarray
        Shape (n, n).
    x : ndarray
        Shape (n,).

    Returns
    -------
    ndarray
        Shape (n,).

    """
    product: Array = matrix.dot(x)
    return product


def transposed_dot(matrix: Array, x: Array) -> Array:
    """Return the product of the transposed matrix, shape (n,)."""
    product: Array = x.dot(matrix)
    return product


def diagonal(matrix: Array) -> Array:
    """Return the diagonal, shape (n,)."""
    return matrix.diagonal()


def inverse_diagonal(matrix: Array) -> Array:
    """Return the diagonal of M⁻¹, shape (n,), for M symmetric positive definite."""
    return np.asarray(np.linalg.inv(matrix), float).diagonal()


def solve(matrix: Array, x: Array) -> Array:
    """Return M⁻¹ x, shape (n,), for M symmetric positive definite."""
    if len(x) == 2:  # A tenth of the time.
        (a, b), (_, c) = matrix.tolist()
        x0, x1 = x.tolist()
        rest = c - b * b / a
        y1 = (x1 - b / a * x0) / rest
        return np.array(((x0 - b * y1) / a, y1))
    return np.asarray(np.linalg.solve(matrix, x), float)


def solve_where(chosen: Truths, matrix: Array, x: Array) -> Array:
    """Return y, shape (n,), with M y = x in the rows and columns `chosen`, and 0 elsewhere."""
    if every(chosen):
        return solve(matrix, x)
    at, y = np.flatnonzero(chosen), np.zeros(len(x))
    if len(at) == 1:  # A tenth of the time.
        y[at] = x[at] / matrix[at, at]
    else:
        y[at] = solve(matrix[np.ix_(at, at)], x[at])
    return y


def solve_damped(chosen: Truths, matrix: Array, damping: Array, x: Array) -> Array:
    """Return what `solve_where` does of ``M + diag(damping)``, shape (n,)."""
    return solve_where(chosen, matrix + np.diag(damping), x)


def outweighs(chosen: Truths, matrix: Array, weights: Array) -> bool:
    """Return whether ``M - diag(weights)`` is positive definite in rows and columns `chosen`."""
    remainder = matrix - np.diag(weights)
    if not every(chosen):
        at = np.flatnonzero(chosen)
        remainder = remainder[np.ix_(at, at)]
    try:
        np.linalg.cholesky(remainder)
    except np.linalg.LinAlgError:
        return False
    return True


def some(condition: Truths | Array) -> bool:
    """Return whether any element is true, or not 0; a fifth of the time of ``.any()``."""
    return any(condition.tolist())


def every(condition: Truths) -> bool:
    """Return whether all elements are true."""
    return all(condition.tolist())


def first(condition: Truths) -> int:
    """Return the index of the first element that is true; of none, 0."""
    return int(condition.argmax())


def replaced(x: Array, i: int, value: float) -> Array:
    """Return x with another element i, shape (n,)."""
    y: Array = x.copy()
    y[i] = value
    return y
