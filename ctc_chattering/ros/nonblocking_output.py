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
Standard output and error that never block the process; output that they do not accept is dropped.

A terminal that is stopped (Ctrl-S), or a pipe that is not read, blocks its writers. A controller's
last torque of 0 must not wait for a line of the log.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import fcntl
import os
import sys
import threading

#: Largest number of bytes that wait to be written; a system may allow less.
_CAPACITY = 1 << 20
#: Time to wait at the end until the last lines are written [s].
_PATIENCE = 0.5


@contextmanager
def nonblocking_output() -> Iterator[None]:
    """Have threads write the output of the process, that of C libraries included."""
    if os.isatty(2):  # rcutils prints no colours into a pipe.
        os.environ.setdefault('RCUTILS_COLORIZED_OUTPUT', '1')
    sinks = {descriptor: os.dup(descriptor) for descriptor in (1, 2)}
    threads = [_divert(*item) for item in sinks.items()]
    try:
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        for descriptor, sink in sinks.items():
            os.dup2(sink, descriptor)
        for thread in threads:
            thread.join(_PATIENCE)


def _divert(descriptor: int, sink: int) -> threading.Thread:
    """Have what is written to a descriptor go through a pipe; return the thread that reads it."""
    source, end = os.pipe()
    with suppress(OSError):
        fcntl.fcntl(end, fcntl.F_SETPIPE_SZ, _CAPACITY)
    os.set_blocking(end, False)
    os.dup2(end, descriptor)
    os.close(end)
    thread = threading.Thread(target=_copy, args=(source, sink), daemon=True)
    thread.start()
    return thread


def _copy(source: int, sink: int) -> None:
    """Copy until the end; after an error of the sink, read on and drop the data."""
    while data := os.read(source, 1 << 16):
        with suppress(OSError):
            while data:
                data = data[os.write(sink, data):]
