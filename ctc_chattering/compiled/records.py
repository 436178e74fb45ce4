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
Records in the memory of NumPy records, in which compiled code finds and leaves them.

A record in a record is a NumPy record in a NumPy record. What is here is plain Python; `build`
does the same in compiled code.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from ctc_chattering.compiled import compilable
import numpy as np
import numpy.typing as npt

#: In the name of the field that says of which class a record is.
_IS = 'is '


def rows(array: Any, like: Any) -> Any:
    """Return an array whose rows are one after the other as rows of the length of `like`."""
    return array.reshape(-1, len(like))


def load(fields: Any) -> Any:
    """Return the record of which `packed` made the fields."""
    kind = kind_of(fields.dtype.names)
    return kind(*(value(fields[name]) for name in kind._fields))


def store(fields: Any, value: Any) -> None:
    """Write a record back into the fields that it was loaded from."""
    for name, x in zip(value._fields, value):
        if type(x) in compilable.RECORDS:
            store(fields[name], x)
        else:
            fields[name] = x


def views(fields: Any) -> Any:
    """
    Return the record of `load`, with views of the fields; numbers are arrays of shape ().

    Parameters
    ----------
    fields : NumPy record, or array of shape ()
        Of `packed`, or a record in it.

    """
    if isinstance(fields, np.void):
        fields = np.frombuffer(fields, fields.dtype).reshape(())
    kind = kind_of(fields.dtype.names)
    return kind(*(views(fields[name]) if fields.dtype[name].names else fields[name]
                  for name in kind._fields))


def value(field: Any) -> Any:
    """Return the number, vector, matrix or record of a field of a NumPy record."""
    if isinstance(field, np.void):
        return load(field)
    return field.copy() if field.ndim else field.item()


def write(field: Any, x: Any) -> None:
    """Write a vector or matrix into a field of a NumPy record."""
    field[...] = x


def packed(value: Any) -> Any:
    """Return the numbers of a record, and of those in it, as a NumPy record for `load`."""
    kinds, values = described(value)
    made = np.zeros(1, _packed_layout(kinds))
    made[0] = values
    return made[0]


def fill(record: Any, values: tuple[Any, ...]) -> None:
    """Set what `packed` has made to other values, as `described` returns them."""
    record.base[0] = values


def described(value: Any) -> tuple[Any, tuple[Any, ...]]:
    """
    Return what the layout of a record as a NumPy record depends on, and its values.

    The first is the class, and of each field type and shape, or the same of a record.
    """
    kinds, values = [], []
    for x in value:
        kind: Any = (float, ())
        if type(x) in compilable.RECORDS:
            kind, x = described(x)
        elif type(x) is not float:
            x = np.asarray(x)
            kind = (int if x.dtype.kind == 'i' and not x.ndim else float, x.shape)
        kinds.append(kind)
        values.append(x)
    return (type(value), *kinds), (*values, 0)


@lru_cache(256)
def _packed_layout(described: tuple[Any, ...]) -> Any:
    """Return the layout of a NumPy record of the kinds that `described` returns."""
    kind, *kinds = described
    return _layout((*((name, *((_packed_layout(x), ()) if x[0] in compilable.RECORDS else x))
                      for name, x in zip(kind._fields, kinds)), (_IS + _name(kind), int, ())))


def record_of(values: Any) -> Any:
    """Return a NumPy record of the fields of `values`, a data class."""
    fields = {name: np.asarray(x) for name, x in vars(values).items()}
    return numpy_record({
        name: x.astype(np.int8) if x.dtype == bool else x for name, x in fields.items()})


def numpy_record(fields: Mapping[str, npt.NDArray[Any]]) -> Any:
    """Return a NumPy record with fields of these names, types, shapes and values."""
    made = np.zeros(1, _layout(tuple((name, x.dtype, x.shape) for name, x in fields.items())))
    made[0] = tuple(fields.values())
    return made[0]


@lru_cache(256)
def _layout(fields: tuple[tuple[str, Any, tuple[int, ...]], ...]) -> Any:
    return np.dtype((np.record, np.dtype(list(fields), align=True)))


@lru_cache(256)
def kind_of(names: tuple[str, ...]) -> Any:
    """Return the class of a record by the names of its fields."""
    name, = (name.removeprefix(_IS) for name in names if name.startswith(_IS))
    return next(kind for kind in compilable.RECORDS if _name(kind) == name)


def _name(kind: type) -> str:
    return f'{kind.__module__}.{kind.__qualname__}'
