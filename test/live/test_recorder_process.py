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

"""A recorder that the page starts and stops: nothing is overwritten, and its death is told."""

from __future__ import annotations

from pathlib import Path
import signal
import time
from unittest.mock import Mock

from ctc_chattering.live.recorder_process import RecorderProcess, RecorderState
from diagnostic_msgs.msg import DiagnosticArray
from processes import probe, wait_for
import pytest
from recorded_runs import reports_of
from rosbags.highlevel import AnyReader


@pytest.mark.ros
def test_records_until_it_is_stopped_and_tells_of_a_death(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "the lab's: bags"
    folder.mkdir()
    told: list[tuple[str, bool, str]] = []
    it = RecorderProcess(folder, [], lambda *words: told.append(words))
    monkeypatch.setattr(time, 'strftime', Mock(side_effect=('run', 'run', 'killed')))

    def ended() -> bool:
        it.poll()
        return bool(it.state == RecorderState.OFF)

    with probe() as graph:
        it.start()
        it.start()  # Once more, which is refused.
        reports = graph.listen(DiagnosticArray, '/diagnostics')
        graph.until(lambda: any(
            float(value.value) > 0.0 for array in reports for status in array.status
            for value in status.values if value.key == 'rate [Hz]'), 'that it has heard itself')
        it.stop()
        assert it.state == RecorderState.STOPPING
        wait_for(ended, 'the end')
        assert reports_of(folder / 'run', 'recorder')
        with AnyReader([folder / 'run']) as bag:
            count = bag.message_count
            topics = len(bag.topics)
        it.start()  # Nothing is overwritten.
        wait_for(ended, 'the refusal')
        it.start()
        assert it._child is not None
        it._child.process.send_signal(signal.SIGKILL)
        wait_for(ended, 'the death')
    expected = (
        (True, ''), (False, f'a recording runs already: {folder}/run'),
        (True, f'{folder}/run: {count} messages on {topics} topics'),
        (True, ''), (False, f'{folder}/run: exists already, not overwritten'), (True, ''),
        (False, 'recorder ended with signal SIGKILL'))
    for (_, done, words), (right, text) in zip(told, expected, strict=True):
        assert done == right and text in words
    assert sorted(x.name for x in folder.iterdir()) == ['run']
