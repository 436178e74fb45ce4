"""
Standard output and error that never block the process; output that they do not accept is dropped.

A terminal that is stopped (Ctrl-S), or a pipe that is not read, blocks its writers. A controller's
last torque of 0 must not wait for a line of the log.
"""

from __future__ import annotations

from contextlib import suppress
import fcntl
import os
import sys
import threading

#: Largest number of bytes that wait to be written; a system may allow less.
_CAPACITY = 1 << 20
#: Time to wait at the end until the last lines are written [s].
_PATIENCE = 0.5


class NonblockingOutput:
    """A context in which threads write the output of the process, C libraries included."""

    def __enter__(self) -> NonblockingOutput:
        """Redirect both into pipes."""
        if os.isatty(2):  # rcutils prints no colours into a pipe.
            os.environ.setdefault('RCUTILS_COLORIZED_OUTPUT', '1')
        self._sinks = {descriptor: os.dup(descriptor) for descriptor in (1, 2)}
        self._threads = [self._divert(*item) for item in self._sinks.items()]
        return self

    @staticmethod
    def _divert(descriptor: int, sink: int) -> threading.Thread:
        source, end = os.pipe()
        with suppress(OSError):
            fcntl.fcntl(end, fcntl.F_SETPIPE_SZ, _CAPACITY)
        os.set_blocking(end, False)
        os.dup2(end, descriptor)
        os.close(end)
        thread = threading.Thread(target=_copy, args=(source, sink), daemon=True)
        thread.start()
        return thread

    def __exit__(self, *_: object) -> None:
        """Wait a moment for the last lines; then print as before."""
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        for descriptor, sink in self._sinks.items():
            os.dup2(sink, descriptor)
        for thread in self._threads:
            thread.join(_PATIENCE)


def _copy(source: int, sink: int) -> None:
    """Copy until the end; after an error of the sink, read on and drop the data."""
    while data := os.read(source, 1 << 16):
        with suppress(OSError):
            while data:
                data = data[os.write(sink, data):]
