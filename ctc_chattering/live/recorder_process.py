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

"""Recording a running graph from the page: our recorder as a process of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import json
from pathlib import Path
import re
import signal
import time
from typing import Any

from ctc_chattering.launch.child_process import Child, node_command, stop

#: What the directory of a bag may be called by a browser: it is always one in the folder of bags.
_NAME = re.compile(r'[A-Za-z0-9][A-Za-z0-9_.-]{0,63}')
#: How long a recorder may take to write what it has, when the page ends [s].
_PATIENCE = 20.0


class RecorderProcess:
    """
    Starts and stops a recorder, one at a time.

    Parameters
    ----------
    folder : Path
        Where the bags are made.
    ros_args : sequence of str
        Arguments for ROS, such as a namespace.
    tell : callable
        Called with what was asked, whether it was done, and what became of it.

    """

    def __init__(self, folder: Path, ros_args: Sequence[str],
                 tell: Callable[[str, bool, str], None]) -> None:
        self._folder, self._ros_args, self._tell = folder.absolute(), tuple(ros_args), tell
        self._child: Child | None = None
        self._path = self._folder
        self._begun = 0.0
        self._asked = False

    def start(self, name: Any) -> None:
        """Record into a new bag of this name; an empty one is that of the time."""
        if self._child is not None:
            self._tell('record', False, f'is recording already: {self._path}')
            return
        name = name or time.strftime('live_%Y-%m-%d_%H.%M.%S')
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            self._tell('record', False, f'name = {str(name)[:80]!r} is not allowed: at most 64 '
                       'letters of ASCII, digits and "_.-", the first a letter or a digit')
            return
        path = self._folder / name
        if path.exists():
            self._tell('record', False, f'{path}: exists already, not overwritten')
            return
        self._path, self._begun, self._asked = path, time.monotonic(), False
        self._child = Child('recorder', node_command(
            'recorder', *self._ros_args, '--ros-args', '-p', f'bag:={json.dumps(str(path))}'),
            lambda _: None)
        self._tell('record', True, f'to {path}')

    def stop(self) -> None:
        """Have it close the bag."""
        if self._child is not None:
            self._asked = True
            self._child.signal(signal.SIGINT)

    def poll(self) -> None:
        """Tell how a recorder has ended."""
        child = self._child
        if child is None or child.status is None:
            return
        self._child = None
        report = ' '.join(child.exit_report().split())
        if child.status == 0 and self._asked:
            counts = [line.rpartition(']: ')[2] for line in child.tail if ' messages on ' in line]
            self._tell('recorded', True, ', '.join((str(self._path), *counts)))
        else:
            self._tell('record', False, report + (
                f'; what was written is in {self._path}, see ctc repair'
                if self._path.exists() else ''))

    def shown(self) -> dict[str, Any]:
        """Return what the page has to know."""
        child = self._child
        state = ('off' if child is None else 'stopping' if self._asked else
                 'on' if child.tail else 'starting')
        return {'state': state, 'path': str(self._folder if child is None else self._path),
                'lasts': 0 if child is None else int(time.monotonic() - self._begun)}

    def close(self) -> None:
        """End a recorder that runs, and wait for it."""
        if self._child is not None:
            stop([self._child], _PATIENCE)
