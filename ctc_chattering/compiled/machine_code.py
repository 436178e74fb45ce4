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
Machine code: its files, how it is loaded, and called.

`build` compiles a function once, with numba. From then on it is loaded in milliseconds, without
numba. It is called with the addresses of its arguments, records and arrays, and writes its results
into them. A call takes less than a microsecond. Plant, controller, dynamics and closed loop are
such `Program`s.
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
#: Convention of numba: addresses of the result, of an error, and one argument.
_PROTOTYPE: Any = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * 3)
#: Mode bits with which others may change files in a directory.
_OTHERS_WRITE = 0o022
#: Those with which others may replace a directory in its parent. A group may.
_OTHERS_REPLACE = 0o002
#: Hint for a user whose run is plain Python.
HOW_TO_COMPILE = ('running in plain Python; `ctc compile` with the same file makes it some 20 '
                  'times as fast: about 30 s, once')
#: Words for how steps are computed.
PLAIN_PYTHON = 'plain Python'
MACHINE_CODE = 'machine code'


class Layout(NamedTuple):
    """Type of an argument of machine code."""

    #: 'record', 'array', or the class of a NamedTuple.
    container: Any
    #: Type of the elements.
    dtype: Any = None
    #: Shape of an array, without the first axis.
    shape: tuple[int, ...] = ()
    #: Layouts of the fields of a NamedTuple.
    fields: tuple[Any, ...] = ()


def layout(argument: Any) -> Layout:
    """Return the layout of an argument of `Code`."""
    if isinstance(argument, np.void):
        return Layout('record', argument.dtype)
    if isinstance(argument, np.ndarray):
        assert argument.flags.c_contiguous
        return Layout('array', argument.dtype, argument.shape[1:])
    return Layout(type(argument), fields=tuple(map(layout, argument)))


def argument_addresses(arguments: tuple[Any, ...]) -> npt.NDArray[np.int64]:
    """Return addresses of records, and addresses and lengths of arrays."""
    addresses: list[int] = []
    array: Any = None
    for memory in argument_memory(arguments):
        addresses.append(len(array) if memory is None else memory.ctypes.data)
        array = memory
    return np.array(addresses, np.int64)


def argument_memory(argument: Any) -> Iterator[npt.NDArray[Any] | None]:
    """Yield memory of records and arrays, None for a length."""
    if isinstance(argument, tuple):
        for item in argument:
            yield from argument_memory(item)
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
        Of NumPy records and arrays. It calls marked functions and returns an int.
    arguments : tuple
        NumPy records, contiguous arrays, or NamedTuples of such. They are kept. For arguments that
        differ in nothing but the length of arrays, the machine code is the same.
    name : str
        First word of the names of its files.

    Attributes
    ----------
    function, arguments, name
        The same.
    layouts : tuple of Layout
        Of the arguments.

    """

    def __init__(self, function: Callable[..., int], arguments: tuple[Any, ...], name: str
                 ) -> None:
        self.function = function
        self.name = name
        self.arguments = arguments
        self.layouts = tuple(map(layout, arguments))

    @cached_property
    def addresses(self) -> npt.NDArray[np.int64]:
        """Addresses of the arguments."""
        return argument_addresses(self.arguments)

    @cached_property
    def path(self) -> Path:
        """File of the machine code."""
        return cache_directory() / f'{self.name}-{_key(self.function, self.layouts)}.o'

    @property
    def compiled(self) -> bool:
        """Return true if there is machine code that can be loaded."""
        with suppress(ImportError, OSError, CtcError):
            return self.address() != 0
        return False

    def keep(self, symbol: str, machine_code: bytes) -> None:
        """Write an object file, or raise `CtcError` if that fails."""
        content = f'{symbol}\n'.encode() + machine_code
        write_bytes(self.path, f'{hashlib.sha256(content).hexdigest()}\n'.encode() + content)

    def address(self) -> int:
        """Return the address of the machine code, which is loaded."""
        return _load(self.path)[0]

    def call(self) -> Callable[[], int]:
        """Return a function that calls the machine code with the arguments."""
        return _prepared(self.address(), self.addresses.ctypes.data)


class Program:
    """
    A function, with the functions that it calls by address.

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
        Calls the function. It exists only if that is compiled.

    """

    call: Callable[[], int]

    def __init__(self, needed: Sequence[Code], function: Callable[..., int],
                 arguments: tuple[Any, ...], name: str) -> None:
        self.code = Code(function, arguments, name)
        self.codes = *needed, self.code
        self.compiled = all(code.compiled for code in self.codes)
        if self.compiled:
            self.call = self.code.call()


@compilable.record
class Callee(NamedTuple):
    """Machine code that other machine code calls with `invoke`."""

    #: Addresses of the function, and of the addresses of its arguments.
    function: int  # noqa: A003
    arguments: int


def invoke(function: int, addresses: int) -> int:
    """Call the machine code at an address, with its arguments' addresses."""
    return _prepared(function, addresses)()


