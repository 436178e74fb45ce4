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

"""Machine code for what a parameter file describes: whether it is there, and making it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import as_completed, ThreadPoolExecutor
import dataclasses
from importlib.util import find_spec
import os
import pickle
import subprocess
import sys
from typing import Any

from ctc_chattering.analysis.tables import counted
from ctc_chattering.compiled.machine_code import Code
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller import Controller, LAWS
from ctc_chattering.control.controller_config import SWITCHINGS
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.closed_loop import compiled_loop_of
from ctc_chattering.simulation.plant import make_plant

#: How a run is computed.
COMPILED, PLAIN = 'compiled', 'plain'
#: Functions that are compiled at once, at most: each takes some 300 MB.
_MOST = 4


def has_compiler() -> bool:
    """Return whether numba is installed."""
    return find_spec('numba') is not None and find_spec('llvmlite') is not None


def codes(setup: Setup, parts: bool = False) -> tuple[Code, ...]:
    """
    Return the functions that a setup needs as machine code; none where it cannot have them.

    Parameters
    ----------
    setup : Setup
        Without a run if law or plant cannot be machine code, such as elastic joints.
    parts : bool
        Then return those of the other one, which a node has use for.

    """
    robot = make_plant(setup.plant, setup.descriptions.get('plant', ''))
    law = Controller(setup.controller, model_of(
        setup.controller, setup.descriptions.get('controller', '')))
    loop = compiled_loop_of(robot, law)
    if loop is not None or not parts:
        return () if loop is None else loop.codes
    steps = law.compiled_step(), robot.compiled_step
    return tuple(code for step in steps if step is not None for code in step.codes)


def way(setup: Setup) -> str:
    """Return how a run of a setup is computed now, `COMPILED` or `PLAIN`."""
    found = () if setup.events else codes(setup)
    return COMPILED if found and all(code.compiled for code in found) else PLAIN


def can_be_compiled(setup: Setup) -> bool:
    """Return whether a run of a setup can be machine code."""
    return not setup.events and bool(codes(setup))


def missing(setups: Iterable[Setup], parts: bool = False) -> list[Code]:
    """Return the `codes` of setups that are not compiled yet, each once."""
    found = {(code.function, code.layouts): code for setup in setups
             for code in codes(setup, parts)}
    return [code for code in found.values() if not code.compiled]


def compile_setups(setups: Iterable[Setup], show: Callable[[str], None], parts: bool = False
                   ) -> int:
    """
    Compile what setups need and is not compiled yet, several at once; return how many functions.

    Without numba, which compiles, the runs are plain Python.

    Parameters
    ----------
    setups : iterable of Setup
        What will run.
    show : callable
        Takes a line that says so, before and after each of them.
    parts : bool
        As of `codes`.

    """
    todo: dict[Any, tuple[Setup, Code]] = {}
    for setup in setups:
        todo |= {(code.function, code.layouts): (setup, code) for code in missing([setup], parts)}
    if not todo:
        return 0
    try:
        from ctc_chattering.compiled import build  # noqa: F401
    except ImportError as error:  # Not there, or numba refuses this version of NumPy.
        show(f'running in plain Python, 20 times slower: {error}')
        return 0
    show(f'compiling {counted(len(todo), "function")}, once for this version ...')
    for i, name in enumerate(_build(list(todo.values())), 1):
        show(f'compiled {name} ({i} of {len(todo)})')
    return len(todo)


def compile_setup(setup: Setup, every: bool = False, show: Callable[[str], None] = print) -> int:
    """
    Compile robot and law of a setup, once for this version; runs are then 20 times as fast.

    That holds for `simulate`, all searches, maps and nodes, and for all setups with the same law
    and number of joints. `compare`, `tune` and `compute_map` compile what they need.

    Parameters
    ----------
    setup : Setup
        As `load_parameters` returns it. Its events do not matter.
    every : bool
        Every law and switching, not only those of the setup.
    show : callable
        Takes lines that say what is compiled.

    Returns
    -------
    int
        Number of functions compiled; 0 if all were.

    Raises
    ------
    CtcError
        If neither robot nor law can be compiled.
    ModuleNotFoundError
        Without numba, which compiles.

    """
    setup = dataclasses.replace(setup, events=())
    if not codes(setup, parts=True):
        raise CtcError('nothing can be compiled: compiled is false, or neither plant (no elastic '
                       'joints, own models) nor law (no own models) can be, own frictions and '
                       'laws only if made of marked records')
    if not has_compiler():
        raise ModuleNotFoundError('No module named numba', name='numba')
    changes = [{'law': law} for law in LAWS if law != 'chattering'] + [
        {'law': 'chattering', 'switching': switching} for switching in SWITCHINGS]
    setups = [dataclasses.replace(setup, controller=setup.controller.changed(values))
              for values in (changes if every else [{}])]
    return compile_setups(setups, show, parts=True)


def _build(todo: Sequence[tuple[Setup, Code]]) -> Iterator[str]:
    """Compile functions; yield the name of each that is there."""
    from ctc_chattering.compiled.build import build
    jobs = min(len(todo), len(os.sched_getaffinity(0)), _MOST)
    if jobs == 1:
        for _, code in todo:
            build(code)
            yield code.name
        return
    with ThreadPoolExecutor(jobs) as pool:
        try:
            waiting = {pool.submit(_built_apart, setup, code.name): code for setup, code in todo}
            for done in as_completed(waiting):
                printed, code = done.result(), waiting[done]
                if not code.compiled:  # A class of the main script is known here only.
                    try:
                        build(code)
                    except Exception:
                        print(printed, file=sys.stderr)
                        raise
                yield code.name
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _built_apart(setup: Setup, name: str) -> str:
    """
    Have a process of its own compile a function, and return what it printed.

    Unlike `multiprocessing` it runs no script.
    """
    return subprocess.run(
        [sys.executable, '-c', f'from {__name__} import build_given; build_given()'],
        input=pickle.dumps((setup, name)), stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        check=False, env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))},
    ).stdout.decode(errors='replace')


def build_given() -> None:
    """Compile the function that `_built_apart` writes to the standard input."""
    from ctc_chattering.compiled.build import build
    setup, name = pickle.load(sys.stdin.buffer)
    for code in codes(setup, parts=True):
        if code.name == name:
            build(code)
