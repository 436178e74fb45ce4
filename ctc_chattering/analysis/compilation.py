"""Machine code for what a parameter file describes: whether it is there, and making it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib.util import find_spec

from ctc_chattering.configuration.parameter_file import Setup
from ctc_chattering.control.controller import Controller
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.numerics.machine_code import Code
from ctc_chattering.simulation.closed_loop import compiled_loop_of
from ctc_chattering.simulation.registry import make_plant

#: How a run is computed.
COMPILED, PLAIN = 'compiled', 'plain'


def codes(setup: Setup, parts: bool = False) -> tuple[Code, ...]:
    """
    Return the functions that a setup needs as machine code; none where it cannot have them.

    Parameters
    ----------
    setup : Setup
        Without a run if law or plant cannot be machine code: MuJoCo, elastic joints.
    parts : bool
        Then return those of the other one, which a node has use for.

    """
    robot = make_plant(setup.plant, setup.descriptions.get('plant', ''))
    law = Controller(setup.controller, model_of(
        setup.controller, setup.descriptions.get('controller', '')))
    loop = compiled_loop_of(robot, law)
    if loop is not None or not parts:
        return () if loop is None else loop.codes
    steps = law.compiled_step(), robot.compiled_step()
    return tuple(code for step in steps if step is not None for code in step.codes)


def way(setup: Setup) -> str:
    """Return how a run of a setup is computed now, `COMPILED` or `PLAIN`."""
    return COMPILED if can_be_compiled(setup) and not missing([setup]) else PLAIN


def can_be_compiled(setup: Setup) -> bool:
    """Return whether a run of a setup can be machine code."""
    return not setup.events and bool(codes(setup))


def missing(setups: Iterable[Setup], parts: bool = False) -> dict[str, Code]:
    """Return the `codes` of setups that are not compiled yet, by their files."""
    found = {code.path.name: code for setup in setups for code in codes(setup, parts)}
    return {name: code for name, code in found.items() if not code.compiled}


def compile_setups(setups: Iterable[Setup], show: Callable[[str], None], parts: bool = False
                   ) -> int:
    """
    Compile what setups need and is not compiled yet; return how many functions.

    Without numba, which compiles, the runs are plain Python.

    Parameters
    ----------
    setups : iterable of Setup
        What will run.
    show : callable
        Takes a line that says so, before each of them.
    parts : bool
        As of `codes`.

    """
    if find_spec('numba') is None or find_spec('llvmlite') is None:
        show('numba is not installed: plain Python computes, 20 times slower '
             '(pip install numba)')
        return 0
    from ctc_chattering.numerics.simd.build import build
    todo = missing(setups, parts)
    for i, code in enumerate(todo.values()):
        show(f'compiling {code.name} ({i + 1} of {len(todo)}), once for this version ...')
        build(code)
    return len(todo)
