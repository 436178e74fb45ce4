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
from contextlib import suppress
import dataclasses
from importlib.util import find_spec
from multiprocessing import current_process, get_context
from multiprocessing.process import BaseProcess
import os

from ctc_chattering.analysis.tables import counted
from ctc_chattering.compiled.machine_code import Code
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller import Controller
from ctc_chattering.control.laws.registry import LAWS, switchings_of
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.closed_loop import compiled_loop_of
from ctc_chattering.simulation.plant import make_plant

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
        Without a run if it has events, or law or plant cannot be machine code, such as elastic
        joints.
    parts : bool
        Then return those of the other one, which a node has use for.

    """
    robot = make_plant(setup.plant, setup.descriptions.get('plant', ''))
    law = Controller(setup.controller, model_of(
        setup.controller, setup.descriptions.get('controller', '')))
    loop = None if setup.events else compiled_loop_of(robot, law)
    if loop is not None or not parts:
        return () if loop is None else loop.codes
    steps = law.compiled_step(), robot.compiled_step
    return tuple(code for step in steps if step is not None for code in step.codes)


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
    todo = missing(setups, parts)
    if not todo:
        return 0
    try:
        from ctc_chattering.compiled import build  # noqa: F401
    except ImportError as error:  # Not there, or numba refuses this version of NumPy.
        show(f'running in plain Python, 20 times slower: {error}')
        return 0
    show(f'compiling {counted(len(todo), "function")}, once for this version ...')
    for i, name in enumerate(_build(todo), 1):
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
    config = setup.controller
    laws = dict.fromkeys((*LAWS, config.law)) if every else (config.law,)
    setups = [dataclasses.replace(setup, controller=config.changed(
                  {'law': law, 'switching': switching}))
              for law in laws
              for switching in (every and switchings_of(law)) or (config.switching,)]
    return compile_setups(setups, show, parts=True)


def _build(todo: Sequence[Code]) -> Iterator[str]:
    """Compile functions, each in a process of its own; yield the name of each that is there."""
    from ctc_chattering.compiled.build import build

    running: list[tuple[Code, BaseProcess]] = []

    def silent(code: Code) -> None:
        with suppress(Exception):
            build(code)

    def ended() -> str:
        code, process = running.pop(0)
        process.join()
        build(code)  # Nothing is left to do, or it raises the error of that process here.
        return code.name

    for code in todo:
        if current_process().daemon:  # Such a process may start no other one.
            build(code)
            yield code.name
            continue
        if len(running) == min(len(os.sched_getaffinity(0)), _MOST):
            yield ended()
        # Forked: the user's script does not run again, and its classes are known there.
        process = get_context('fork').Process(target=silent, args=(code,), daemon=True)
        process.start()
        running.append((code, process))
    while running:
        yield ended()
