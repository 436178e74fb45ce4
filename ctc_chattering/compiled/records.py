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
Records in memory, as machine code reads and writes them.

A marked NamedTuple becomes a NumPy record. `packed` makes one before the first call, `load` and
`store` bring values out and in. A record in a record is a NumPy record in a NumPy record. A float
is a float there, an int an int, a bool a bool, and an array an array of floats. `record_types.py`
does the same in compiled code.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from ctc_chattering.compiled import compilable
import numpy as np

#: First word of the name of the field whose further words name the class of the record.
_IS = 'is '
#: Types of numbers by their kinds in NumPy. All others are floats.
_NUMBERS: dict[str, type] = {'i': int, 'b': bool}


def rows(array: Any, like: Any) -> Any:
    """Return an array as rows of the length of `like`."""
    return array.reshape(-1, len(like))


def element_of(array: Any, i: int) -> Any:
    """Return vector or matrix `i` of a field of a NumPy record; it must not be negative."""
    return array[i]


def load(fields: Any) -> Any:
    """Return the record in a NumPy record."""
    marked = kind_of(fields.dtype.names)
    return marked(*(value(fields[name]) for name in marked._fields))


def store(fields: Any, value: Any) -> None:
    """Write a record into a NumPy record."""
    for name, x in zip(value._fields, value):
        if type(x) in compilable.RECORDS:
            store(fields[name], x)
        else:
            fields[name] = x


def views(fields: Any) -> Any:
    """
    Return the record in a NumPy record, with views of its fields.

    Numbers are arrays of shape ().

    Parameters
    ----------
    fields : NumPy record, or array of shape ()
        Of `packed`, or a record in it.

    """
    if isinstance(fields, np.void):
        fields = np.frombuffer(fields, fields.dtype).reshape(())
    marked = kind_of(fields.dtype.names)
    return marked(*(views(fields[name]) if fields.dtype[name].names else fields[name]
                  for name in marked._fields))


def value(field: Any) -> Any:
    """Return the value of a field of a NumPy record."""
    if isinstance(field, np.void):
        return load(field)
    return field.copy() if field.ndim else field.item()


def write(field: Any, x: Any) -> None:
    """Write a vector or matrix into a field."""
    field[...] = x


def packed(value: Any) -> Any:
    """Return a record, and those in it, as a NumPy record."""
    layout, values = described(value)
    return _record(_packed_layout(layout), values)


def fill(record: Any, values: tuple[Any, ...]) -> None:
    """Set the values of a NumPy record, as `described` returns them."""
    record.base[0] = values


def described(value: Any) -> tuple[Any, tuple[Any, ...]]:
    """
    Return layout and values of a record.

    The layout is the class, and for each field type and shape, or the same of a record.
    """
    layouts = []
    values = []
    for x in value:
        layout: Any = float, ()
        if type(x) in compilable.RECORDS:
            layout, x = described(x)
        elif type(x) is not float:
            x = np.asarray(x)
            layout = float if x.ndim else _NUMBERS.get(x.dtype.kind, float), x.shape
        layouts.append(layout)
        values.append(x)
    return (type(value), *layouts), (*values, 0)


@lru_cache(256)
def _packed_layout(described: tuple[Any, ...]) -> Any:
    """Return the layout of a NumPy record of what `described` returns."""
    marked, *layouts = described
    fields = [(name, *((_packed_layout(x), ()) if x[0] in compilable.RECORDS else x))
              for name, x in zip(marked._fields, layouts)]
    return _layout((*fields, (_IS + _name(marked), int, ())))


def record_of(values: Any) -> Any:
    """Return the numbers and arrays of an object as a NumPy record."""
    fields = {name: np.asarray(x) for name, x in vars(values).items()}
    layout = _layout(tuple((name, x.dtype, x.shape) for name, x in fields.items()))
    return _record(layout, tuple(fields.values()))


def _record(layout: Any, values: tuple[Any, ...]) -> Any:
    record = np.zeros(1, layout)
    record[0] = values
    return record[0]


@lru_cache(256)
def _layout(fields: tuple[tuple[str, Any, tuple[int, ...]], ...]) -> Any:
    return np.dtype((np.record, np.dtype(list(fields), align=True)))


@lru_cache(256)
def kind_of(names: tuple[str, ...]) -> Any:
    """Return the class of a NumPy record with these fields."""
    name, = (name.removeprefix(_IS) for name in names if name.startswith(_IS))
    return next(marked for marked in compilable.RECORDS if _name(marked) == name)


def _name(marked: type) -> str:
    return f'{marked.__module__}.{marked.__qualname__}'
