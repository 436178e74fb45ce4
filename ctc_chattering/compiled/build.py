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
Compilation of a `Code` to an object file, by numba.

`Program`s name the functions that they need as `Code`s. `configuration/compilation.py`, which
serves commands and users, has them built here. `object_file.py` takes `compiled` for C. All other
modules run machine code without numba, and do not import this one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
import fcntl
from itertools import count
from multiprocessing import current_process, get_context
from multiprocessing.process import BaseProcess
import os
from typing import Any

from ctc_chattering.compiled.machine_code import Code, invoke, Layout
from ctc_chattering.compiled.numba_interface import (
    CompiledFunction,
    defined,
    instructions,
    InstructionWriter,
    INT,
    INTERNAL,
    lowered,
    overloaded,
)
from ctc_chattering.compiled.record_types import register
from ctc_chattering.output_files import writing
from llvmlite import ir
import numba
from numba import types
from numba.extending import register_jitable

#: Maximum parallel compilations. Each uses about 300 MB.
_MAX_PROCESSES = 4


def build(code: Code) -> None:
    """
    Compile a function and cache its code.

    Another process may have done so in the meantime. Then nothing happens.

    Raises
    ------
    CtcError
        If the code cannot be written.

    """
    file = code.path.with_suffix('.lock')
    with writing(file):
        lock = file.open('w')
    with lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not code.compiled:
            function = compiled(code)
            code.keep(function.symbol, function.object_code())


def build_all(codes: Sequence[Code]) -> Iterator[str]:
    """Compile functions in processes, and yield the name of each."""
    if current_process().daemon:  # Daemonic processes cannot have children.
        for code in codes:
            build(code)
            yield code.name
        return
    running: list[tuple[Code, Any]] = []
    for code in codes:
        if len(running) == min(len(os.sched_getaffinity(0)), _MAX_PROCESSES):
            yield _finish(*running.pop(0))
        # Forked: the user's script does not run again, and its classes are known there.
        process = get_context('fork').Process(target=_build_silently, args=(code,), daemon=True)
        process.start()
        running.append((code, process))
    while running:
        yield _finish(*running.pop(0))


def _build_silently(code: Code) -> None:
    # `_finish` builds again after an error, and so raises it.
    with suppress(Exception):
        build(code)


def _finish(code: Code, process: BaseProcess) -> str:
    """Return the name of a function after its compilation."""
    process.join()
    build(code)  # Nothing remains to be done, or it raises the error of that process here.
    return code.name


def compiled(code: Code) -> CompiledFunction:
    """Compile a `Code` to a function taking a single address."""
    register()
    return CompiledFunction(_entry(code))


def _entry(code: Code) -> Callable[[int], int]:
    """
    Return the function that machine code begins with.

    It takes the address of `Code.addresses`, and makes the arguments from these. For one matrix
    with 3 columns it is::

        def defined(address):
            addresses = array_at(address, (2,), addresses_type)
            return function(array_at(addresses[0], (addresses[1], 3,), type_3))
    """
    names: dict[str, Any] = {'array_at': _array_at, 'addresses_type': types.int64[::1],
                             'function': register_jitable(**INTERNAL)(code.function)}
    index = count()

    def construction(argument: Layout) -> str:
        """Return the expression that makes an argument."""
        name = f'type_{len(names)}'
        if argument.fields:
            names[name] = argument.container
            return f'{name}({", ".join(map(construction, argument.fields))})'
        names[name] = types.Array(numba.from_dtype(argument.dtype), len(argument.shape) + 1, 'C')
        address = f'addresses[{next(index)}]'
        if argument.container == 'record':
            return f'array_at({address}, (1,), {name})[0]'
        shape = (f'addresses[{next(index)}]', *map(str, argument.shape))
        return f'array_at({address}, ({", ".join(shape)},), {name})'

    arguments = ', '.join(map(construction, code.layouts))
    return defined(  # type: ignore[no-any-return]
        'def defined(address):\n'
        f'    addresses = array_at(address, ({next(index)},), addresses_type)\n'
        f'    return function({arguments})', **names)


@lowered
def _array_at(_typing: Any, address: Any, shape: Any, array_type: Any) -> Any:
    """Return the array of a type at an address."""
    array = array_type.instance_type
    return instructions(array, (address, shape, array_type), lambda writer, address, shape, _: (
        writer.array_at(array, address, shape)))


@lowered
def _call_address(_typing: Any, function: Any, addresses: Any) -> Any:
    """Return the result of the function at an address."""
    def emit(writer: InstructionWriter, function: Any, addresses: Any) -> Any:
        builder = writer.builder
        result = writer.stack(INT)
        error = writer.stack(ir.IntType(8).as_pointer())
        prototype = ir.FunctionType(ir.IntType(32), [result.type, error.type, INT])
        builder.call(
            builder.inttoptr(function, prototype.as_pointer()), [result, error, addresses])
        return builder.load(result)
    return instructions(types.int64, (function, addresses), emit)


@overloaded(invoke)
def _invoke(function: Any, addresses: Any) -> Any:
    # The numba overload of `invoke`.
    del function, addresses
    return lambda function, addresses: _call_address(function, addresses)
