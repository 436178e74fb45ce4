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

"""What the plant's code does with vectors, which in plain Python are lists."""

from __future__ import annotations

from typing import Any

from ctc_chattering.numerics import compilable
from ctc_chattering.numerics.simd.vectors import (
    BIT,
    constant,
    DOUBLE,
    INT,
    is_vector,
    lowered,
    overloaded,
    VectorType,
    with_element,
)
from llvmlite import ir
from numba import types


@overloaded(compilable.each)
def _each_joint(scalar: Any, *vectors: Any) -> Any:
    """Write the loop over the joints; what is no vector is a number that is theirs in common."""
    kinds = vectors[0] if isinstance(vectors[0], tuple) else vectors
    parts = [f'vectors[{k}][i]' if isinstance(kind, VectorType) else f'vectors[{k}]'
             for k, kind in enumerate(kinds)]
    first = next(k for k, kind in enumerate(kinds) if is_vector(kind))
    text = (f'def joint_by_joint(scalar, *vectors):\n'
            f'    y = vectors[{first}]\n'
            f'    for i in range({kinds[first].n}):\n'
            f'        y = with_element(y, i, scalar({", ".join(parts)}))\n'
            f'    return y')
    names: dict[str, Any] = {'with_element': with_element}
    exec(text, names)
    return names['joint_by_joint']


@overloaded(compilable.uniform)
def _uniform(x: Any) -> Any:
    del x
    return lambda x: x


@overloaded(compilable.exchanged)
def _exchanged(rows: Any, i: Any, x: Any) -> Any:
    n = x.n

    def exchange(rows: Any, i: Any, x: Any) -> Any:
        before = x
        for j in range(n):
            before = with_element(before, j, rows[i, j])
            rows[i, j] = x[j]
        return before
    return exchange


@overloaded(compilable.array)
def _array(x: Any) -> Any:
    del x
    return lambda x: x


@overloaded(compilable.along)
def _along(x: Any, step: Any, direction: Any) -> Any:
    del x, step, direction
    return lambda x, step, direction: x + step * direction


@lowered
def _least_of(_typing: Any, x: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        least = ir.Constant(DOUBLE, float('inf'))
        for i in range(x.n):
            one = builder.extract_element(values[0], ir.Constant(INT, i))
            least = builder.select(builder.fcmp_ordered('<', one, least), one, least)
        return least
    return types.float64(x), generate


@overloaded(compilable.least)
def _least(x: Any) -> Any:
    del x
    return lambda x: _least_of(x)


@lowered
def _bits_of(_typing: Any, x: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        some = builder.fcmp_unordered('!=', values[0], constant(x.n, 0.0))
        return builder.zext(builder.bitcast(some, ir.IntType(x.n)), ir.IntType(64))
    return types.int64(x), generate


@overloaded(compilable.bits)
def _bits(x: Any) -> Any:
    del x
    return lambda x: _bits_of(x)


@lowered
def _truths_of(_typing: Any, number: Any, x: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return builder.bitcast(builder.trunc(values[0], ir.IntType(x.n)),
                               ir.VectorType(BIT, x.n))
    return VectorType(x.n, truth=True)(types.int64, x), generate


@overloaded(compilable.truths)
def _truths(number: Any, x: Any) -> Any:
    del number, x
    return lambda number, x: _truths_of(number, x)
