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

"""A process in the graph: its signals and its end, Fast DDS, SROS 2."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import ctypes
import os
import signal
import sys
from types import FrameType

from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.errors import CtcError

#: Signals that ask a process to end: Ctrl-C, kill, a terminal that was closed, and Ctrl-\\.
STOP = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


def collect_signals() -> list[int]:
    """Take `STOP` from now on; return the list of the signals that have come."""
    caught: list[int] = []

    def on_signal(number: int, _frame: FrameType | None) -> None:
        caught.append(number)

    for number in STOP:
        take_signal(number, on_signal)
    return caught


@contextmanager
def stop_signals() -> Iterator[list[int]]:
    """Collect `STOP` in the list that is yielded, as `collect_signals` does, until the end."""
    before = {number: signal.getsignal(number) for number in STOP}
    try:
        yield collect_signals()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def take_signal(number: int, handler: Callable[[int, FrameType | None], None]) -> None:
    """Handle a signal, but for a SIGHUP that is ignored: that is what nohup asks for."""
    if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
        signal.signal(number, handler)


_CLOCK_MONOTONIC, _SIGEV_THREAD = 1, 2


class _SignalEvent(ctypes.Structure):
    """The C library's sigevent, 64 bytes."""

    _fields_ = (('value', ctypes.c_long), ('signo', ctypes.c_int), ('notify', ctypes.c_int),
                ('function', ctypes.c_void_p), ('attributes', ctypes.c_void_p),
                ('rest', ctypes.c_char * 32))


def end_after(delay: float, status: int) -> None:
    """
    Have this process end `delay` [s] from now with `status`, whatever it does meanwhile.

    A thread of Python could not: who hangs may hold the interpreter's lock. The numbers are those
    of Linux with 64 bits.
    """
    libc = ctypes.CDLL(None)
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    event = _SignalEvent(value=status, notify=_SIGEV_THREAD,
                         function=ctypes.cast(libc._exit, ctypes.c_void_p))
    timer = ctypes.c_void_p()
    if libc.timer_create(_CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)) == 0:
        times = (ctypes.c_long * 4)(0, 0, int(delay), round(delay % 1.0 * 1e9))
        libc.timer_settime(timer, 0, times, None)


#: The environment variables by which Fast DDS finds a profile, in 2.x and in 3.x.
VARIABLES = 'FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE'


def use_profile() -> None:
    """
    Have this process and its children use `config/fastdds.xml`, if they use no other profile.

    To be called before the first node is made.
    """
    if not any(name in os.environ for name in VARIABLES):
        os.environ[VARIABLES[0]] = str(config_directory() / 'fastdds.xml')


def check_security() -> None:
    """
    Refuse to go on where security is enforced and no keystore is named: ROS would not say why.

    Raises
    ------
    CtcError
        If it is so.

    """
    if (os.environ.get('ROS_SECURITY_ENABLE') == 'true'
            and os.environ.get('ROS_SECURITY_STRATEGY') == 'Enforce'
            and not os.environ.get('ROS_SECURITY_KEYSTORE')):
        raise CtcError('ROS_SECURITY_STRATEGY is Enforce, but ROS_SECURITY_KEYSTORE is not set')
