"""Machine code for what a parameter file describes: whether it is there, and making it."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ctc_chattering.configuration.parameter_file import Setup
from ctc_chattering.control.controller import Controller
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.numerics.machine_code import Code
from ctc_chattering.simulation.closed_loop import compiled_loop_of
from ctc_chattering.simulation.registry import make_plant

#: How a run is computed.
COMPILED, PLAIN = 'compiled', 'plain'


def has_compiler() -> bool:
    """Return whether numba is installed."""
    return find_spec('numba') is not None and find_spec('llvmlite') is not None


def codes(setup: Setup) -> tuple[Code, ...]:
    """Return the functions that a setup needs as machine code; none where it cannot have them."""
    robot = make_plant(setup.plant, setup.descriptions.get('plant', ''))
    law = Controller(setup.controller, model_of(
        setup.controller, setup.descriptions.get('controller', '')))
    loop = compiled_loop_of(robot, law)
    return () if loop is None else loop.codes


def way(setup: Setup) -> str:
    """Return how a run of a setup is computed now, `COMPILED` or `PLAIN`."""
    found = () if setup.events else codes(setup)
    return COMPILED if found and all(code.compiled for code in found) else PLAIN


def can_be_compiled(setup: Setup) -> bool:
    """Return whether a run of a setup can be machine code."""
    return not setup.events and bool(codes(setup))


def missing(setups: Iterable[Setup]) -> list[Code]:
    """Return the functions that setups need and that are not compiled yet, each once."""
    found = {(code.function, code.layouts): code for setup in setups for code in codes(setup)}
    return [code for code in found.values() if not code.compiled]


def compile_setups(setups: Iterable[Setup], show: Callable[[str], None]) -> int:
    """
    Compile what setups need and is not compiled yet; return how many functions.

    Without numba, which compiles, the runs are plain Python.

    Parameters
    ----------
    setups : iterable of Setup
        What will run.
    show : callable
        Takes a line that says so, before each of them.

    """
    todo = missing(setups)
    if not todo:
        return 0
    try:
        from ctc_chattering.numerics.simd.build import build
    except ImportError as error:  # Not there, or numba refuses this version of NumPy.
        show(f'plain Python computes, 20 times slower: {error}')
        return 0
    for i, code in enumerate(todo):
        show(f'compiling {code.name} ({i + 1} of {len(todo)}), once for this version ...')
        build(code)
    return len(todo)
