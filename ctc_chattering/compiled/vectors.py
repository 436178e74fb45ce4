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
Vectors of compiled code: n floats or booleans in one value.

`build` imports this module. Then numba compiles the operations that `compilable.py` allows on
arrays of shape (n,) to instructions for whole vectors. Nothing is allocated, and n is a constant.
Each operation has two declarations: an intrinsic writes its instructions, and an overload chooses
the intrinsic by the types of the arguments.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
import operator
from typing import Any

from ctc_chattering.compiled import compilable
from ctc_chattering.compiled.numba_interface import (
    Decorator,
    DOUBLE,
    instructions,
    InstructionWriter,
    lowered,
    OVERLOADED,
    overloaded,
)
from llvmlite import ir
from numba import types
from numba.extending import lower_cast, models, overload_method, register_model
import numpy as np

_BIT = ir.IntType(1)
_INDEX = ir.IntType(32)
#: In memory vectors are arrays of floats, at any multiple of so many bytes.
_ALIGNMENT = 8


class VectorType(types.Type):
    """Type of `n` floats."""

    element: Any = DOUBLE
    scalar: Any = types.float64

    def __init__(self, n: int) -> None:
        self.n = n
        super().__init__(f'{type(self).__name__}({n})')


class MaskType(VectorType):
    """Type of `n` booleans."""

    element = _BIT
    scalar = types.boolean


@register_model(VectorType)
@register_model(MaskType)
class _VectorModel(models.PrimitiveModel):

    def __init__(self, manager: Any, vector: VectorType) -> None:
        super().__init__(manager, vector, ir.VectorType(vector.element, vector.n))


#: As `overloaded`, for a method of vectors.
method: Callable[[str], Decorator] = partial(overload_method, VectorType, **OVERLOADED)


def _vector(builder: Any, elements: Sequence[Any]) -> Any:
    """Return the vector of these floats."""
    vector = ir.Constant(ir.VectorType(DOUBLE, len(elements)), ir.Undefined)
    for i, element in enumerate(elements):
        vector = builder.insert_element(vector, element, _INDEX(i))
    return vector


@lower_cast(types.Number, VectorType)  # type: ignore[untyped-decorator]
@lower_cast(types.Boolean, VectorType)  # type: ignore[untyped-decorator]
def _broadcast(context: Any, builder: Any, number: Any, vector: Any, value: Any) -> Any:
    """Return a number as all elements of a vector."""
    return _vector(builder, [context.cast(builder, value, number, types.float64)] * vector.n)


def _is_number(argument: Any) -> bool:
    return isinstance(argument, types.Number | types.Boolean)


def _declare_binary(function: Any, emit: Callable[..., Any], operand: Any = VectorType,
                    result: Any = VectorType) -> None:
    """Compile a function of two operands or numbers."""
    @lowered
    def operation(_typing: Any, a: Any, b: Any) -> Any:
        n = (a if type(a) is operand else b).n
        return instructions(
            result(n), (operand(n),) * 2, lambda writer, x, y: emit(writer.builder, x, y))

    @overloaded(function)
    def choose(a: Any, b: Any) -> Any:
        operands = [type(x) is operand for x in (a, b)]
        if any(operands) and all(map(operator.or_, operands, map(_is_number, (a, b)))):
            return lambda a, b: operation(a, b)
        return None


def _declare_unary(function: Any, emit: Callable[..., Any], operand: Any = VectorType) -> None:
    """Compile a function of one operand."""
    @lowered
    def operation(_typing: Any, x: Any) -> Any:
        return instructions(x, (x,), emit)

    @overloaded(function)
    def choose(x: Any) -> Any:
        return (lambda x: operation(x)) if type(x) is operand else None


def _write(name: str, builder: Any, *values: Any) -> Any:
    """Write the instruction of this name."""
    return getattr(builder, name)(*values)


def _compare(sign: str, builder: Any, a: Any, b: Any) -> Any:
    compare = builder.fcmp_unordered if sign == '!=' else builder.fcmp_ordered
    return compare(sign, a, b)


def _extreme(sign: str, builder: Any, a: Any, b: Any) -> Any:
    """Return the elements of a that compare so with b, or are nan."""
    extreme = builder.select(builder.fcmp_ordered(sign, a, b), a, b)
    return builder.select(builder.fcmp_unordered('uno', a, a), a, extreme)


def _call_llvm(name: str, writer: InstructionWriter, x: Any) -> Any:
    """Call a function of LLVM for the whole vector."""
    return writer.call_c(f'llvm.{name}.v{x.type.count}f64', x.type, x)


def _call_library(name: str, writer: InstructionWriter, x: Any) -> Any:
    """Call a function of the C library for each element."""
    return _vector(writer.builder, [
        writer.call_c(name, DOUBLE, writer.builder.extract_element(x, _INDEX(i)))
        for i in range(x.type.count)])


def _sign(writer: InstructionWriter, x: Any) -> Any:
    builder = writer.builder
    zero, plus, minus = (
        ir.Constant(x.type, [value] * x.type.count) for value in (0.0, 1.0, -1.0))
    # Neither branch takes 0 and what is not a number: they are their own sign.
    negative = builder.select(builder.fcmp_ordered('<', x, zero), minus, x)
    return builder.select(builder.fcmp_ordered('>', x, zero), plus, negative)


