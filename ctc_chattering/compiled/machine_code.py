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
Machine code of functions of records and arrays: where it is kept, and how it is called.

`build` makes it, with numba, once; it is then loaded in milliseconds, without numba. A
function is called with the addresses of its arguments, which costs less than a microsecond. What
it computes it writes into them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
import ctypes
from functools import cached_property, lru_cache
import hashlib
import os
from pathlib import Path
import sys
import tempfile
from typing import Any, NamedTuple

from ctc_chattering.compiled import compilable
from ctc_chattering.errors import CtcError
from ctc_chattering.output_files import write_bytes
import numpy as np
import numpy.typing as npt

_PACKAGE = Path(__file__).parents[1]
#: Folders with functions that are compiled.
_FOLDERS = ('compiled', 'numerics', 'dynamics', 'control', 'simulation')
#: How numba calls: where the result goes, where an error goes, and one argument.
_PROTOTYPE: Any = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * 3)
#: What a user reads who runs plain Python in its place.
HOW_TO_COMPILE = ('running in plain Python; `ctc compile` with the same file makes it some 20 '
                  'times as fast: about 30 s, once')
#: How steps are computed, without and with machine code.
PLAIN_PYTHON, MACHINE_CODE = 'plain Python', 'machine code'


class Layout(NamedTuple):
    """What is known of an argument when a function is compiled."""

    #: 'record', 'array', or the class of a NamedTuple of several.
    kind: Any
    #: Type of the elements, and the shape behind the first axis of an array.
    dtype: Any = None
    shape: tuple[int, ...] = ()
    #: Those of a NamedTuple.
    parts: tuple[Any, ...] = ()


def layout(argument: Any) -> Layout:
    """Return the layout of a NumPy record, a contiguous array, or a NamedTuple of such."""
    if isinstance(argument, np.void):
        return Layout('record', argument.dtype)
    if isinstance(argument, np.ndarray):
        assert argument.flags.c_contiguous
        return Layout('array', argument.dtype, argument.shape[1:])
    return Layout(type(argument), parts=tuple(map(layout, argument)))


def places(arguments: tuple[Any, ...]) -> npt.NDArray[np.int64]:
    """Return the addresses of arguments, that of an array with its length, those in tuples too."""
    found: list[int] = []
    last: Any = None
    for memory in memory_of(arguments):
        found.append(len(last) if memory is None else memory.ctypes.data)
        last = memory
    return np.array(found, np.int64)


def memory_of(argument: Any) -> Iterator[npt.NDArray[Any] | None]:
    """Yield the memory that each of `places` is the address of; None for a length."""
    if isinstance(argument, tuple):
        for part in argument:
            yield from memory_of(part)
    elif isinstance(argument, np.ndarray):
        yield from (argument, None)
    else:  # The interface of a record describes all its fields, at each call anew.
        yield np.frombuffer(argument, np.uint8)


class Code:
    """
    A function with its arguments, compiled if it has been.

    Parameters
    ----------
    function : callable
        Of NumPy records and arrays; a function of marked ones. It returns an int.
    arguments : tuple
        NumPy records, contiguous arrays, or NamedTuples of such. They are kept. For arguments that
        differ in nothing but the length of arrays, the machine code is the same.
    name : str
        What it is, in names of files.

    Attributes
    ----------
    function, arguments, name
        As given.
    layouts : tuple of Layout
        Of the arguments.

    """

    def __init__(self, function: Callable[..., int], arguments: tuple[Any, ...], name: str
                 ) -> None:
        self.function, self.name, self.arguments = function, name, arguments
        self.layouts = tuple(map(layout, arguments))

    @cached_property
    def places(self) -> npt.NDArray[np.int64]:
        """Return the addresses of the arguments."""
        return places(self.arguments)

    @cached_property
    def path(self) -> Path:
        """Return the file of the machine code."""
        return cache_directory() / f'{self.name}-{_key(self.function, self.layouts)}.o'

    @property
    def compiled(self) -> bool:
        """Whether there is machine code, undamaged, and what is needed to load it."""
        with suppress(ImportError, OSError, CtcError):
            return self.address() != 0
        return False

    def keep(self, symbol: str, machine_code: bytes) -> None:
        """Keep an object file with the function of this name; raise `CtcError` if that fails."""
        content = f'{symbol}\n'.encode() + machine_code
        write_bytes(self.path, f'{hashlib.sha256(content).hexdigest()}\n'.encode() + content)

    def address(self) -> int:
        """Return where the machine code is."""
        return _load(self.path)[0]

    def call(self) -> Callable[[], int]:
        """Return what calls the machine code with the arguments."""
        return _prepared(self.address(), self.places.ctypes.data)


