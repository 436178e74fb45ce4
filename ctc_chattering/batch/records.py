"""
Records: the arrays and numbers of a data class in one piece of memory, as compiled code takes it.

To compiled code a record is one pointer, without reference counts, and its shapes are constants.
"""

from __future__ import annotations

from typing import cast, TypeVar

from ctc_chattering.numerics.records import numpy_record
import numpy as np

T = TypeVar('T')


def record(values: T) -> T:
    """Return a record of the fields of `values`, a data class, which has the same attributes."""
    fields = {name: np.asarray(x) for name, x in vars(values).items()}
    return cast('T', numpy_record({
        name: x.astype(np.int8) if x.dtype == bool else x for name, x in fields.items()}))
