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
Tasks in processes of this machine or a cluster.

`workers` yields a client, and `run_on_workers` sends it tasks. With
one process, `run_serially` computes them here.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from copy import copy
from functools import partial
import logging
from multiprocessing import resource_tracker
import signal
from typing import Any, TYPE_CHECKING, TypeVar

from ctc_chattering.errors import as_ctc_error, CtcError

if TYPE_CHECKING:
    from distributed import Client

R = TypeVar('R')


def run_serially(function: Callable[..., R], tasks: Iterable[Any], *shared: Any) -> Iterator[R]:
    """Return the results of every task in this process."""
    return map(partial(function, *shared), tasks)


@contextmanager
def processes(jobs: int) -> Iterator[Callable[..., Iterator[Any]]]:
    """
    Yield a function that computes tasks, for several calls.

    Parameters
    ----------
    jobs : int
        Processes: `run_on_workers` of so many, or `run_serially` for 1.

    """
    if jobs <= 1:
        yield run_serially
        return
    with workers(jobs) as client:
        yield partial(run_on_workers, client)


@contextmanager
def workers(jobs: int, address: str | None = None) -> Iterator[Client]:
    """
    Yield a client of processes that compute.

    Parameters
    ----------
    jobs : int
        Processes of this machine, one thread each. A killed one is replaced.
    address : str, optional
        Address of a cluster's scheduler, ``tcp://host:port``, in place of them.

    Raises
    ------
    CtcError
        If there is no scheduler at the address.

    """
    from distributed import Client, LocalCluster
    for name in ('distributed', 'distributed.client'):  # They also log each error that they raise.
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    if address is not None:
        with _connect(address) as client:
            yield client
        return
    with _without_interrupts(), as_ctc_error('the processes that compute cannot be started'):
        cluster = LocalCluster(
            n_workers=jobs, threads_per_worker=1, memory_limit=0, dashboard_address=None,
            silence_logs=logging.CRITICAL, scheduler_kwargs={'dashboard_address': '127.0.0.1:0'})
    with cluster, Client(cluster, set_as_default=False) as client:
        yield client


def _connect(address: str) -> Client:
    """
    Return a client of the scheduler at an address.

    Raise `CtcError` if none answers.
    """
    from distributed import Client
    from distributed.comm.addressing import parse_address, parse_host_port
    try:
        parse_host_port(parse_address(address)[1])
        return Client(address, timeout=10, set_as_default=False)  # [s]
    except Exception as error:  # Another program at the address may have sent anything.
        text = ' '.join(str(error).split())
        raise CtcError(f'--scheduler {address}: no scheduler answers: {text}') from None


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """
    Leave Ctrl-C to this thread alone.

    Threads inherit the mask of the thread that starts them, and processes that of a thread. So the
    workers do not get the signal, nor do those that replace killed ones.
    """
    resource_tracker.ensure_running()  # When it starts, it would unmask the signal.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def threads(client: Client, say: Callable[[str], None]) -> int:
    """
    Return the number of threads that compute.

    With none, `say` a line and wait for one.
    """
    if not client.nthreads():
        say(f'waiting for workers at {client.scheduler.address}')
        client.wait_for_workers(1)
    return sum(client.nthreads().values())


def run_on_workers(client: Client, function: Callable[..., R], tasks: Iterable[Any], *shared: Any
                   ) -> Iterator[R]:
    """
    Yield the results of every task in order.

    The task of a worker that is killed goes to another, or waits for one.

    Parameters
    ----------
    client : Client
        As `workers` yields it.
    function : callable
        Function of a module's top level. It is called with `shared`, then the task.
    tasks : iterable
        Arguments.
    shared : object
        Arguments that are sent to every worker once.

    Raises
    ------
    CtcError
        If a task raises one, kills one worker after the other, or the scheduler is lost.

    """
    from distributed import KilledWorker
    from distributed.comm import CommClosedError
    with as_ctc_error('a worker failed'):
        try:
            arguments = [client.submit(copy, x, pure=False) for x in shared]
            futures = deque(
                client.submit(function, *arguments, task, pure=False) for task in tasks)
            while futures:
                yield futures.popleft().result()
        except KilledWorker as error:
            raise CtcError(f'{error.allowed_failures + 1} workers were killed while they computed '
                           'the same task; is there enough memory?') from None
        except (CancelledError, CommClosedError):
            raise CtcError('the scheduler is lost') from None