_ARITHMETIC = {
    operator.add: 'fadd',
    operator.sub: 'fsub',
    operator.mul: 'fmul',
    operator.truediv: 'fdiv',
}
_LOGIC = {
    operator.and_: 'and_',
    operator.or_: 'or_',
}
_COMPARISONS = {
    operator.lt: '<',
    operator.le: '<=',
    operator.gt: '>',
    operator.ge: '>=',
    operator.eq: '==',
    operator.ne: '!=',
}
_FUNCTIONS_OF_LLVM = {
    np.abs: 'fabs',
    np.sqrt: 'sqrt',
    np.rint: 'rint',
}
_FUNCTIONS_OF_C = {
    np.exp: 'exp',
    np.cbrt: 'cbrt',
    np.sin: 'sin',
    np.tanh: 'tanh',
}
for _function, _name in _ARITHMETIC.items():
    _declare_binary(_function, partial(_write, _name))
for _function, _name in _LOGIC.items():
    _declare_binary(_function, partial(_write, _name), MaskType, MaskType)
for _function, _name in _COMPARISONS.items():
    _declare_binary(_function, partial(_compare, _name), result=MaskType)
for _ufunc, _name in _FUNCTIONS_OF_LLVM.items():
    _declare_unary(_ufunc, partial(_call_llvm, _name))
for _ufunc, _name in _FUNCTIONS_OF_C.items():
    _declare_unary(_ufunc, partial(_call_library, _name))
_declare_binary(np.minimum, partial(_extreme, '<'))
_declare_binary(np.maximum, partial(_extreme, '>'))
_declare_unary(operator.neg, lambda writer, x: writer.builder.fneg(x))
_declare_unary(operator.invert, lambda writer, x: writer.builder.not_(x), MaskType)
_declare_unary(np.sign, _sign)


@lowered
def _select(_typing: Any, condition: Any, a: Any, b: Any) -> Any:
    chosen = MaskType if MaskType in map(type, (a, b)) else VectorType
    result = chosen(condition.n)
    return instructions(result, (condition, result, result),
                        lambda writer, *values: writer.builder.select(*values))


@overloaded(np.where)
def _where(condition: Any, a: Any, b: Any) -> Any:
    if isinstance(condition, MaskType):
        return lambda condition, a, b: _select(condition, a, b)
    return None


@lowered
def _any_of(_typing: Any, condition: Any) -> Any:
    def emit(writer: InstructionWriter, mask: Any) -> Any:
        bits = writer.builder.bitcast(mask, ir.IntType(condition.n))
        return writer.builder.icmp_unsigned('!=', bits, bits.type(0))
    return instructions(types.boolean, (condition,), emit)


@overloaded(compilable.some)
def _some(condition: Any) -> Any:
    if isinstance(condition, MaskType):
        return lambda condition: _any_of(condition)
    return lambda condition: _any_of(condition != 0.0)


@overloaded(compilable.every)
def _every(condition: Any) -> Any:
    return (lambda condition: not _any_of(~condition)) if type(condition) is MaskType else None


@lowered
def _element(_typing: Any, x: Any, i: Any) -> Any:
    del i
    return instructions(x.scalar, (x, types.int32),
                        lambda writer, *values: writer.builder.extract_element(*values))


@overloaded(operator.getitem)
def _item(x: Any, i: Any) -> Any:
    if isinstance(x, VectorType) and isinstance(i, types.Integer):
        return lambda x, i: _element(x, i)
    return None


@lowered
def with_element(_typing: Any, x: Any, i: Any, value: Any) -> Any:
    """Return x with another element i."""
    del i, value
    return instructions(
        x, (x, types.int32, types.float64),
        lambda writer, vector, i, value: writer.builder.insert_element(vector, value, i))


@lowered
def _rotate(_typing: Any, x: Any) -> Any:
    order = [*range(1, x.n), 0]
    mask = ir.Constant(ir.VectorType(_INDEX, x.n), order)
    return instructions(
        x, (x,), lambda writer, vector: writer.builder.shuffle_vector(vector, vector, mask))


@overloaded(compilable.replaced)
def _replaced(x: Any, i: Any, value: Any) -> Any:
    del x, i, value
    return lambda x, i, value: with_element(x, i, float(value))


@overloaded(compilable.rotated)
def _rotated(x: Any) -> Any:
    del x
    return lambda x: _rotate(x)


@method('max')
def _max(x: Any) -> Any:
    n = x.n

    def largest(x: Any) -> Any:
        result = x[0]
        for i in range(1, n):
            if x[i] > result or x[i] != x[i]:  # What is not a number is kept.
                result = x[i]
        return result
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


def read(builder: Any, pointer: Any, n: int) -> Any:
    """Return the vector at a pointer."""
    source = builder.bitcast(pointer, ir.VectorType(DOUBLE, n).as_pointer())
    vector = builder.load(source)
    vector.align = _ALIGNMENT
    return vector


def write(builder: Any, vector: Any, pointer: Any) -> None:
    """Write a vector to a pointer."""
    target = builder.bitcast(pointer, vector.type.as_pointer())
    builder.store(vector, target).align = _ALIGNMENT
