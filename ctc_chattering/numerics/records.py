"""
Records in the memory of NumPy records, in which compiled code finds and leaves them.

What is here is plain Python; `simd` does the same in compiled code.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any, get_type_hints

from ctc_chattering.numerics import compilable
import numpy as np
import numpy.typing as npt


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


def write(field: Any, x: Any) -> None:
    """Write a vector or matrix into a field of a NumPy record."""
    field[...] = x


def packed(value: Any) -> Any:
    """Return the numbers of a record, and of those in it, as a NumPy record for `load`."""
    return numpy_record({name: np.asarray(x, float) for name, x in _flat(value, '')})


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
