"""What `numerics.records` does, and the functions and methods of records, in compiled code."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import inspect
from typing import Any, get_type_hints

from ctc_chattering.numerics import compilable
from ctc_chattering.numerics.records import load, store, value, write
from ctc_chattering.numerics.simd import matrices, vectors
from ctc_chattering.numerics.simd.matrices import MatrixType
from ctc_chattering.numerics.simd.vectors import lowered, overloaded, read, VectorType
from numba import types
from numba.extending import overload_method, register_jitable

#: Functions and records that `register` has seen.
_REGISTERED: tuple[list[Any], list[Any]] = ([], [])


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
            matrices.copy(builder, values[1], data, value.n)
        return context.get_dummy_value()
    return types.none(array, value), generate


@overloaded(value)
def _value(field: Any) -> Any:
    if isinstance(field, types.Array):
        return lambda field: _read_array(field)
    return lambda field: field


@overloaded(write)
def _write(field: Any, x: Any) -> Any:
    del field, x
    return lambda field, x: _write_array(field, x)


@overloaded(load)
def _load(kind: Any, fields: Any) -> Any:
    names: dict[str, Any] = {'_value': value}

    def construction(made: type, prefix: str) -> str:
        names[made.__name__] = made
        parts = (construction(nested, f'{prefix}{name}__') if nested in compilable.RECORDS
                 else f'_value(fields.{prefix}{name})'
                 for name, nested in get_type_hints(made).items())
        return f'{made.__name__}({", ".join(parts)})'

    del fields
    exec(f'def load(kind, fields):\n    return {construction(kind.instance_class, "")}', names)
    return names['load']


@overloaded(store)
def _store(fields: Any, value: Any) -> Any:
    def lines(made: Any, prefix: str, path: str) -> Iterator[str]:
        for name, kind in zip(made.fields, made):
            if isinstance(kind, types.BaseNamedTuple):
                yield from lines(kind, f'{prefix}{name}__', f'{path}.{name}')
            elif isinstance(kind, VectorType | MatrixType):
                yield f'_write_array(fields.{prefix}{name}, {path}.{name})'
            else:
                yield f'fields.{prefix}{name} = {path}.{name}'

    del fields
    names: dict[str, Any] = {'_write_array': _write_array}
    exec('def store(fields, value):\n    ' + '\n    '.join(lines(value, '', 'value')), names)
    return names['store']


def register() -> None:
    """Have compiled code call what has been marked since the last time."""
    for marked in compilable.FUNCTIONS[len(_REGISTERED[0]):]:
        _REGISTERED[0].append(register_jitable(marked))
    for marked in compilable.RECORDS[len(_REGISTERED[1]):]:
        for name, method in inspect.getmembers(marked, inspect.isfunction):
            if not name.startswith('_'):
                clash = [x.__name__ for x in compilable.RECORDS if name in x.__annotations__]
                assert not clash, f'method {name} of {marked.__name__} is a field of {clash}'
                _register_method(marked, name, method)
        _REGISTERED[1].append(marked)


def _register_method(marked: type, name: str, method: Callable[..., Any]) -> None:
    def chosen(*kinds: Any) -> Any:
        return method if kinds[0].instance_class is marked else None

    setattr(chosen, '__signature__', inspect.signature(method))  # noqa: B010
    for kind in (types.NamedTuple, types.NamedUniTuple):
        overload_method(kind, name)(chosen)