class Program:
    """
    A function with its arguments, and the functions that it calls by their addresses.

    Parameters
    ----------
    needed : sequence of Code
        Those that it calls.
    function, arguments, name
        As of `Code`.

    Attributes
    ----------
    code : Code
        Of the function.
    codes : tuple of Code
        What must be compiled.
    compiled : bool
        Whether it has been, before this was made.
    call : callable
        Calls the function; only if it is compiled.

    """

    call: Callable[[], int]

    def __init__(self, needed: Sequence[Code], function: Callable[..., int],
                 arguments: tuple[Any, ...], name: str) -> None:
        self.code = Code(function, arguments, name)
        self.codes = *needed, self.code
        self.compiled = all(code.compiled for code in self.codes)
        if self.compiled:
            self.call = self.code.call()


def invoke(function: int, places: int) -> int:
    """Call the machine code at an address, with the address of the places of its arguments."""
    return _prepared(function, places)()


def _prepared(function: int, places: int) -> Callable[[], int]:
    """Return such a call; to prepare it takes some times as long as to make it."""
    result, error = ctypes.c_int64(), ctypes.c_void_p()
    call = _PROTOTYPE(function)
    addresses = ctypes.addressof(result), ctypes.addressof(error), places

    def made() -> int:
        if call(*addresses):
            raise CtcError(f'compiled code failed: {error}')
        return result.value
    return made


@lru_cache(1)
def source_key() -> str:
    """Return a word that changes with place and text of what is compiled."""
    text = hashlib.sha256(f'{_PACKAGE} {sys.implementation.cache_tag}'.encode())
    for name in _FOLDERS:
        for path in sorted((_PACKAGE / name).rglob('*.py')):
            text.update(path.read_bytes())
    return text.hexdigest()[:16]


@lru_cache(1)
def cache_directory() -> Path:
    """Return where machine code is kept: with the user, or where that is not allowed, in /tmp."""
    for parent in ('~/.cache', f'{tempfile.gettempdir()}/cache-{os.getuid()}'):
        with suppress(OSError, RuntimeError):  # A user may have no home.
            directory = Path(parent).expanduser() / 'ctc_chattering' / 'machine_code'
            directory.mkdir(mode=0o700, parents=True, exist_ok=True)
            if os.access(directory, os.W_OK) and _of_the_user(directory, 0o022) and all(
                    _of_the_user(parent, 0o002) for parent in directory.parents[:2]):
                return directory
    raise CtcError('no directory for compiled code: neither ~/.cache nor a directory of the user '
                   f'in {tempfile.gettempdir()} can be written')


def _of_the_user(directory: Path, writers: int) -> bool:
    """Return whether it is the user's, and none of these `writers` (mode bits) can write there."""
    status = directory.stat()
    return status.st_uid == os.getuid() and not status.st_mode & writers


@lru_cache(1024)
def _key(function: Callable[..., int], layouts: tuple[Layout, ...]) -> str:
    """Return a word for all that machine code depends on."""
    text = f'{source_key()} {_processor()} {_origin(function, str(layouts))} {layouts}'
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _origin(function: Callable[..., int], layouts: str) -> str:
    """Return what tells a function from others: its name, what it encloses, code of users."""
    enclosed = [repr(cell.cell_contents) for cell in function.__closure__ or ()]
    modules = {marked.__module__ for marked in (*compilable.FUNCTIONS, *compilable.RECORDS)}
    own = sorted(name for name in modules if not name.startswith('ctc_chattering.'))
    texts = [*map(_text, own)] if any(f'is {name}.' in layouts for name in own) else []
    return f'{function.__module__}.{function.__qualname__} {enclosed} {texts}'


def _text(module: str) -> str:
    """Return the text of a module of the user."""
    path = getattr(sys.modules.get(module), '__file__', None)
    if path is None:  # Typed in; two texts could not be told from each other.
        raise ImportError(f'{module} is not a file: it cannot be compiled')
    return Path(path).read_text(encoding='utf-8')


@lru_cache(1)
def _processor() -> str:
    """Return what the machine code is for."""
    from llvmlite import binding
    return f'{binding.get_host_cpu_name()} {binding.get_host_cpu_features().flatten()}'


@lru_cache(None)
def _load(path: Path) -> tuple[int, Any]:
    """Return the address of the function in a file of `Code.keep`, and what keeps it there."""
    from llvmlite import binding
    word, _, content = path.read_bytes().partition(b'\n')
    if hashlib.sha256(content).hexdigest().encode() != word:  # It must never be run.
        raise CtcError(f'{path} is damaged: remove it')
    symbol, _, machine_code = content.partition(b'\n')
    for start in (binding.initialize, binding.initialize_native_target,
                  binding.initialize_native_asmprinter):
        try:
            start()
        except RuntimeError:  # Newer versions do it by themselves.
            continue
    machine = binding.Target.from_default_triple().create_target_machine(jit=True)
    engine = binding.create_mcjit_compiler(binding.parse_assembly(''), machine)
    engine.add_object_file(binding.ObjectFileRef.from_data(machine_code))
    engine.finalize_object()
    return int(engine.get_function_address(symbol.decode())), engine
