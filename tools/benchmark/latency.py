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
Regularity and answer time of the loop, with and without priority.

Beside it is a bare Python program: a timer sends a UDP packet to another process and waits for it
to come back. `make latency` prints a Markdown table, and validation/README.md shows one.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import multiprocessing
import os
import platform
import socket
import statistics
import sys
import time
from typing import NamedTuple

from ctc_chattering.controller.loop_statistics import LoopStatistics
from real_time_loop import real_time_loop

_COLUMNS = ('p50', 'p99', 'p99.9', 'max')
#: Length of a measurement [s]: diagnostics look back so far.
_WINDOW = 10
#: Period of the loop [s].
_PERIOD = 1e-3


class Times(NamedTuple):
    """Quantiles and largest of period and answer time [ms], and what scheduling was granted."""

    period: list[float]
    answer: list[float]
    scheduling: str


def measure_nodes(priority: int) -> Times:
    """Return what the plant's diagnostics say after a while in real time."""
    granted = _request(priority)  # The nodes inherit it.
    with real_time_loop() as (found, spin):
        reports: list[dict[str, str]] = []
        while len(reports) < _WINDOW + 2:  # The first ones are of the start.
            spin()
            reports = [{x.key: x.value for x in status.values} for status in found['/plant']
                       if status.message.startswith('running')]
    last = reports[-1]
    period, answer = ([float(last[f'{name}, {column} [ms]']) for column in _COLUMNS]
                      for name in ('period', 'answer time'))
    _request(0)
    return Times(period, answer, granted)


def measure_bare(priority: int) -> Times:
    """Return the same of a timer, and of a packet that another process sends back."""
    spawn = multiprocessing.get_context('spawn')
    ours, theirs = spawn.Pipe()
    processes = [spawn.Process(target=_echo, args=(priority, ours)),
                 spawn.Process(target=_timer, args=(priority, theirs))]
    for process in processes:
        process.start()
    processes[1].join()
    processes[0].terminate()
    return Times(*ours.recv())


def _request(priority: int) -> str:
    """Have this process, and what it starts, scheduled with a priority; return what came of it."""
    policy = os.SCHED_FIFO if priority else os.SCHED_OTHER
    try:
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except OSError as error:
        return f'SCHED_FIFO {priority}: {error.strerror}'
    return f'SCHED_FIFO {priority}' if priority else 'normal'


def _echo(priority: int, pipe: multiprocessing.connection.Connection) -> None:
    _request(priority)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.bind(('127.0.0.1', 0))
        pipe.send(udp.getsockname())
        while True:
            data, sender = udp.recvfrom(100)
            udp.sendto(data, sender)


def _timer(priority: int, pipe: multiprocessing.connection.Connection) -> None:
    scheduling = _request(priority)
    loop = LoopStatistics()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.connect(pipe.recv())
        begin = due = time.monotonic()
        while due < begin + _WINDOW:
            due += _PERIOD
            time.sleep(max(0.0, due - time.monotonic()))
            now = time.monotonic_ns()
            udp.send(bytes(100))
            udp.recv(100)
            loop.sample(now, now)
            loop.answer(now, time.monotonic_ns())
    values = loop.values()
    shown = [[values[f'{name}, {column} [ms]'] for column in _COLUMNS]
             for name in ('period', 'answer time')]
    pipe.send((*shown, scheduling))


def _spin() -> None:
    while True:
        pass


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Have `count` processes use a processor each."""
    processes = [multiprocessing.get_context('spawn').Process(target=_spin) for _ in range(count)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.join()


def row(title: str, loops: int, rounds: Sequence[Times]) -> str:
    """Return a line of the table: medians over the rounds, and the largest of all."""
    cells = []
    for series in ([x.period for x in rounds], [x.answer for x in rounds]):
        columns = list(zip(*series))
        cells += [f'{statistics.median(column):.2f}' for column in columns[:-1]]
        cells.append(f'{max(columns[-1]):.1f}')
    return f'| {loops} | {title} | ' + ' | '.join(cells) + ' |'


def main() -> None:
    """Measure, in turns, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rounds', type=int, default=3)
    parser.add_argument('--busy', type=int, nargs='*', default=[0, os.cpu_count() or 1],
                        help='numbers of busy loops to measure beside')
    options = parser.parse_args()
    print(f'{platform.release()}, {os.cpu_count()} processors, load average '
          f'{os.getloadavg()[0]:.1f} before; {options.rounds} rounds of {_WINDOW} s', flush=True)
    results: dict[tuple[int, str], list[Times]] = {}
    for number in range(options.rounds):
        for loops in options.busy:
            with busy(loops):
                for priority in (0, 50):
                    for what, measure in (('bare', measure_bare), ('nodes', measure_nodes)):
                        times = measure(priority)
                        title = f'{what}, {"SCHED_FIFO" if priority else "normal"}'
                        results.setdefault((loops, title), []).append(times)
                        print(f'round {number + 1}, {loops} busy loops, {title}: '
                              f'{times.scheduling}', file=sys.stderr, flush=True)
    print('| busy loops | | ' + ' | '.join(
        f'{name} {column}' for name in ('period', 'answer') for column in _COLUMNS) + ' |')
    print('|--:|---|' + '--:|' * 8)
    for (loops, title), rounds in results.items():
        print(row(title, loops, rounds))


if __name__ == '__main__':
    main()
