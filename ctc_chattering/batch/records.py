"""
Records: the arrays and numbers of a named tuple in one piece of memory, as compiled code takes it.

To compiled code a record is one pointer, without reference counts, and its shapes are constants.
"""

from __future__ import annotations

from typing import cast, NamedTuple, TypeVar

import numpy as np

T = TypeVar('T', bound=NamedTuple)


def record(values: T) -> T:
    """Return a record of the fields of `values`, which has the same attributes."""
    fields = [x.astype(np.int8) if x.dtype == bool else x for x in map(np.asarray, values)]
    made = np.zeros(1, np.dtype([(name, x.dtype, x.shape) for name, x in zip(
        values._fields, fields)], align=True)).view(np.recarray)
    for name, x in zip(values._fields, fields):
        made[name] = x
    return cast('T', made[0])
