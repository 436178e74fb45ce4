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

What is here is plain Python; `build` does the same in compiled code.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from typing import Any

from ctc_chattering.compiled import compilable
import numpy as np
import numpy.typing as npt

#: In the names of fields that say of which class a record is.
_IS = 'is '


def rows(array: Any, like: Any) -> Any:
    """Return an array whose rows are one after the other as rows of the length of `like`."""
    return array.reshape(-1, len(like))


def load(fields: Any) -> Any:
    """Return the record of which `packed` made the fields."""
    kinds = kinds_of(fields.dtype.names)

    def made(prefix: str) -> Any:
        kind = kinds[prefix]
        return kind(*(made(f'{prefix}{name}__') if f'{prefix}{name}__' in kinds
                      else value(fields[prefix + name]) for name in kind._fields))
    return made('')


def store(fields: Any, value: Any) -> None:
    """Write a record back into the fields that it was loaded from."""
    for name, x in zip(_names(_form(value), ''), _leaves(value)):
        fields[name] = x


def value(field: Any) -> Any:
    """Return the number, vector or matrix of a field of a NumPy record."""
    return field.copy() if field.ndim else field.item()


def write(field: Any, x: Any) -> None:
    """Write a vector or matrix into a field of a NumPy record."""
    field[...] = x


def packed(value: Any) -> Any:
    """Return the numbers of a record, and of those in it, as a NumPy record for `load`."""
    values = [np.asarray(x, np.int64 if type(x) is int else float) for x in _leaves(value)]
    made = np.zeros(1, _packed_layout(_form(value), tuple((x.dtype, x.shape) for x in values)))
    marks = len(made.dtype.names) - len(values)
    made[0] = *values, *(0,) * marks
    return made[0]


@lru_cache(256)
def _packed_layout(form: tuple[Any, ...], kinds: tuple[tuple[Any, tuple[int, ...]], ...]) -> Any:
    """Return the layout of a record of `_form` with numbers of these types and shapes."""
    names = _names(form, '')
    marks = tuple((name, np.dtype(np.int8), ()) for name in _marks(form, ''))
    return _layout((*((name, *kind) for name, kind in zip(names, kinds)), *marks))


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


def _form(part: Any) -> tuple[Any, ...]:
    """Return the class of a record, and for each of its fields the form, or None for numbers."""
    return type(part), *(_form(x) if type(x) in compilable.RECORDS else None for x in part)


def _marks(form: tuple[Any, ...], prefix: str) -> Iterator[str]:
    """Yield names of fields that say of which class a record is, and those in it."""
    kind, *parts = form
    yield f'{prefix}{_IS}{_name(kind)}'
    for name, part in zip(kind._fields, parts):
        if part is not None:
            yield from _marks(part, f'{prefix}{name}__')


def kinds_of(names: Iterable[str]) -> dict[str, Any]:
    """Return the classes of a record, and of those in it, by the prefix of their fields."""
    known = {_name(kind): kind for kind in compilable.RECORDS}
    marks = (name.partition(_IS) for name in names if _IS in name)
    return {prefix: known[kind] for prefix, _, kind in marks}


def _name(kind: type) -> str:
    return f'{kind.__module__}.{kind.__qualname__}'


def _names(form: tuple[Any, ...], prefix: str) -> Iterator[str]:
    """Yield the names of the numbers of a record, and of those in it, in a NumPy record."""
    kind, *parts = form
    for name, part in zip(kind._fields, parts):
        if part is None:
            yield prefix + name
        else:
            yield from _names(part, f'{prefix}{name}__')


def _leaves(part: Any) -> Iterator[Any]:
    """Yield the numbers of a record, and of those in it, in the order of `_names`."""
    for x in part:
        if type(x) in compilable.RECORDS:
            yield from _leaves(x)
        else:
            yield x
