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

"""Outages, against time lines of which the truth is known."""

from __future__ import annotations

from ctc_chattering.controller.watchdog import Watchdog
import pytest

MS = 10 ** 6


class Log:
    """Keeps what is logged; of errors the first, as their throttle does."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str]] = []

    def info(self, message: str, /, **_filters: float) -> None:
        self.lines.append(('info', message))

    def warning(self, message: str, /, **filters: float) -> None:
        assert filters == {'throttle_duration_sec': 1.0}
        self.lines.append(('warning', message))

    def error(self, message: str, /, **filters: float) -> None:
        assert filters == {'throttle_duration_sec': 60.0}
        if 'error' not in [level for level, _ in self.lines]:
            self.lines.append(('error', message))


def watched(out: range) -> tuple[Watchdog, Log, list[int]]:
    """Let a message come every millisecond of 6 s but `out`; return also when outages began."""
    log = Log()
    begins: list[int] = []
    watchdog = Watchdog('topic', 'command', 'brakes on', log)
    watchdog.timeout = 20 * MS
    watchdog.feed(0)
    for k in range(1, 6000):
        if k not in out:
            watchdog.feed(k * MS)
        if watchdog.check(k * MS):
            begins.append(k)
        assert watchdog.out == (k in out and k - out.start >= 20)
    return watchdog, log, begins


@pytest.mark.parametrize(('lasts', 'outages', 'lines'), [
    (20, 0, []),
    (50, 1, [('warning', 'topic: commands again, after 0.051 s; meanwhile brakes on')]),
    (3000, 1, [('error', 'topic: no command for 2.0 s; brakes on'),
               ('warning', 'topic: commands again, after 3.001 s; meanwhile brakes on')])])
def test_an_outage_is_found_once_and_reported(
        lasts: int, outages: int, lines: list[tuple[str, str]]) -> None:
    watchdog, log, begins = watched(range(2000, 2000 + lasts))
    assert begins == [2020] * outages
    assert watchdog.outages == outages
    assert log.lines == lines
