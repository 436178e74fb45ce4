"""Many independent calculations, in one process or several."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
import signal
from typing import Any, TypeVar

from ctc_chattering.errors import CtcError

T = TypeVar('T')
R = TypeVar('R')


def in_parallel(function: Callable[[T], R], tasks: Sequence[T], jobs: int) -> Iterator[R]:
    """
    Yield what `function` makes of every task, in their order.

    Parameters
    ----------
    function : callable
        Of a module's top level, as are its arguments and results.
    tasks : sequence
        Arguments.
    jobs : int
        Processes; 1 for this one alone.

    Raises
    ------
    CtcError
        If a process was killed.

    """
    with processes(jobs) as each:
        yield from each(function, tasks)


@contextmanager
def processes(jobs: int) -> Iterator[Callable[..., Iterator[Any]]]:
    """
    Yield a `map` over processes, for several calls of it; with `chunksize` tasks at a time.

    Parameters
    ----------
    jobs : int
        Processes; 1 for this one alone.

    Raises
    ------
    CtcError
        If a process was killed.

    """
    if jobs == 1:
        yield lambda function, tasks, chunksize=1: map(function, tasks)  # noqa: ARG005
        return
    try:
        # A fork of a process that has threads may wait for ever for what they hold. The processes
        # leave Ctrl-C to this one.
        with ProcessPoolExecutor(jobs, get_context('spawn'), signal.signal,
                                 (signal.SIGINT, signal.SIG_IGN)) as pool:
            yield pool.map
    except BrokenProcessPool:
        raise CtcError('a process of the study was killed; try fewer --jobs') from None
