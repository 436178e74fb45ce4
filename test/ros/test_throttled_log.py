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


"""Events that follow each other fast are logged once a second."""

from __future__ import annotations

from ctc_chattering.ros.throttled_log import ThrottledLog


class Lines:
    """Keeps what is logged, with its level."""

    def __init__(self) -> None:
        self.kept: list[tuple[str, str]] = []

    def info(self, message: str, /) -> None:
        self.kept.append(('info', message))

    def warning(self, message: str, /) -> None:
        self.kept.append(('warning', message))

    def error(self, message: str, /) -> None:
        self.kept.append(('error', message))


def test_a_text_is_logged_once_a_second_and_others_meanwhile() -> None:
    lines, now = Lines(), 0
    log = ThrottledLog(lines, lambda: now)
    for k in range(25):
        now = k * 100_000_000
        log.error('holding the position')
        if k == 3:
            log.info('reset by ~/reset')
            log.warning('no state for 0.1 s')
    assert lines.kept == [
        ('error', 'holding the position'), ('info', 'reset by ~/reset'),
        ('warning', 'no state for 0.1 s'), ('error', 'holding the position'),
        ('error', 'holding the position')]
