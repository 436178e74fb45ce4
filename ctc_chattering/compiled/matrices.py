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
Matrices of compiled code: rows of n floats in memory.

`build` imports this module. Then numba compiles the functions of `compilable.py` for arrays of
shape (n, n) to loops over rows, each of which is a vector of `vectors.py`.
"""

from __future__ import annotations

import operator
from typing import Any

from ctc_chattering.compiled import compilable
from ctc_chattering.compiled.numba_interface import (
    DOUBLE,
    instructions,
    InstructionWriter,
    INT,
    lowered,
    overloaded,
)
from ctc_chattering.compiled.vectors import read, VectorType, with_element, write
from llvmlite import ir
from numba import types
from numba.extending import models, register_model
import numpy as np


class MatrixType(types.Type):
    """Type of a matrix with rows of `n` floats."""

    def __init__(self, n: int) -> None:
        self.n = n
        super().__init__(f'matrix({n})')


@register_model(MatrixType)
class _MatrixModel(models.PrimitiveModel):

    def __init__(self, manager: Any, matrix: MatrixType) -> None:
        super().__init__(manager, matrix, DOUBLE.as_pointer())


def _row_pointer(writer: InstructionWriter, matrix: Any, i: Any, n: int) -> Any:
    """Return the pointer to row i."""
    return writer.builder.gep(matrix, [writer.builder.mul(i, INT(n))])


@lowered
def _row(_typing: Any, matrix: Any, i: Any) -> Any:
    del i
    return instructions(
        VectorType(matrix.n), (matrix, types.intp), lambda writer, pointer, i: read(
            writer.builder, _row_pointer(writer, pointer, i, matrix.n), matrix.n))


@lowered
def _set_row(_typing: Any, matrix: Any, i: Any, x: Any) -> Any:
    del i
    return instructions(
        types.none, (matrix, types.intp, x), lambda writer, pointer, i, vector: write(
            writer.builder, vector, _row_pointer(writer, pointer, i, matrix.n)))


@overloaded(operator.getitem)
def _item(matrix: Any, index: Any) -> Any:
    if isinstance(matrix, MatrixType) and isinstance(index, types.BaseTuple):
        return lambda matrix, index: _row(matrix, index[0])[index[1]]
    if isinstance(matrix, MatrixType) and isinstance(index, types.Integer):
        return lambda matrix, index: _row(matrix, index)
    return None


@overloaded(operator.setitem)
def _set_item(matrix: Any, i: Any, x: Any) -> Any:
    if isinstance(matrix, MatrixType):
        return lambda matrix, i, x: _set_row(matrix, i, x)
    return None


@lowered
def _scratch(_typing: Any, x: Any) -> Any:
    """Return a matrix that lasts as long as the function runs."""
    def emit(writer: InstructionWriter, _x: Any) -> Any:
        memory = writer.stack(ir.ArrayType(DOUBLE, x.n ** 2))
        return writer.builder.bitcast(memory, DOUBLE.as_pointer())
    return instructions(MatrixType(x.n), (x,), emit)


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
    """Eliminate by Cholesky's method; other rows are the identity's."""
    del damping
    n = x.n

    def solution(chosen: Any, matrix: Any, damping: Any, x: Any) -> Any:
        #: Row i has the reciprocal of the factor's diagonal at i.
        lower = _scratch(x)
        row = x
        y = x
        for i in range(n):
            total = x[i] if chosen[i] else 0.0
            for j in range(i):
                pivot = matrix[i, j] if chosen[i] and chosen[j] else 0.0
                for k in range(j):
                    pivot -= row[k] * lower[j, k]
                row = with_element(row, j, pivot * lower[j, j])
                total -= row[j] * y[j]
            pivot = matrix[i, i] + damping[i] if chosen[i] else 1.0
            for k in range(i):
                pivot -= row[k] * row[k]
            row = with_element(row, i, 1.0 / np.sqrt(pivot))
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
    """Try the elimination, which needs positive pivots."""
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
