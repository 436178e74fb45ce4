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
Workers and a scheduler of dask that attack who asks them: modules that dask loads first.

What they send makes a file when it is unpickled, in the folder `MARKS`, named after the process
that does so. Dask unpickles its own errors once before they are sent, so that workers make files.
"""

from __future__ import annotations

import os
from pathlib import Path
import pickle
from typing import Any

from ctc_chattering.runs import cluster
from distributed import Scheduler, Worker
from distributed.protocol.serialize import ToPickle
import pyarrow

#: Variable of the environment with the folder of the marks.
MARKS = 'CTC_TEST_MARKS'
#: Variable of the environment with the attack of a scheduler.
SCHEDULER = 'CTC_TEST_SCHEDULER'


class Evil:
    """An object that makes a file where it is unpickled."""

    def __reduce__(self) -> Any:
        folder = os.environ[MARKS]
        return exec, (f'import os, pathlib; pathlib.Path({folder!r}, str(os.getpid())).touch()',)


class EvilError(Evil, Exception):
    """An error that does so."""


def marked(folder: Path) -> bool:
    """Return whether this process has unpickled something evil."""
    return (folder / str(os.getpid())).exists()


def evil_answer(points: Any, made_by: str, chunk: Any) -> Any:
    """Answer as the number of the run says; larger ones are computed."""
    del points, made_by
    number = int(chunk[0])
    if number == 0:
        return Evil()
    if number == 1:
        raise EvilError
    if number == 2:
        from distributed import get_worker
        get_worker().log_event('warn', {'message': pickle.dumps(Evil())})
    answers = {2: b'no table', 3: 17, 4: cluster.to_bytes(pyarrow.table({'run': [5]}))}
    return answers[number]


def dask_setup(server: Worker | Scheduler) -> None:
    """Attack, as dask calls it when a worker or a scheduler starts."""
    if isinstance(server, Worker):
        cluster.answer = evil_answer
    elif os.environ.get(SCHEDULER):
        server.handlers['identity'] = lambda **_: {'type': 'Scheduler', 'evil': ToPickle(Evil())}
