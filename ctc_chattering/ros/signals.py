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

"""The signals that ask for the end, as a list that fills, to be looked at when it suits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import signal
from types import FrameType

#: Signals that ask a process to end: Ctrl-C, kill, a terminal that was closed, and Ctrl-\\.
STOP = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


def collect() -> list[int]:
    """Take `STOP` from now on; return the list of the signals that have come."""
    caught: list[int] = []

    def on_signal(number: int, _frame: FrameType | None) -> None:
        caught.append(number)

    for number in STOP:
        take(number, on_signal)
    return caught


@contextmanager
def stop_signals() -> Iterator[list[int]]:
    """Collect `STOP` in the list that is yielded, as `collect` does, until the end."""
    before = {number: signal.getsignal(number) for number in STOP}
    try:
        yield collect()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def take(number: int, handler: Callable[[int, FrameType | None], None]) -> None:
    """Handle a signal, but for a SIGHUP that is ignored: that is what nohup asks for."""
    if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
        signal.signal(number, handler)
