"""Memory that is not needed goes back to the system."""

from __future__ import annotations

import ctypes
import sys

_M_TRIM_THRESHOLD = -1
_THRESHOLD = 1 << 17


def give_back() -> None:
    """
    Have the C library return freed memory from this size on, as it does at first.

    After the first large block is freed, it would keep up to twice as much for good: of a recorder
    that once had much to do at a time, some megabytes. Where the C library has no such setting,
    nothing happens.
    """
    if sys.platform.startswith('linux'):
        libc = ctypes.CDLL(None)
        if hasattr(libc, 'mallopt'):
            libc.mallopt(_M_TRIM_THRESHOLD, _THRESHOLD)
