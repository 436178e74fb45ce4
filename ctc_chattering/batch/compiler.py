"""
Compilation by numba, and where compiled code is kept.

The cache is a directory of the user that is named after the source text of this folder and of the
modules it compiles: numba by itself does not notice that a function which another one calls has
changed.
"""

from __future__ import annotations

from collections.abc import Callable
import hashlib
from pathlib import Path
from typing import Any, TypeVar

import numba

F = TypeVar('F', bound=Callable[..., Any])

_HERE = Path(__file__).parent
#: Modules outside of this folder whose functions are compiled.
_ALSO = ('simulation/drive.py',)
#: Options of every function: no lock of the interpreter, and 1 / 0 is inf.
_OPTIONS: dict[str, Any] = {'cache': True, 'nogil': True, 'error_model': 'numpy'}


def source_key() -> str:
    """Return a word that changes with the source text of what is compiled."""
    text = hashlib.sha256()
    for path in (*sorted(_HERE.glob('*.py')), *(_HERE.parent / name for name in _ALSO)):
        text.update(path.read_bytes())
    return text.hexdigest()[:16]


def cache_directory() -> Path:
    """Return where compiled code is kept."""
    return Path.home() / '.cache' / 'ctc_chattering' / 'numba' / source_key()


def is_cached() -> bool:
    """Return whether there is compiled code of this version of the source text."""
    return any(cache_directory().rglob('*.nbc'))


def compiled(function: F) -> F:
    """Return `function`, compiled when it is first called."""
    made: F = numba.njit(**_OPTIONS)(function)
    return made


def inlined(function: F) -> F:
    """Return the same, copied into each function that calls it: for what is short or called once."""
    made: F = numba.njit(**_OPTIONS, forceinline=True)(function)
    return made


numba.config.CACHE_DIR = str(cache_directory())
