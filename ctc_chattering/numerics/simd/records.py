"""
Records in the memory of NumPy records, from which compiled code takes them.

What is here does the same as plain Python, and compiled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
import hashlib
import inspect
from pathlib import Path
from typing import Any, get_type_hints

from ctc_chattering.numerics import compilable
from ctc_chattering.numerics.simd import joint_by_joint, matrices, vectors  # noqa: F401
from ctc_chattering.numerics.simd.matrices import MatrixType
from ctc_chattering.numerics.simd.vectors import lowered, overloaded, read, VectorType
from numba import types
from numba.extending import overload_method, register_jitable
import numpy as np
import numpy.typing as npt

#: Classes by the names that `named` has given.
_NAMED: dict[str, type] = {}
#: Methods of records by name and class.
_METHODS: dict[str, dict[type, Callable[..., Any]]] = {}
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


def load(kind: Any, fields: Any) -> Any:
    """Return a record of the class `kind` of the fields that `packed` made."""
    def made(part: Any, prefix: str) -> Any:
        return part(*(made(nested, f'{prefix}{name}__') if nested in compilable.RECORDS
                      else value(fields[prefix + name])
                      for name, nested in get_type_hints(part).items()))
    return made(kind, '')


def store(fields: Any, value: Any) -> None:
    """Write a record back into the fields that it was loaded from."""
    for name, x in _flat(value, ''):
        fields[name] = x


def value(field: Any) -> Any:
    """Return the vector or matrix of a field of a NumPy record."""
    return field.copy()


@overloaded(value)
def _value(field: Any) -> Any:
    if isinstance(field, types.Array):
        return lambda field: _read_array(field)
    return lambda field: field


def write(field: Any, x: Any) -> None:
    """Write a vector or matrix into a field of a NumPy record."""
    field[...] = x


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


def packed(value: Any) -> Any:
    """Return the numbers of a record, and of those in it, as a NumPy record for `load`."""
    return numpy_record({name: np.asarray(x, np.int64 if type(x) is int else float)
                         for name, x in _flat(value, '')})


def named(value: Any) -> Any:
    """
    Return what `packed` does, as `load_named` takes it: it knows the class from the names.

    The names change with the source text of the class, and the types of what is compiled with
    them, so that no code is taken for another's, and none needs the module to be read.
    """
    kind = type(value)
    text = Path(inspect.getfile(kind)).read_bytes()
    name = f'{kind.__name__}_{hashlib.sha256(text).hexdigest()[:12]}'
    _NAMED[name] = kind
    return numpy_record({f'{name}__{field}': np.asarray(x, float)
                         for field, x in value._asdict().items()})


def load_named(fields: Any) -> Any:
    """Return the record of which `named` has made the fields."""
    names = fields.dtype.names
    return _NAMED[names[0].partition('__')[0]](*(value(fields[name]) for name in names))


@overloaded(load_named)
def _load_named(fields: Any) -> Any:
    names = list(fields.fields)
    parts = ', '.join(f'_value(fields.{name})' for name in names)
    known = {'_value': value, 'made': _NAMED[names[0].partition('__')[0]]}
    exec(f'def load_named(fields):\n    return made({parts})', known)
    return known['load_named']


def numpy_record(fields: Mapping[str, npt.NDArray[Any]]) -> Any:
    """Return a NumPy record with fields of these names, types, shapes and values."""
    made = np.zeros(1, _layout(tuple((name, x.dtype, x.shape) for name, x in fields.items())))
    made[0] = tuple(fields.values())
    return made[0]


@lru_cache(256)
def _layout(fields: tuple[tuple[str, Any, tuple[int, ...]], ...]) -> Any:
    return np.dtype((np.record, np.dtype(list(fields), align=True)))


def _flat(part: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield the fields of a record, and of those in it, with their names in a NumPy record."""
    for name, x in zip(part._fields, part):
        if type(x) in compilable.RECORDS:
            yield from _flat(x, f'{prefix}{name}__')
        else:
            yield prefix + name, x


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
    """Have compiled code call a method of a class; classes may have methods of one name."""
    methods = _METHODS.setdefault(name, {})
    methods[marked] = method
    if len(methods) > 1:
        return

    def chosen(*kinds: Any) -> Any:
        return methods.get(kinds[0].instance_class)

    setattr(chosen, '__signature__', inspect.signature(method))  # noqa: B010
    for kind in (types.NamedTuple, types.NamedUniTuple):
        options: Any = {'strict': False}  # Their arguments may have other names.
        overload_method(kind, name, **options)(chosen)
