"""What simulates a parameter file: the compiled loop where it can, or that of `ctc simulate`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
import dataclasses

from ctc_chattering.analysis.result import Result, simulated
from ctc_chattering.configuration.parameter_file import Setup
from ctc_chattering.errors import CtcError, UsageError

#: The compiled loop, and the one of `ctc simulate`.
BATCH, REFERENCE = ENGINES = ('batch', 'reference')


def available(engine: str | None = None) -> tuple[str, str]:
    """
    Return an engine, the fastest that there is by default, and why it is not `BATCH`.

    Raises
    ------
    UsageError
        If the engine that is asked for is not installed.

    """
    if engine == REFERENCE:
        return REFERENCE, ''
    try:
        import numba  # noqa: F401
    except ImportError as error:  # It refuses versions of NumPy that it does not know.
        reason = (f'{error.name} is not installed: pip install {error.name}'
                  if isinstance(error, ModuleNotFoundError) else f'numba: {error}')
        if engine == BATCH:
            raise UsageError(f'--engine batch: {reason}') from None
        return REFERENCE, reason
    return BATCH, ''


def engine_of(setup: Setup, engine: str | None = None) -> tuple[str, str]:
    """
    Return the engine that runs a setup, and why it is another than asked for.

    Parameters
    ----------
    setup : Setup
        The run.
    engine : str, optional
        `BATCH` for the compiled loop where it can, `REFERENCE`, or None for what there is.

    Raises
    ------
    UsageError
        If the engine that is asked for is not installed.

    """
    found, reason = available(engine)
    if found == BATCH:
        from ctc_chattering.batch.closed_loop import unsupported
        reason = unsupported(setup)
    return (REFERENCE if reason else found), reason


def engine_text(setup: Setup, engine: str | None = None) -> str:
    """Return the engine that runs a setup, with the reason where it is another than asked for."""
    found, reason = engine_of(setup, engine)
    return f'{found} ({reason})' if reason else found


def simulated_by(setup: Setup, engine: str | None = None, truth: bool = False) -> Result:
    """
    Simulate what a parameter file describes by the engine that `engine_of` names.

    Parameters
    ----------
    setup : Setup
        As `parameter_file.load` returns it.
    engine : str, optional
        As `engine_of` takes it.
    truth : bool
        Record the true state in place of the one that the sensors show.

    """
    if engine_of(setup, engine)[0] == REFERENCE:
        return simulated(setup, truth=truth)
    from ctc_chattering.batch.closed_loop import simulate
    return Result(setup.plant.experiment, [(0.0, setup.controller)], simulate(setup, truth),
                  description=setup.descriptions.get('controller', ''))


def compile_loop(setups: Iterable[Setup], engine: str | None, show: Callable[[str], None]
                 ) -> None:
    """
    Compile the loop where setups need it and it is not there; several processes would wait.

    Parameters
    ----------
    setups : iterable of Setup
        What will run.
    engine : str, optional
        As `engine_of` takes it.
    show : callable
        Takes a line that says so, before.

    """
    each = {len(x.plant.joint_names): x for x in setups if engine_of(x, engine)[0] == BATCH}
    for n, setup in each.items():
        from ctc_chattering.batch.compiler import is_compiled
        if not is_compiled(n):
            show(f'the loop is compiled for {n} joints first, once for this version: about half a '
                 'minute')
            plant = setup.plant.changed({'duration': setup.plant.control_period})
            with suppress(CtcError):  # The run itself says what is wrong.
                simulated_by(dataclasses.replace(setup, plant=plant), engine)
