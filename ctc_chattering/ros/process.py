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
Process of a node, of bringup or of a command in the graph.

It collects the signals that ask for its end, and ends even where the middleware hangs. Before the
first node is made, it chooses the profile of Fast DDS and checks the security of ROS.
"""

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
    """Handle `STOP`, and return the list that the signals are appended to."""
    caught: list[int] = []
    handle_stop(lambda number, _frame: caught.append(number))
    return caught


@contextmanager
def stop_signals() -> Iterator[list[int]]:
    """Collect `STOP` in the yielded list while the context lasts."""
    handlers = {number: signal.getsignal(number) for number in STOP}
    try:
        yield collect_signals()
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def handle_stop(handler: Callable[[int, FrameType | None], None]) -> None:
    """Handle `STOP`, except a SIGHUP that nohup has ignored."""
    for number in STOP:
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)


# Numbers of <time.h> and <signal.h> on Linux.
_CLOCK_MONOTONIC = 1
_SIGEV_THREAD = 2


class _SignalEvent(ctypes.Structure):
    """Structure sigevent of the C library, 64 bytes."""

    _fields_ = (('value', ctypes.c_long), ('signo', ctypes.c_int), ('notify', ctypes.c_int),
                ('function', ctypes.c_void_p), ('attributes', ctypes.c_void_p),
                ('padding', ctypes.c_char * 32))


def end_after(delay: float, status: int) -> None:
    """
    End this process after `delay` [s] with `status`, even if it hangs.

    A thread of Python could not, because code that hangs may hold the interpreter's lock. The
    layout is that of Linux with 64 bits.
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


#: Environment variables that name a profile to Fast DDS, 2.x and 3.x.
PROFILE_VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')


def use_profile() -> None:
    """
    Use `config/fastdds.xml`, unless the user has another profile.

    It is for this process and its children. Call it before the first node is made.
    """
    if os.environ.keys().isdisjoint(PROFILE_VARIABLES):
        os.environ[PROFILE_VARIABLES[0]] = str(config_directory() / 'fastdds.xml')


def check_security() -> None:
    """
    Check that enforced security has a keystore.

    Without one ROS fails and does not say why.

    Raises
    ------
    CtcError
        If there is none.

    """
    enforced = (os.environ.get('ROS_SECURITY_ENABLE') == 'true'
                and os.environ.get('ROS_SECURITY_STRATEGY') == 'Enforce')
    if enforced and not os.environ.get('ROS_SECURITY_KEYSTORE'):
        raise CtcError('ROS_SECURITY_STRATEGY is Enforce, but ROS_SECURITY_KEYSTORE is not set')
