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
Machine code of a `Setup`.

`ctc compile`, `ctc simulate`, and all commands and functions that run many simulations, come here
before they run. Plant and controller declare the functions, and `compiled/build.py` compiles them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
import dataclasses
from importlib.util import find_spec

from ctc_chattering.compiled.machine_code import Code, Program
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller import Controller
from ctc_chattering.control.laws.registry import LAWS, switchings_of
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.closed_loop import compiled_loop_of
from ctc_chattering.simulation.plant import make_plant


def has_compiler() -> bool:
    """Return true if numba is installed."""
    return find_spec('numba') is not None and find_spec('llvmlite') is not None


def required_codes(setup: Setup, for_nodes: bool = False) -> tuple[Code, ...]:
    """
    Return the functions that a setup needs as machine code.

    There are none where it cannot have them.

    Parameters
    ----------
    setup : Setup
        Its loop is plain Python if it has events, or if law or plant cannot be machine code, such
        as elastic joints.
    for_nodes : bool
        Without a compiled loop, return the functions of plant and controller alone, which a node
        can use.

    """
    robot = make_plant(setup.plant, setup.descriptions.get('plant', ''))
    law = Controller(setup.controller, model_of(
        setup.controller, setup.descriptions.get('controller', '')))
    programs: list[Program | None] = [None if setup.events else compiled_loop_of(robot, law)]
    if for_nodes and programs == [None]:  # The loop as a whole is plain Python.
        programs = [law.compiled_step(), robot.compiled_step]
    return tuple(code for program in programs if program is not None for code in program.codes)


def uncompiled_codes(setups: Iterable[Setup], for_nodes: bool = False) -> list[Code]:
    """Return the uncompiled `required_codes` of setups, each once."""
    needed = {(code.function, code.layouts): code for setup in setups
              for code in required_codes(setup, for_nodes)}
    return [code for code in needed.values() if not code.compiled]


def compile_setups(setups: Iterable[Setup], show: Callable[[str], None], for_nodes: bool = False
                   ) -> int:
    """
    Compile the missing functions of setups, and count them.

    Several are compiled at once.

    Without numba, which compiles, the runs are plain Python.

    Parameters
    ----------
    setups : iterable of Setup
        Setups that will run.
    show : callable
        Takes a line before all of them, and one after each.
    for_nodes : bool
        See `required_codes`.

    """
    to_build = uncompiled_codes(setups, for_nodes)
    if not to_build:
        return 0
    try:
        from ctc_chattering.compiled import build
    except ImportError as error:  # Not there, or numba refuses this version of NumPy.
        show('numba cannot be used, so the law runs in plain Python, 20 times slower: '
             f'{error}. Install it: pip install numba')
        return 0
    count = len(to_build)
    show(f'compiling {count} function{"" if count == 1 else "s"}, once for this version ...')
    for i, name in enumerate(build.build_all(to_build), 1):
        show(f'compiled {name} ({i} of {count})')
    return count


def compile_setup(setup: Setup, every: bool = False, show: Callable[[str], None] = print) -> int:
    """
    Compile robot and law of a setup, once for this version.

    Runs are then 20 times as fast.

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
    if not required_codes(setup, for_nodes=True):
        raise CtcError('nothing can be compiled: either the parameter compiled is false, or plant '
                       'and law have parts without machine code, which are elastic joints, models '
                       'of your own, and frictions or laws of your own without marked records')
    if not has_compiler():
        raise ModuleNotFoundError('No module named numba', name='numba')
    config = setup.controller
    laws = dict.fromkeys((*LAWS, config.law)) if every else (config.law,)
    setups = [dataclasses.replace(setup, controller=config.changed(
                  {'law': law, 'switching': switching}))
              for law in laws
              for switching in (every and switchings_of(law)) or (config.switching,)]
    return compile_setups(setups, show, for_nodes=True)
