"""
Compilation by numba, and where compiled code is kept.

The cache is a directory of the user that is named after the source text of this folder and of the
modules it compiles: numba by itself does not notice that a function which another one calls has
changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import fcntl
from functools import lru_cache
import hashlib
import os
from pathlib import Path
import sys
import tempfile
from typing import Any, TypeVar

import numba

F = TypeVar('F', bound=Callable[..., Any])

_HERE = Path(__file__).parent
#: Folders and modules outside of this folder whose functions are compiled.
_ALSO = ('simulation', 'dynamics', 'numerics', 'control')
#: Options of every function: no lock of the interpreter, and 1 / 0 is inf.
_OPTIONS: dict[str, Any] = {'cache': True, 'nogil': True, 'error_model': 'numpy'}


def source_key() -> str:
    """Return a word that changes with place and source text of what is compiled."""
    text = hashlib.sha256(str(_HERE).encode())
    for name in (_HERE.name, *_ALSO):
        found = _HERE.parent / name
        for path in sorted(found.rglob('*.py')) if found.is_dir() else (found,):
            text.update(path.read_bytes())
    return text.hexdigest()[:16]


@lru_cache(1)
def cache_directory() -> Path:
    """Return where compiled code is kept: with the user, or where that is not allowed, in /tmp."""
    for parent in (Path.home() / '.cache', Path(tempfile.gettempdir()) / f'cache-{os.getuid()}'):
        directory = parent / 'ctc_chattering' / 'numba' / source_key()
        with suppress(OSError):
            directory.mkdir(parents=True, exist_ok=True)
            if os.access(directory, os.W_OK):
                break
    return directory


def is_compiled(n: int) -> bool:
    """Return whether there is compiled code for `n` joints, of this version of the source text."""
    return _mark(n).exists()


@contextmanager
def compiling(n: int) -> Iterator[None]:
    """Have one process at a time compile what is called here for the first time."""
    if is_compiled(n):
        yield
        return
    mark = _mark(n)
    with mark.with_suffix('.lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
        mark.touch()


def _mark(n: int) -> Path:
    """Return the file that is there once all is compiled for `n` joints."""
    version = f'{sys.implementation.cache_tag}-numba-{numba.__version__}'
    return cache_directory() / f'{version}-{n}-joints'


def compiled(function: F) -> F:
    """Return `function`, compiled when it is first called."""
    made: F = numba.njit(**_OPTIONS)(function)
    return made


def inlined(function: F) -> F:
    """Return the same, copied into each function that calls it."""
    made: F = numba.njit(**_OPTIONS, forceinline=True)(function)
    return made


setattr(numba.config, 'CACHE_DIR', str(cache_directory()))  # noqa: B010 - has no stub
