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

"""Compilation of a function of records and arrays to machine code that needs no numba to run."""

from __future__ import annotations

import fcntl
from itertools import count
from typing import Any

from ctc_chattering.numerics.machine_code import Code, invoke, Layout
from ctc_chattering.numerics.simd.records import register
from ctc_chattering.numerics.simd.vectors import INTERNAL, lowered, overloaded
from llvmlite import ir
import numba
from numba import types
from numba.core import cgutils

_INT = ir.IntType(64)


def build(code: Code) -> None:
    """Compile a function, unless another process has done it meanwhile, and keep its code."""
    with code.path.with_suffix('.lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not code.compiled:
            code.keep(*_machine_code(code))


def _machine_code(code: Code) -> tuple[str, bytes]:
    """Return the name of the function, and an object file."""
    register()
    # Without numba's memory: what would allocate an array is refused here.
    options: Any = {'nogil': True, 'error_model': 'numpy', '_nrt': False,
                    'no_cpython_wrapper': True, 'no_cfunc_wrapper': True}
    made = numba.njit(types.int64(types.int64), **options)(_entry(code))
    result: Any = made.overloads[made.signatures[0]]
    return result.fndesc.llvm_func_name, result.library._get_compiled_object()


def _entry(code: Code) -> Any:
    """Return a function that takes the address of the places of all arguments."""
    names: dict[str, Any] = {'_place': _place, '_record': _record, '_array': _array,
                             'function': numba.extending.register_jitable(
                                 **INTERNAL)(code.function)}
    place = count()

    def construction(argument: Layout) -> str:
        name = f'kind_{len(names)}'
        if argument.kind == 'record':
            names[name] = numba.from_dtype(argument.dtype)
            return f'_record(_place(places, {next(place)}), {name})'
        if argument.kind == 'array':
            names[name] = types.Array(
                numba.from_dtype(argument.dtype), len(argument.shape) + 1, 'C')
            start, length = next(place), next(place)
            shape = ''.join(f'{x}, ' for x in argument.shape)
            return (f'_array(_place(places, {start}), (_place(places, {length}), {shape}), '
                    f'{name})')
        names[name] = argument.kind
        return f'{name}({", ".join(map(construction, argument.parts))})'

    arguments = ', '.join(map(construction, code.layouts))
    exec(f'def entry(places):\n    return function({arguments})', names)
    return names['entry']


@lowered
def _place(_typing: Any, places: Any, i: Any) -> Any:
    """Return the i-th number at an address."""
    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        start = builder.inttoptr(values[0], _INT.as_pointer())
        return builder.load(builder.gep(start, [values[1]]))
    return types.int64(places, i), generate


@lowered
def _record(_typing: Any, place: Any, kind: Any) -> Any:
    """Return the NumPy record at an address."""
    made = kind.instance_type

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return builder.inttoptr(values[0], context.get_value_type(made))
    return made(place, kind), generate


@lowered
def _array(_typing: Any, place: Any, shape: Any, kind: Any) -> Any:
    """Return the array at an address."""
    made = kind.instance_type

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        array = context.make_array(made)(context, builder)
        lengths = [builder.extract_value(values[1], i) for i in range(made.ndim)]
        size = context.get_abi_sizeof(context.get_data_type(made.dtype))
        strides = [ir.Constant(_INT, size)]
        for length in reversed(lengths[1:]):
            strides.insert(0, builder.mul(strides[0], length))
        array.data = builder.inttoptr(
            values[0], context.get_data_type(made.dtype).as_pointer())
        array.shape = cgutils.pack_array(builder, lengths)
        array.strides = cgutils.pack_array(builder, strides)
        array.itemsize = ir.Constant(_INT, size)
        items = lengths[0]
        for length in lengths[1:]:
            items = builder.mul(items, length)
        array.nitems = items
        array.meminfo = cgutils.get_null_value(array.meminfo.type)
        array.parent = cgutils.get_null_value(array.parent.type)
        return array._getvalue()
    return made(place, shape, kind), generate


@lowered
def _called(_typing: Any, function: Any, places: Any) -> Any:
    """Return what the function at an address returns."""
    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        result = cgutils.alloca_once(builder, _INT)
        error = cgutils.alloca_once(builder, cgutils.voidptr_t)
        kind = ir.FunctionType(ir.IntType(32), [result.type, error.type, _INT])
        builder.call(builder.inttoptr(values[0], kind.as_pointer()), [result, error, values[1]])
        return builder.load(result)
    return types.int64(function, places), generate


@overloaded(invoke)
def _invoke(function: Any, places: Any) -> Any:
    del function, places
    return lambda function, places: _called(function, places)
