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

"""Times of processes on a machine that others use as well."""

from __future__ import annotations

from pathlib import Path
import subprocess
import time
from typing import Any

#: What is taken for hanging [s]: no bound of a test's, and far from all that a busy machine does.
PATIENCE = 120.0


class Stopwatch:
    """
    Measures what processes take [s], but for the time for which they wait for a processor.

    What others on the machine do to the time of a test is nearly all in that waiting, which Linux
    counts (``/proc/PID/schedstat``; the main threads' is taken). Where it does not, none is left
    out.

    Parameters
    ----------
    pids : int
        The processes; of several, one waits for the other.

    """

    def __init__(self, *pids: int) -> None:
        self._before = {pid: _waited(pid) for pid in pids}
        self._after = dict(self._before)
        self._begin = time.monotonic()

    def read(self) -> float:
        """Return the time since it was made, without the waiting [s]."""
        return time.monotonic() - self._begin - self.waited()

    def waited(self) -> float:
        """Return for how long they have waited for a processor since it was made [s]."""
        for pid, latest in self._after.items():
            self._after[pid] = max(latest, _waited(pid))
        return sum(self._after.values()) - sum(self._before.values())

    def end(self, process: subprocess.Popen[Any]) -> float:
        """Wait for the end of a process and return `read` of just before it [s]."""
        deadline = time.monotonic() + PATIENCE
        took = 0.0
        while process.poll() is None:
            took = self.read()
            assert time.monotonic() < deadline, 'waited in vain for the end'
            time.sleep(0.01)
        return took


def _waited(pid: int) -> float:
    try:
        return int(Path(f'/proc/{pid}/schedstat').read_text().split()[1]) * 1e-9
    except OSError:
        return 0.0
