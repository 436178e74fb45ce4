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
Real-time scheduling of a node's process: priority, locked memory, processor, garbage.

All threads of the process are changed at once, those of the middleware too; what they start later
inherits it. So the parameters can be read like all others, after the middleware has started, and
a node asks only while time is real: with the priority, simulated time as fast as the machine can
would leave nothing of a processor to others. Of every processor, the kernel leaves a twentieth to
processes without priority (sched_rt_runtime_us).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import ctypes
import gc
import os
from pathlib import Path
import resource
from typing import Any

from ctc_chattering.configuration.node_parameters import NodeConfig
from ctc_chattering.errors import ParameterError

#: Of Linux: a limit that the module `resource` lacks, flags of mlockall, a capability's bit.
_RLIMIT_RTPRIO = 14
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_CAP_IPC_LOCK = 14
#: Objects more than at the last search for reference cycles that are worth another one.
_MANY = 2000
_NORMAL = 'normal scheduling'


class RealTime:
    """
    Asks for real-time scheduling while it is needed, and gives it back.

    Parameters
    ----------
    settings : NodeConfig

    Attributes
    ----------
    outcome : str
        What is in force, and what was refused and why.

    Raises
    ------
    ParameterError
        If there is no such processor.

    """

    def __init__(self, settings: NodeConfig) -> None:
        self._settings = settings
        self._asked = False
        self.outcome = _NORMAL
        if settings.cpu_affinity >= 0:
            _pin(settings.cpu_affinity)

    def update(self, needed: bool) -> str:
        """Ask for it or give it back, by `needed`; return a line to be logged, or nothing."""
        before = self.outcome
        if needed and not self._asked:
            self.outcome = '; '.join(filter(None, (
                _ask_for_priority(self._settings.thread_priority),
                _ask_for_memory() if self._settings.lock_memory else ''))) or _NORMAL
        elif self._asked and not needed:
            if os.sched_getscheduler(0) in (os.SCHED_FIFO, os.SCHED_RR):
                _schedule(0)
            self.outcome = _NORMAL
        self._asked = needed
        return self.outcome if self.outcome != before else ''


def _for_all_threads(function: Callable[..., None], *arguments: Any) -> None:
    """Call a function of the scheduler with the number of every thread of this process."""
    for path in Path('/proc/self/task').iterdir():
        with suppress(ProcessLookupError):  # It has ended meanwhile.
            function(int(path.name), *arguments)


def _schedule(priority: int) -> None:
    """Give all threads SCHED_FIFO with a priority; 0 for the normal scheduling."""
    policy = os.SCHED_FIFO if priority else os.SCHED_OTHER
    _for_all_threads(os.sched_setscheduler, policy, os.sched_param(priority))


def _pin(processor: int) -> None:
    """Have all threads run on one processor."""
    try:
        _for_all_threads(os.sched_setaffinity, {processor})
    except OSError:
        allowed = ' | '.join(map(str, sorted(os.sched_getaffinity(0))))
        raise ParameterError('cpu_affinity', processor, f'-1 | {allowed}') from None


def _ask_for_priority(priority: int) -> str:
    """Return what came of it; nothing if none is wanted."""
    if not priority:
        return ''
    try:
        _schedule(priority)
    except OSError as error:
        limit = resource.getrlimit(_RLIMIT_RTPRIO)[0]
        return (f'{_NORMAL} (SCHED_FIFO {priority}: {error.strerror}; needs rtprio {priority} '
                f'in /etc/security/limits.conf, ulimit -r is {limit}; or CAP_SYS_NICE)')
    return f'SCHED_FIFO {priority}'


def _ask_for_memory() -> str:
    """
    Have what is in memory stay there; return what came of it.

    Not where there is a limit: what is needed beyond it later would be refused, and end the node.
    """
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if limit != resource.RLIM_INFINITY and not _has_capability(_CAP_IPC_LOCK):
        return ('memory not locked (needs memlock unlimited in /etc/security/limits.conf, '
                f'ulimit -l is {limit // 1024}; or CAP_IPC_LOCK)')
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT):
        return f'memory not locked ({os.strerror(ctypes.get_errno())})'
    return 'memory locked'


def _has_capability(bit: int) -> bool:
    status = Path('/proc/self/status').read_text(encoding='ascii')
    return bool(int(status.split('CapEff:')[1].split()[0], 16) >> bit & 1)


@contextmanager
def garbage_off_the_loop() -> Iterator[Callable[[], None]]:
    """
    Have Python search for reference cycles only when the function that is yielded is called.

    What there is already is never searched: it is there until the end.
    """
    def collect() -> None:
        if gc.get_count()[0] > _MANY:
            gc.collect()

    gc.freeze()
    gc.disable()
    try:
        yield collect
    finally:
        gc.enable()
        gc.unfreeze()
