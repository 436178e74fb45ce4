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

"""Tasks for the tests of the scheduler, in a module so that other processes find them."""

from __future__ import annotations

import os
from pathlib import Path
import signal
import time

from ctc_chattering.errors import ParameterError


def add(a: int, b: int, task: int) -> int:
    return a + b + task


def fail(kind: str, _task: int) -> None:
    if kind == 'ours':
        raise ParameterError('ka', -1.0, 'a number >= 0')
    raise ZeroDivisionError('a division\nby zero')


def die_once(marks: str, task: int) -> int:
    """Kill the process that computes this for the first time."""
    mark = Path(marks) / f'{task}'
    if not mark.exists():
        mark.write_text(str(os.getpid()))
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


def die(_task: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def until_there(begun: str, task: str) -> int:
    """Say that this has begun; return once a file is there."""
    Path(begun).touch()
    while not Path(task).exists():
        time.sleep(0.01)
    return 2


def late(time_taken: float) -> float:
    time.sleep(time_taken)
    return time_taken
