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
Vectors of compiled code: n numbers, or n truth values, are one value of the processor.

Arithmetic is one instruction for all joints, nothing is allocated, and n is a constant.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import operator
from typing import Any

from ctc_chattering.compiled import compilable
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, overload_method, register_model
import numpy as np

DOUBLE, BIT, INT = ir.DoubleType(), ir.IntType(1), ir.IntType(32)
#: Of functions that compiled code alone calls: an entry for C takes a tenth of the compilation.
INTERNAL: Any = {'no_cfunc_wrapper': True}
#: Of what is overloaded; strictly, numba would compare annotations.
OVERLOADED: Any = {'strict': False, 'jit_options': INTERNAL}
Decorator = Callable[[Callable[..., Any]], Any]
#: The decorated function says to which instructions it is compiled.
lowered: Decorator = intrinsic
#: The decorated function returns, by its types, what compiled code calls for another one.
overloaded: Callable[[Any], Decorator] = partial(overload, **OVERLOADED)


class VectorType(types.Type):
    """`n` floats, or as many truth values."""

    def __init__(self, n: int, truth: bool = False) -> None:
        self.n, self.truth = n, truth
        super().__init__(f'{"truths" if truth else "vector"}({n})')


@register_model(VectorType)
class _VectorModel(models.PrimitiveModel):

    def __init__(self, manager: Any, kind: VectorType) -> None:
        super().__init__(manager, kind, ir.VectorType(BIT if kind.truth else DOUBLE, kind.n))


#: As `overloaded`, for a method of vectors.
method: Callable[[str], Decorator] = partial(overload_method, VectorType, **OVERLOADED)


def is_vector(kind: Any) -> bool:
    return isinstance(kind, VectorType) and not kind.truth


def _is_truths(kind: Any) -> bool:
    return isinstance(kind, VectorType) and kind.truth


def _is_number(kind: Any) -> bool:
    return isinstance(kind, types.Number | types.Boolean)


def constant(n: int, value: float) -> Any:
    return ir.Constant(ir.VectorType(DOUBLE, n), [ir.Constant(DOUBLE, value)] * n)


def _broadcast(context: Any, builder: Any, kind: Any, value: Any, n: int) -> Any:
    """Return a vector; a number in all its elements."""
    if isinstance(kind, VectorType):
        return value
    number = context.cast(builder, value, kind, types.float64)
    made = ir.Constant(ir.VectorType(DOUBLE, n), ir.Undefined)
    for i in range(n):
        made = builder.insert_element(made, number, ir.Constant(INT, i))
    return made


def _elementwise(function: Any, emit: Callable[..., Any], truth: bool = False,
                 takes: Callable[[Any], bool] = is_vector) -> None:
    """Have `function` take two vectors, or a vector and a number; `emit` writes it."""
    @lowered
    def made(_typing: Any, a: Any, b: Any) -> Any:
        n = a.n if isinstance(a, VectorType) else b.n
        left, right = (x if isinstance(x, VectorType) else types.float64 for x in (a, b))

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return emit(builder, *(_broadcast(context, builder, kind, value, n)
                                   for kind, value in zip(signature.args, values)))
        return VectorType(n, truth)(left, right), generate

    @overloaded(function)
    def chosen(a: Any, b: Any) -> Any:
        if any(map(takes, (a, b))) and all(takes(x) or _is_number(x) for x in (a, b)):
            return lambda a, b: made(a, b)
        return None


def _of_one(function: Any, emit: Callable[..., Any], takes: Callable[[Any], bool] = is_vector
            ) -> None:
    """Have `function` take a vector and return one; `emit` writes it."""
    @lowered
    def made(_typing: Any, a: Any) -> Any:
        return a(a), lambda _context, builder, _signature, values: emit(builder, values[0], a.n)

    @overloaded(function)
    def chosen(a: Any) -> Any:
        return (lambda a: made(a)) if takes(a) else None


def _built_in(name: str) -> Callable[..., Any]:
    """Return what calls a function of LLVM for whole vectors."""
    def emit(builder: Any, value: Any, n: int) -> Any:
        kind = ir.FunctionType(value.type, [value.type])
        return builder.call(cgutils.get_or_insert_function(
            builder.module, kind, f'llvm.{name}.v{n}f64'), [value])
    return emit


def _each(name: str) -> Callable[..., Any]:
    """Return what calls a function of the C library for each element."""
    def emit(builder: Any, value: Any, n: int) -> Any:
        called = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(DOUBLE, [DOUBLE]), name)
        made = ir.Constant(value.type, ir.Undefined)
        for place in (ir.Constant(INT, i) for i in range(n)):
            one = builder.call(called, [builder.extract_element(value, place)])
            made = builder.insert_element(made, one, place)
        return made
    return emit


def _sign(builder: Any, value: Any, n: int) -> Any:
    zero = constant(n, 0.0)
    negative = builder.select(
        builder.fcmp_ordered('<', value, zero), constant(n, -1.0), value)  # nan and 0 are kept
    return builder.select(builder.fcmp_ordered('>', value, zero), constant(n, 1.0), negative)


