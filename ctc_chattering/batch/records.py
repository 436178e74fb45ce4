"""
Records: the arrays and numbers of a data class in one piece of memory, as compiled code takes it.

To compiled code a record is one pointer, without reference counts, and its shapes are constants.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, cast, TypeVar

import numpy as np

T = TypeVar('T')


def record(values: T) -> T:
    """Return a record of the fields of `values`, a data class, which has the same attributes."""
    names = tuple(vars(values))
    fields = [x.astype(np.int8) if x.dtype == bool else x
              for x in map(np.asarray, vars(values).values())]
    made = np.zeros(1, _layout(names, tuple((x.dtype, x.shape) for x in fields)))
    made[0] = tuple(fields)
    return cast('T', made[0])


@lru_cache(256)
def _layout(names: tuple[str, ...], kinds: tuple[tuple[Any, tuple[int, ...]], ...]) -> Any:
    """Return the type of a record with fields of these names, types and shapes."""
    return np.dtype((np.record, np.dtype(
        [(name, *kind) for name, kind in zip(names, kinds)], align=True)))
