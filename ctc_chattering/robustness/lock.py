"""One process at a time in a directory; the lock ends with the process, however that ends."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import fcntl
import os
from pathlib import Path
import socket

from ctc_chattering.analysis.output import writing
from ctc_chattering.errors import CtcError

#: Name in the directory.
LOCK = '.lock'


@contextmanager
def locked(directory: Path) -> Iterator[None]:
    """
    Hold a directory, made if it does not exist, for this process alone.

    Raises
    ------
    CtcError
        Naming the process that holds it, or if the directory cannot be written.

    """
    with writing(directory):
        directory.mkdir(parents=True, exist_ok=True)
        stream = (directory / LOCK).open('a+', encoding='utf-8')
    with stream:
        with writing(directory / LOCK):
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                stream.seek(0)
                raise CtcError(f'{directory}: {stream.read() or "another process"} is writing '
                               'there; wait until it ends, or choose another --out') from None
            stream.truncate(0)
            stream.write(f'process {os.getpid()} on {socket.gethostname()}')
            stream.flush()
        yield