def _extreme(comparison: str) -> Callable[..., Any]:
    def emit(builder: Any, a: Any, b: Any) -> Any:
        chosen = builder.select(builder.fcmp_ordered(comparison, a, b), a, b)
        return builder.select(builder.fcmp_unordered('uno', a, a), a, chosen)  # nan is kept
    return emit


def _comparison(sign: str) -> Callable[..., Any]:
    def emit(builder: Any, a: Any, b: Any) -> Any:
        compare = builder.fcmp_unordered if sign == '!=' else builder.fcmp_ordered
        return compare(sign, a, b)
    return emit


for _function, _instruction in ((operator.add, 'fadd'), (operator.sub, 'fsub'),
                                (operator.mul, 'fmul'), (operator.truediv, 'fdiv')):
    _elementwise(_function, lambda builder, a, b, name=_instruction: getattr(builder, name)(a, b))
for _function, _instruction in ((operator.lt, '<'), (operator.le, '<='), (operator.gt, '>'),
                                (operator.ge, '>='), (operator.eq, '=='), (operator.ne, '!=')):
    _elementwise(_function, _comparison(_instruction), truth=True)
_elementwise(np.minimum, _extreme('<'))
_elementwise(np.maximum, _extreme('>'))
for _function, _instruction in ((operator.and_, 'and_'), (operator.or_, 'or_')):
    _elementwise(_function, lambda builder, a, b, name=_instruction: getattr(builder, name)(a, b),
                 truth=True, takes=_is_truths)
_of_one(operator.neg, lambda builder, value, _n: builder.fneg(value))
_of_one(operator.invert, lambda builder, value, _n: builder.not_(value), _is_truths)
_of_one(np.abs, _built_in('fabs'))
_of_one(np.sqrt, _built_in('sqrt'))
_of_one(np.rint, _built_in('rint'))
_of_one(np.sign, _sign)
for _function in (np.exp, np.cbrt, np.sin, np.tanh):
    _of_one(_function, _each(_function.__name__))


@lowered
def _select(_typing: Any, condition: Any, a: Any, b: Any) -> Any:
    n = condition.n
    left, right = (x if isinstance(x, VectorType) else types.float64 for x in (a, b))

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.select(values[0], *(
            _broadcast(context, builder, kind, value, n)
            for kind, value in zip(signature.args[1:], values[1:])))
    return VectorType(n, any(map(_is_truths, (a, b))))(condition, left, right), generate


@overloaded(np.where)
def _where(condition: Any, a: Any, b: Any) -> Any:
    if _is_truths(condition):
        return lambda condition, a, b: _select(condition, a, b)
    return None


@lowered
def _any_of(_typing: Any, condition: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        bits = builder.bitcast(values[0], ir.IntType(condition.n))
        return builder.icmp_unsigned('!=', bits, ir.Constant(bits.type, 0))
    return types.boolean(condition), generate


@overloaded(compilable.some)
def _some(condition: Any) -> Any:
    if condition.truth:
        return lambda condition: _any_of(condition)
    return lambda condition: _any_of(condition != 0.0)


@overloaded(compilable.every)
def _every(condition: Any) -> Any:
    return (lambda condition: not _any_of(~condition)) if condition.truth else None


@lowered
def _element(_typing: Any, x: Any, i: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place = context.cast(builder, values[1], signature.args[1], types.int32)
        return builder.extract_element(values[0], place)
    return (types.boolean if x.truth else types.float64)(x, i), generate


@overloaded(operator.getitem)
def _item(x: Any, i: Any) -> Any:
    if isinstance(x, VectorType) and isinstance(i, types.Integer):
        return lambda x, i: _element(x, i)
    return None


@lowered
def with_element(_typing: Any, x: Any, i: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place = context.cast(builder, values[1], signature.args[1], types.int32)
        return builder.insert_element(values[0], values[2], place)
    return x(x, i, types.float64), generate


@method('max')
def _max(x: Any) -> Any:
    n = x.n

    def largest(x: Any) -> Any:
        found = x[0]
        for i in range(1, n):
            if x[i] > found or x[i] != x[i]:  # nan is kept.
                found = x[i]
        return found
    return largest


@method('min')
def _min(x: Any) -> Any:
    del x
    return lambda x: -(-x).max()


@overloaded(compilable.first)
def _first(condition: Any) -> Any:
    n = condition.n

    def index(condition: Any) -> Any:
        for i in range(n):
            if condition[i]:
                return i
        return 0
    return index


@overloaded(compilable.replaced)
def _replaced(x: Any, i: Any, value: Any) -> Any:
    del x, i, value
    return lambda x, i, value: with_element(x, i, float(value))


def read(builder: Any, pointer: Any, n: int) -> Any:
    """Return the vector at a pointer."""
    made = builder.load(builder.bitcast(pointer, ir.VectorType(DOUBLE, n).as_pointer()))
    made.align = 8
    return made


def write(builder: Any, vector: Any, pointer: Any) -> None:
    """Write a vector to a pointer."""
    builder.store(vector, builder.bitcast(pointer, vector.type.as_pointer())).align = 8
