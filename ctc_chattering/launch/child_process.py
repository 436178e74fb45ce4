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
Child processes of `bringup` and `ctc live`: start, watch, stop.

`node_command` is the command of a child. In the child, `end_with` and `await_start` tie it to its
parent.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence, Set
from contextlib import suppress
import ctypes
import os
import signal
import subprocess
import sys
import threading
import time

_PR_SET_PDEATHSIG = 1

#: As ``python -m``, which would import what lies in the current directory before all else.
_RUN = ('import sys; sys.path[:] = filter(None, sys.path); import runpy; '
        "runpy.run_module(sys.argv.pop(1), run_name='__main__', alter_sys=True)")


def node_command(name: str, *arguments: str, program: str = 'node') -> list[str]:
    """Return the command that runs a node or `ctc`."""
    return [sys.executable, '-c', _RUN, f'ctc_chattering.cli.{program}', name, '--parent',
            str(os.getpid()), *arguments]


def end_with(parent: int) -> None:
    """
    End this process by SIGTERM with its parent.

    The child asks for that itself. Between fork and exec Python code of a parent with threads may
    wait for ever, for a lock that one of them held.
    """
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGTERM))
    if os.getppid() != parent:
        os._exit(1)


def await_start() -> None:
    """Wait until the parent closes a piped standard input."""
    while os.read(0, 1):
        pass


class Child:
    """
    Process whose output is read as it comes.

    Parameters
    ----------
    name : str
    argv : sequence of str
    show : callable
        Called with every line it prints.
    processors : set of int, optional
        Processors that it may run on, by default all.
    start : int
        File that is its standard input, from which `await_start` reads.

    """

    def __init__(self, name: str, argv: Sequence[str], show: Callable[[str], None],
                 processors: Set[int] | None = None, start: int = subprocess.DEVNULL) -> None:
        self.name = name
        #: Last lines of its output, for the exit report.
        self.tail: deque[str] = deque(maxlen=20)
        # glibc returns freed memory from this size on [bytes], which bursts do not raise.
        self.process = subprocess.Popen(
            argv, stdin=start, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, errors='replace', start_new_session=True,
            env={'MALLOC_TRIM_THRESHOLD_': str(1 << 17), **os.environ, 'PYTHONUNBUFFERED': '1'})
        if processors:
            os.sched_setaffinity(self.process.pid, processors)
        self._reader = threading.Thread(target=self._read, args=(show,), daemon=True)
        self._reader.start()

    def _read(self, show: Callable[[str], None]) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as output:
            for line in map(str.rstrip, output):
                self.tail.append(line)
                show(f'[{self.name}] {line}')

    @property
    def status(self) -> int | None:
        """Exit status: negative for a signal, None before."""
        return self.process.poll()

    def exit_report(self) -> str:
        """Return its status or signal, with its last output."""
        self._reader.join(1.0)
        end = f'status {self.status}'
        if (self.status or 0) < 0:
            end = f'signal {signal.Signals(-self.process.returncode).name}'
        output = '\n'.join(f'    {line}' for line in self.tail or ['(it printed nothing)'])
        return f'{self.name} ended with {end}. Its last output is:\n{output}'


def stop(children: Sequence[Child], patience: float = 5.0) -> None:
    """
    End processes by SIGINT, then SIGTERM, then SIGKILL.

    The next signal is sent after `patience` [s]. Processes that have ended are passed over.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        for child in children:
            child.process.send_signal(number)
        deadline = time.monotonic() + patience
        for child in children:
            with suppress(subprocess.TimeoutExpired):
                child.process.wait(max(0.0, deadline - time.monotonic()))
        if all(child.status is not None for child in children):
            return
