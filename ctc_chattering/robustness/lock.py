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
