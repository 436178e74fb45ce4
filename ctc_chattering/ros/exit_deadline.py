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

"""An end that comes even if this process holds still: see docs/design.md."""

from __future__ import annotations

import ctypes
import sys

_CLOCK_MONOTONIC, _SIGEV_THREAD = 1, 2


class _SignalEvent(ctypes.Structure):
    """The C library's sigevent, 64 bytes."""

    _fields_ = (('value', ctypes.c_long), ('signo', ctypes.c_int), ('notify', ctypes.c_int),
                ('function', ctypes.c_void_p), ('attributes', ctypes.c_void_p),
                ('rest', ctypes.c_char * 32))


def end_after(delay: float, status: int) -> None:
    """
    Have this process end `delay` [s] from now with `status`, whatever it does meanwhile.

    A thread of Python could not: who hangs may hold the interpreter's lock. On Linux with 64 bits
    only; elsewhere nothing happens.
    """
    libc = ctypes.CDLL(None)
    if (sys.platform != 'linux' or ctypes.sizeof(ctypes.c_void_p) != 8
            or not hasattr(libc, 'timer_create')):  # Of some C libraries, it is in another one.
        return
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    event = _SignalEvent(value=status, notify=_SIGEV_THREAD,
                         function=ctypes.cast(libc._exit, ctypes.c_void_p))
    timer = ctypes.c_void_p()
    if libc.timer_create(_CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)) == 0:
        times = (ctypes.c_long * 4)(0, 0, int(delay), round(delay % 1.0 * 1e9))
        libc.timer_settime(timer, 0, times, None)
