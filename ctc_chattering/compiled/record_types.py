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
Numba's side of `records.py`: records, marked functions and methods in compiled code.

`build` imports this module. `register` makes all marked functions and methods known to numba. A
record in memory is a NumPy record. `load` turns it into a NamedTuple of numbers, vectors, matrices
and records, and `store` writes one back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import inspect
from math import prod
from typing import Any

from ctc_chattering.compiled import compilable, vectors
from ctc_chattering.compiled.matrices import MatrixType
from ctc_chattering.compiled.numba_interface import (
    defined,
    instructions,
    InstructionWriter,
    INT,
    INTERNAL,
    lowered,
    OVERLOADED,
    overloaded,
)
from ctc_chattering.compiled.records import element_of, kind_of, load, rows, store, value, write
from ctc_chattering.compiled.vectors import VectorType
from numba import types
from numba.extending import overload_method, register_jitable

#: Functions and records that `register` has seen.
_functions: list[Any] = []
_records: list[type] = []
#: Methods of records by name, and by the class of the record.
_methods: dict[str, dict[type, Callable[..., Any]]] = {}


def _read_at(array: Any, shape: Sequence[int], *index: Any) -> Any:
    """Return the code of a vector or matrix in an array of a record."""
    n = shape[-1]
    is_vector = len(shape) == 1

    def emit(writer: InstructionWriter, x: Any, *position: Any) -> Any:
        builder = writer.builder
        data = writer.data(array, x)
        for i in position:
            data = builder.gep(data, [builder.mul(i, INT(prod(shape)))])
        return vectors.read(builder, data, n) if is_vector else data
    return instructions(VectorType(n) if is_vector else MatrixType(n), (array, *index), emit)


@lowered
def _read_array(_typing: Any, array: Any) -> Any:
    return _read_at(array, array.shape)


@lowered
def _read_element(_typing: Any, array: Any, i: Any) -> Any:
    del i
    return _read_at(array, array.shape[1:], types.intp)


@overloaded(element_of)
def _element_of(array: Any, i: Any) -> Any:
    del array, i
    return lambda array, i: _read_element(array, i)


@lowered
def _write_array(_typing: Any, array: Any, source: Any) -> Any:
    def emit(writer: InstructionWriter, target: Any, x: Any) -> None:
        data = writer.data(array, target)
        if isinstance(source, VectorType):
            vectors.write(writer.builder, x, data)
        else:
            writer.copy(x, data, source.n ** 2)
    return instructions(types.none, (array, source), emit)


@lowered
def _rows(_typing: Any, array: Any, like: Any) -> Any:
    return instructions(MatrixType(like.n), (array, like),
                        lambda writer, x, _like: writer.data(array, x))


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
    marked = kind_of(tuple(fields.fields))
    values = ', '.join(f'value(fields.{name})' for name in marked._fields)
    source = f'def defined(fields):\n    return marked({values})'
    return defined(source, marked=marked, value=value)


@overloaded(store)
def _store(fields: Any, value: Any) -> Any:
    def line(name: str, field: Any) -> str:
        if isinstance(field, types.BaseNamedTuple):
            return f'    store(fields.{name}, value.{name})'
        if isinstance(field, VectorType | MatrixType):
            return f'    write(fields.{name}, value.{name})'
        return f'    fields.{name} = value.{name}'

    lines = map(line, value.fields, value)
    return defined('\n'.join(('def defined(fields, value):', *lines)),
                   store=store, write=_write_array)


def register() -> None:
    """Make all marked functions and methods known to numba."""
    _functions.extend(map(
        register_jitable(**INTERNAL), compilable.FUNCTIONS[len(_functions):]))
    for marked in [*compilable.RECORDS][len(_records):]:
        _records.append(marked)
        for name, method in inspect.getmembers(marked, inspect.isfunction):
            if not name.startswith('_'):
                _register_method(marked, name, method)


def _register_method(marked: type, name: str, method: Callable[..., Any]) -> None:
    """Register a method, which numba chooses by its class."""
    methods = _methods.setdefault(name, {})
    methods[marked] = method
    if len(methods) > 1:
        return

    def choose(record: Any, *_arguments: Any) -> Any:
        return methods.get(record.instance_class)

    setattr(choose, '__signature__', inspect.signature(method))  # noqa: B010
    for tuple_type in (types.NamedTuple, types.NamedUniTuple):
        overload_method(tuple_type, name, **OVERLOADED)(choose)
