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

"""Matrices of compiled code: rows of n numbers, one after the other in memory."""

from __future__ import annotations

import operator
from typing import Any

from ctc_chattering.compiled import compilable
from ctc_chattering.compiled.vectors import (
    lowered,
    overloaded,
    read,
    VectorType,
    with_element,
    write,
)
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import models, register_model
import numpy as np

_DOUBLE = ir.DoubleType()


class MatrixType(types.Type):
    """Rows of `n` floats, one after the other in memory: `n` of them, unless it is said."""

    def __init__(self, n: int) -> None:
        self.n = n
        super().__init__(f'matrix({n})')


@register_model(MatrixType)
class _MatrixModel(models.PrimitiveModel):

    def __init__(self, manager: Any, kind: MatrixType) -> None:
        super().__init__(manager, kind, _DOUBLE.as_pointer())


def _start(context: Any, builder: Any, n: int, row: Any, kind: Any, matrix: Any) -> Any:
    """Return the pointer to a row of a matrix, its number being of a type of integers."""
    i = context.cast(builder, row, kind, types.intp)
    return builder.gep(matrix, [builder.mul(i, ir.Constant(i.type, n))])


@overloaded(operator.getitem)
def _item(matrix: Any, place: Any) -> Any:
    if isinstance(matrix, MatrixType) and isinstance(place, types.BaseTuple):
        return lambda matrix, place: _row(matrix, place[0])[place[1]]
    if isinstance(matrix, MatrixType) and isinstance(place, types.Integer):
        return lambda matrix, place: _row(matrix, place)
    return None


@lowered
def _row(_typing: Any, matrix: Any, i: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        row = _start(context, builder, matrix.n, values[1], signature.args[1], values[0])
        return read(builder, row, matrix.n)
    return VectorType(matrix.n)(matrix, i), generate


@lowered
def _set_row(_typing: Any, matrix: Any, i: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        row = _start(context, builder, matrix.n, values[1], signature.args[1], values[0])
        write(builder, values[2], row)
        return context.get_dummy_value()
    return types.none(matrix, i, x), generate


@overloaded(operator.setitem)
def _set_item(matrix: Any, i: Any, x: Any) -> Any:
    if isinstance(matrix, MatrixType):
        return lambda matrix, i, x: _set_row(matrix, i, x)
    return None


@lowered
def _scratch(_typing: Any, x: Any) -> Any:
    """Return a matrix for vectors like `x`, for as long as the function runs."""
    def generate(_context: Any, builder: Any, _signature: Any, _values: Any) -> Any:
        pointer = cgutils.alloca_once(builder, ir.ArrayType(_DOUBLE, x.n ** 2))
        return builder.bitcast(pointer, _DOUBLE.as_pointer())
    return MatrixType(x.n)(x), generate


@overloaded(compilable.dot)
def _dot(matrix: Any, x: Any) -> Any:
    n = x.n

    def product(matrix: Any, x: Any) -> Any:
        y = x
        for i in range(n):
            row = _row(matrix, i) * x
            total = row[0]
            for j in range(1, n):
                total += row[j]
            y = with_element(y, i, total)
        return y
    return product


@overloaded(compilable.transposed_dot)
def _transposed_dot(matrix: Any, x: Any) -> Any:
    n = x.n

    def product(matrix: Any, x: Any) -> Any:
        y = x[0] * _row(matrix, 0)
        for i in range(1, n):
            y = y + x[i] * _row(matrix, i)
        return y
    return product


@overloaded(compilable.diagonal)
def _diagonal(matrix: Any) -> Any:
    n = matrix.n

    def elements(matrix: Any) -> Any:
        y = _row(matrix, 0)
        for i in range(n):
            y = with_element(y, i, matrix[i, i])
        return y
    return elements


@overloaded(compilable.solve)
def _solve(matrix: Any, x: Any) -> Any:
    del matrix, x
    return lambda matrix, x: compilable.solve_where(x == x, matrix, x)


@overloaded(compilable.solve_where)
def _solve_where(chosen: Any, matrix: Any, x: Any) -> Any:
    del chosen, matrix, x
    return lambda chosen, matrix, x: compilable.solve_damped(
        chosen, matrix, np.where(chosen, 0.0, 0.0), x)


@overloaded(compilable.solve_damped)
def _solve_damped(chosen: Any, matrix: Any, damping: Any, x: Any) -> Any:
    """Eliminate by Cholesky's method, with the identity in rows and columns that are left out."""
    del damping
    n = x.n

    def solution(chosen: Any, matrix: Any, damping: Any, x: Any) -> Any:
        lower, row, y = _scratch(x), x, x
        for i in range(n):
            total = x[i] if chosen[i] else 0.0
            for j in range(i):
                rest = matrix[i, j] if chosen[i] and chosen[j] else 0.0
                for k in range(j):
                    rest -= row[k] * lower[j, k]
                row = with_element(row, j, rest * lower[j, j])
                total -= row[j] * y[j]
            rest = matrix[i, i] + damping[i] if chosen[i] else 1.0
            for k in range(i):
                rest -= row[k] * row[k]
            row = with_element(row, i, 1.0 / np.sqrt(rest))
            lower[i] = row
            y = with_element(y, i, total * row[i])
        for i in range(n - 1, -1, -1):
            total = y[i]
            for k in range(i + 1, n):
                total -= lower[k, i] * y[k]
            y = with_element(y, i, total * lower[i, i])
        return y
    return solution


@overloaded(compilable.outweighs)
def _outweighs(chosen: Any, matrix: Any, weights: Any) -> Any:
    """Try the elimination: it meets a number that is not positive where there is no solution."""
    del chosen, matrix, weights

    def definite(chosen: Any, matrix: Any, weights: Any) -> Any:
        y = compilable.solve_damped(chosen, matrix, -weights, weights)
        return compilable.every(np.abs(y) < np.inf)
    return definite


@overloaded(compilable.inverse_diagonal)
def _inverse_diagonal(matrix: Any) -> Any:
    n = matrix.n

    def elements(matrix: Any) -> Any:
        zero = 0.0 * _row(matrix, 0)
        y = zero
        for i in range(n):
            column = compilable.solve(matrix, with_element(zero, i, 1.0))
            y = with_element(y, i, column[i])
        return y
    return elements
