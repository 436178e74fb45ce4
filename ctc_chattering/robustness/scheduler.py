"""Chunks computed by dask: by processes of this machine, or by a cluster that is there."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import logging
from multiprocessing import resource_tracker
import signal
from typing import Any, TypeVar

import dask
from distributed import as_completed, Client, Future, KilledWorker, LocalCluster

from ctc_chattering.errors import CtcError

T = TypeVar('T')
#: Tasks in flight per thread: the next ones wait at the worker while results are on their way.
_IN_FLIGHT = 4
#: Time to connect, and to wait for workers to end [s].
_CONNECT, _END = 10, 2
_LOG = 'distributed'


@contextmanager
def workers(jobs: int, address: str | None = None) -> Iterator[Client]:
    """
    Yield a client of processes that compute.

    Parameters
    ----------
    jobs : int
        Processes of this machine, one thread each; one that is killed is replaced.
    address : str, optional
        Of the scheduler of a cluster, in place of them; ``tcp://host:port``.

    Raises
    ------
    CtcError
        If there is no scheduler at the address.

    """
    logging.getLogger(_LOG).setLevel(logging.CRITICAL)
    if address is not None:
        with _connected(address) as client:
            yield client
        return
    settings = {'distributed.worker.profile.enabled': False,
                'distributed.comm.timeouts.connect': f'{_CONNECT}s'}
    with dask.config.set(settings):
        with _without_interrupts():
            cluster = LocalCluster(
                n_workers=jobs, threads_per_worker=1, dashboard_address=None, memory_limit=0,
                silence_logs=logging.CRITICAL)
        with cluster, Client(cluster, set_as_default=False) as client:
            yield client


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    """Yield a client of the scheduler at an address."""
    try:
        client = Client(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        text = ' '.join(str(error).split())
        raise CtcError(f'--scheduler {address}: no scheduler answers: {text}') from None
    with client:
        yield client


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """
    Leave Ctrl-C to this thread alone.

    Threads inherit the mask of the thread that starts them, and processes that of a thread: those
    of the workers do not get the signal, those that replace killed ones neither.
    """
    resource_tracker.ensure_running()  # When it starts, it would unmask the signal.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def threads(client: Client) -> int:
    """Return the number of threads that compute; wait until there is one."""
    found: int = sum(client.nthreads().values())
    if not found:
        client.wait_for_workers(1)
        found = sum(client.nthreads().values())
    return found


def check_versions(client: Client, version: str) -> None:
    """
    Check that all workers have this version of the package.

    Raises
    ------
    CtcError
        Naming a worker that has another, or none.

    """
    def installed() -> str:  # By value, for it must run where there is no such package.
        try:
            from ctc_chattering.robustness.chunks import version
        except ImportError as error:
            return f'none that makes maps ({error})'
        return version()

    for worker, found in client.run(installed).items():
        if found != version:
            raise CtcError(f'worker {worker} has ctc_chattering {found}, not {version}: install '
                           'the same one everywhere')


def computed(client: Client, function: Callable[..., Any], shared: Sequence[Any],
             tasks: Sequence[tuple[str, T]]) -> Iterator[tuple[str, Any]]:
    """
    Yield name and result of every task, in the order in which they are done.

    A bounded number is in flight, whatever the number of tasks. The task of a worker that is
    killed goes to another.

    Parameters
    ----------
    client : Client
        As `workers` yields it.
    function : callable
        Of a module's top level; called with the elements of `shared`, then that of the task.
    shared : sequence
        Sent to every worker once.
    tasks : sequence of (str, object)
        Name and argument. Equal names mean equal results.

    Raises
    ------
    CtcError
        If a task raises one, kills one worker after the other, or the scheduler is lost.

    """
    common = client.submit(tuple, shared, pure=False)
    waiting, done = iter(tasks), as_completed(loop=client.loop, with_results=True,
                                              raise_errors=False)
    room = _IN_FLIGHT * threads(client)
    while True:
        for _ in range(room):
            name, task = next(waiting, (None, None))
            if name is None:
                break
            done.add(client.submit(_called, function, common, task, key=name))
        if done.is_empty():
            return
        for future, result in done.next_batch():
            yield future.key, _result(future, result)
            future.release()
        room = _IN_FLIGHT * threads(client) - done.count()


def _called(function: Callable[..., Any], shared: Sequence[Any], task: Any) -> Any:
    return function(*shared, task)


def _result(future: Future, result: Any) -> Any:
    """Return the result of a task, or raise `CtcError`."""
    if future.status == 'finished':
        return result
    if future.status == 'error':
        error = result[1]
        if isinstance(error, KilledWorker):
            raise CtcError(f'{error.allowed_failures + 1} workers were killed while they computed '
                           'the same runs; is there enough memory?')
        if isinstance(error, CtcError):
            raise error
        text = ' '.join(str(error).split())
        raise CtcError(f'a worker failed: {type(error).__name__}: {text}') from error
    raise CtcError('the scheduler is lost')