def _prepared(function: int, addresses: int) -> Callable[[], int]:
    """Return such a call, whose preparation takes longer than the call."""
    result = ctypes.c_int64()
    error = ctypes.c_void_p()
    call = _PROTOTYPE(function)
    pointers = ctypes.addressof(result), ctypes.addressof(error), addresses

    def invocation() -> int:
        if call(*pointers):
            raise CtcError(f'compiled code failed: {error}')
        return result.value
    return invocation


@lru_cache(1)
def source_key() -> str:
    """Return a hash of place and text of the compiled folders."""
    text = hashlib.sha256(f'{_PACKAGE} {sys.implementation.cache_tag}'.encode())
    for name in _FOLDERS:
        for path in sorted((_PACKAGE / name).rglob('*.py')):
            text.update(path.read_bytes())
    return text.hexdigest()[:16]


@lru_cache(1)
def cache_directory() -> Path:
    """Return the user's directory of machine code, else one in /tmp."""
    for parent in ('~/.cache', f'{tempfile.gettempdir()}/cache-{os.getuid()}'):
        with suppress(OSError, RuntimeError):  # A user may have no home.
            directory = Path(parent).expanduser() / 'ctc_chattering' / 'machine_code'
            directory.mkdir(mode=0o700, parents=True, exist_ok=True)
            if os.access(directory, os.W_OK) and _belongs_to_user(
                    directory, _OTHERS_WRITE) and all(
                    _belongs_to_user(parent, _OTHERS_REPLACE)
                    for parent in directory.parents[:2]):
                return directory
    raise CtcError('no directory for compiled code: neither ~/.cache nor a directory of the user '
                   f'in {tempfile.gettempdir()} can be written')


def _belongs_to_user(directory: Path, mode: int) -> bool:
    """Return true for the user's directory without these bits."""
    status = directory.stat()
    return status.st_uid == os.getuid() and not status.st_mode & mode


@lru_cache(1024)
def _key(function: Callable[..., int], layouts: tuple[Layout, ...]) -> str:
    """Return a hash of all that machine code depends on."""
    text = f'{source_key()} {_processor()} {_origin(function, str(layouts))} {layouts}'
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _origin(function: Callable[..., int], layouts: str) -> str:
    """Return the name of a function, its closure and the user's modules."""
    enclosed = [repr(cell.cell_contents) for cell in function.__closure__ or ()]
    modules = {marked.__module__ for marked in (*compilable.FUNCTIONS, *compilable.RECORDS)}
    users = sorted(name for name in modules if not name.startswith('ctc_chattering.'))
    texts = [*map(_text, users)] if any(f'is {name}.' in layouts for name in users) else []
    return f'{function.__module__}.{function.__qualname__} {enclosed} {texts}'


def _text(module: str) -> str:
    """Return the text of a module of the user."""
    path = getattr(sys.modules.get(module), '__file__', None)
    if path is None:  # Typed in. Two texts could not be told from each other.
        raise ImportError(f'{module} is not a file: it cannot be compiled')
    return Path(path).read_text(encoding='utf-8')


@lru_cache(1)
def _processor() -> str:
    """Return name and features of the processor."""
    from llvmlite import binding
    return f'{binding.get_host_cpu_name()} {binding.get_host_cpu_features().flatten()}'


@lru_cache(None)
def _load(path: Path) -> tuple[int, Any]:
    """Return the address in a file of `Code.keep`, and its owner."""
    from llvmlite import binding
    digest, _, content = path.read_bytes().partition(b'\n')
    if hashlib.sha256(content).hexdigest().encode() != digest:  # It must never be run.
        raise CtcError(f'{path} is damaged: remove it')
    symbol, _, machine_code = content.partition(b'\n')
    for start in (binding.initialize, binding.initialize_native_target,
                  binding.initialize_native_asmprinter):
        with suppress(RuntimeError):  # Newer versions do it by themselves.
            start()
    machine = binding.Target.from_default_triple().create_target_machine(jit=True)
    engine = binding.create_mcjit_compiler(binding.parse_assembly(''), machine)
    engine.add_object_file(binding.ObjectFileRef.from_data(machine_code))
    engine.finalize_object()
    return int(engine.get_function_address(symbol.decode())), engine
