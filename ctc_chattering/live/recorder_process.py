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
Recorder in a process that the page starts and stops.

`Controls` starts and stops it, `GraphPage` polls it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
import json
from pathlib import Path
import signal
import time
from typing import Any

from ctc_chattering.bags.bag_files import count_dropped, read_metadata
from ctc_chattering.launch.child_process import Child, node_command, stop


class RecorderState(str, Enum):
    """State of the recorder, as web/controls.js reads it."""

    OFF = 'off'
    STARTING = 'starting'
    ON = 'on'
    STOPPING = 'stopping'


class RecorderProcess:
    """
    One recorder at a time.

    Parameters
    ----------
    folder : Path
        Directory for the bags.
    ros_args : sequence of str
        Arguments for ROS, such as a namespace.
    answer : callable
        Called with a request, its success and a text.

    """

    def __init__(self, folder: Path, ros_args: Sequence[str],
                 answer: Callable[[str, bool, str], None]) -> None:
        self._folder = folder.absolute()
        self._ros_args = ros_args
        self._answer = answer
        self._child: Child | None = None
        self._bag = self._folder
        self._start_time = 0.0
        self._stopping = False

    @property
    def state(self) -> RecorderState:
        """State of the recorder."""
        if self._child is None:
            return RecorderState.OFF
        if self._stopping:
            return RecorderState.STOPPING
        return RecorderState.ON if self._bag.exists() else RecorderState.STARTING

    def start(self) -> None:
        """Record into a new bag, named after the time."""
        if self._child is not None:
            self._answer('record', False, f'a recording runs already: {self._bag}')
            return
        self._bag = self._folder / time.strftime('live_%Y-%m-%d_%H.%M.%S')
        self._start_time = time.monotonic()
        self._stopping = False
        bag_parameter = f'bag:={json.dumps(str(self._bag))}'
        self._child = Child('recorder', node_command(
            'recorder', *self._ros_args, '--ros-args', '-p', bag_parameter), lambda _: None)
        self._answer('record', True, f'to {self._bag}')

    def stop(self) -> None:
        """Ask the recorder to close the bag."""
        if self._child is not None:
            self._stopping = True
            self._child.process.send_signal(signal.SIGINT)

    def poll(self) -> None:
        """Answer how a recorder has ended."""
        child = self._child
        if child is None or child.status is None:
            return
        self._child = None
        if child.status == 0 and self._stopping:
            self._answer('recorded', True, _describe_bag(self._bag))
        else:
            report = ' '.join(child.exit_report().split())
            self._answer('record', False, f'{self._bag}: {report}')

    def shown(self) -> dict[str, Any]:
        """Return the recorder's state as the page shows it."""
        recording = self._child is not None
        return {
            'state': self.state,
            'path': str(self._bag if recording else self._folder),
            'duration': int(time.monotonic() - self._start_time) if recording else 0}

    def close(self) -> None:
        """End a running recorder and wait until it has written the bag."""
        if self._child is not None:
            stop([self._child], patience=20.0)


def _describe_bag(bag: Path) -> str:
    """Return path and counts of a finished bag."""
    metadata = read_metadata(bag)
    topics = metadata['topics_with_message_count']
    dropped = count_dropped(bag, ('',))
    counts = f'{metadata["message_count"]} messages on {len(topics)} topics'
    return f'{bag}: {counts}, {dropped} dropped' if dropped else f'{bag}: {counts}'
