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
Compilation of a function of records and arrays to machine code that needs no numba to run.

First what `records` does, and the functions and methods that are marked, in compiled code.
"""

from __future__ import annotations

from collections.abc import Callable
import fcntl
import inspect
from itertools import count
from typing import Any

from ctc_chattering.compiled import compilable, vectors
from ctc_chattering.compiled.machine_code import Code, invoke, Layout
from ctc_chattering.compiled.matrices import MatrixType
from ctc_chattering.compiled.records import kind_of, load, rows, store, value, write
from ctc_chattering.compiled.vectors import lowered, overloaded, read, VectorType
from ctc_chattering.output_files import writing
from llvmlite import ir
import numba
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_builtin
from numba.core.typing import templates
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr
from numba.extending import overload_method, register_jitable
from numba.np.arrayobj import populate_array

#: Functions and records that `register` has seen.
_REGISTERED: tuple[list[Any], list[Any]] = ([], [])
#: Methods of records by name, and by the class of the record.
_METHODS: dict[str, dict[type, Callable[..., Any]]] = {}


@lowered
def _read_array(_typing: Any, array: Any) -> Any:
    """Return a vector or a matrix of an array whose shape is known, as those of records are."""
    made = VectorType(array.shape[0]) if array.ndim == 1 else MatrixType(array.shape[0])

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        data = context.make_array(array)(context, builder, values[0]).data
        return read(builder, data, made.n) if array.ndim == 1 else data
    return made(array), generate


@lowered
def _write_array(_typing: Any, array: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        data = context.make_array(array)(context, builder, values[0]).data
        if isinstance(value, VectorType):
            vectors.write(builder, values[1], data)
        else:
            cgutils.memcpy(builder, data, values[1], ir.Constant(_INT, value.n ** 2))
        return context.get_dummy_value()
    return types.none(array, value), generate


@lowered
def _rows(_typing: Any, array: Any, like: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return context.make_array(array)(context, builder, values[0]).data
    return MatrixType(like.n)(array, like), generate


@overloaded(rows)
def _rows_of(array: Any, like: Any) -> Any:
    return lambda array, like: _rows(array, like)


@overloaded(value)
def _value(field: Any) -> Any:
    if isinstance(field, types.Array):
        return lambda field: _read_array(field)
    return (lambda field: load(field)) if isinstance(field, types.Record) else lambda field: field


@overloaded(write)
def _write(field: Any, x: Any) -> Any:
    del field, x
    return lambda field, x: _write_array(field, x)


@overloaded(load)
def _load(fields: Any) -> Any:
    kind = kind_of(tuple(fields.fields))
    names: dict[str, Any] = {'kind': kind, 'value': value}
    values = (f'value(fields.{name})' for name in kind._fields)
    exec(f'def load(fields):\n    return kind({", ".join(values)})', names)
    return names['load']


@overloaded(store)
def _store(fields: Any, value: Any) -> Any:
    def line(name: str, kind: Any) -> str:
        if isinstance(kind, types.BaseNamedTuple):
            return f'store(fields.{name}, value.{name})'
        if isinstance(kind, VectorType | MatrixType):
            return f'write(fields.{name}, value.{name})'
        return f'fields.{name} = value.{name}'

    names: dict[str, Any] = {'store': store, 'write': _write_array}
    lines = map(line, value.fields, value)
    exec('def stored(fields, value):\n    ' + '\n    '.join(lines), names)
    return names['stored']


class _Replaced(AbstractTemplate):
    """What ``record._replace(name=value, ...)`` gives: a record with other values by name."""

    key = 'record._replace'

    def generic(self, _args: Any, kws: Any) -> Any:
        """Return the signature; a field that is not given has the type of None."""
        record = self.this  # type: ignore[attr-defined]
        kinds = dict(zip(record.fields, record)) | kws
        made = types.BaseTuple.from_types(tuple(kinds.values()), record.instance_class)
        named = [inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None)
                 for name in record.fields]
        return templates.signature(
            made, *(kws.get(name, types.none) for name in record.fields), recvr=record,
        ).replace(pysig=inspect.Signature(named))


@infer_getattr
class _Replace(AttributeTemplate):

    key = types.BaseNamedTuple

    def resolve__replace(self, record: Any) -> Any:
        """Return the type of the method."""
        return types.BoundFunction(_Replaced, record)


@lower_builtin(  # type: ignore[untyped-decorator]
    _Replaced.key, types.BaseNamedTuple, types.VarArg(types.Any))
def _lower_replace(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    record, *given = values
    return context.make_tuple(builder, signature.return_type, [
        old if kind is types.none else new for kind, old, new in zip(
            signature.args[1:], cgutils.unpack_tuple(builder, record), given)])


def register() -> None:
    """Have compiled code call what has been marked since the last time."""
    marks = len(compilable.FUNCTIONS), len(compilable.RECORDS)
    if marks == tuple(map(len, _REGISTERED)):
        return
    for marked in compilable.FUNCTIONS[len(_REGISTERED[0]):]:
        _REGISTERED[0].append(register_jitable(**vectors.INTERNAL)(marked))
    for marked in compilable.RECORDS[len(_REGISTERED[1]):]:
        for name, method in inspect.getmembers(marked, inspect.isfunction):
            if not name.startswith('_'):
                _register_method(marked, name, method)
        _REGISTERED[1].append(marked)


def _register_method(marked: type, name: str, method: Callable[..., Any]) -> None:
    """Have compiled code find a method by the class of its record."""
    methods = _METHODS.setdefault(name, {})
    methods[marked] = method
    if len(methods) > 1:
        return

    def chosen(*kinds: Any) -> Any:
        return methods.get(kinds[0].instance_class)

    setattr(chosen, '__signature__', inspect.signature(method))  # noqa: B010
    for kind in (types.NamedTuple, types.NamedUniTuple):
        overload_method(kind, name, **vectors.OVERLOADED)(chosen)


_INT = ir.IntType(64)


def build(code: Code) -> None:
    """
    Compile a function, unless another process has done it meanwhile, and keep its code.

    Raises
    ------
    CtcError
        If the code cannot be written.

    """
    file = code.path.with_suffix('.lock')
    with writing(file):
        lock = file.open('w')
    with lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not code.compiled:
            made = compiled(code)
            code.keep(made.fndesc.llvm_func_name, made.library._get_compiled_object())


def compiled(code: Code) -> Any:
    """Return a function as numba has compiled it: with a name, a module of LLVM, and an object."""
    register()
    # Without numba's memory: what would allocate an array is refused here.
    options: Any = {'nogil': True, 'error_model': 'numpy', '_nrt': False,
                    'no_cpython_wrapper': True, 'no_cfunc_wrapper': True}
    made = numba.njit(types.int64(types.int64), **options)(_entry(code))
    return made.overloads[made.signatures[0]]


def _entry(code: Code) -> Any:
    """Return a function that takes the address of the places of all arguments."""
    function = register_jitable(**vectors.INTERNAL)(code.function)
    names: dict[str, Any] = {'function': function, 'at': _at, 'numbers': types.int64[::1]}
    place = count()

    def construction(argument: Layout) -> str:
        name = f'kind_{len(names)}'
        if argument.parts:
            names[name] = argument.kind
            return f'{name}({", ".join(map(construction, argument.parts))})'
        names[name] = types.Array(numba.from_dtype(argument.dtype), len(argument.shape) + 1, 'C')
        if argument.kind == 'record':
            return f'at(places[{next(place)}], (1,), {name})[0]'
        start, length = next(place), next(place)
        shape = ''.join(f'{x}, ' for x in argument.shape)
        return f'at(places[{start}], (places[{length}], {shape}), {name})'

    arguments = ', '.join(map(construction, code.layouts))
    exec(f'def entry(address):\n    places = at(address, ({next(place)},), numbers)\n'
         f'    return function({arguments})', names)
    return names['entry']


@lowered
def _at(_typing: Any, address: Any, shape: Any, kind: Any) -> Any:
    """Return the array at an address."""
    made = kind.instance_type

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        array = context.make_array(made)(context, builder)
        element = context.get_data_type(made.dtype)
        lengths = cgutils.unpack_tuple(builder, values[1])
        size = ir.Constant(_INT, context.get_abi_sizeof(element))
        strides = [size]
        for length in reversed(lengths[1:]):
            strides.insert(0, builder.mul(strides[0], length))
        populate_array(array, builder.inttoptr(values[0], element.as_pointer()), lengths, strides,
                       size, None)
        return array._getvalue()
    return made(address, shape, kind), generate


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
