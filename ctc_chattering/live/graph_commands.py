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

"""What is asked on the page of a running graph, carried out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ctc_chattering.launch.requests import Requests
from ctc_chattering.live.controls import numbers
from ctc_chattering.live.graph_reader import GraphReader
from ctc_chattering.live.recorder_process import RecorderProcess
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds

#: Time to wait for a service and its answer [s].
_PATIENCE = 3.0


class GraphCommands:
    """
    Asks the graph for what was clicked.

    Parameters
    ----------
    reader : GraphReader
    bags : Path
        Where bags are recorded.
    ros_args : sequence of str
        Arguments for ROS of the recorder.
    answer : callable
        Called with what was asked, whether it was done, and the answer.

    Attributes
    ----------
    requests : Requests
    recording : RecorderProcess

    """

    def __init__(self, reader: GraphReader, bags: Path, ros_args: Sequence[str],
                 answer: Callable[[str, bool, str], None]) -> None:
        self._reader = reader
        self.requests = Requests(reader, answer, _PATIENCE)
        self.recording = RecorderProcess(bags, ros_args, answer)

    def poll(self) -> None:
        """Send what waits, and tell the answers that have come."""
        self.requests.poll()
        self.recording.poll()

    def carry_out(self, what: str, *arguments: Any) -> None:
        """Carry out a word with its arguments, as `Controls` and `LawPanel` say them."""
        if what == 'set':
            node, name, value = arguments
            self.requests.set(node, {name: self._typed(node, name, value)})
        elif what == 'gain':
            name, value = arguments
            self.requests.set('controller', {name: value})
        elif what == 'record':
            (name,) = arguments
            if name is None:
                self.recording.stop()
            else:
                self.recording.start(name)
        elif what == 'enable':
            self.requests.enable(*arguments)
        elif what == 'reset':
            self.requests.reset()
        elif what == 'push':
            self._push(*arguments)
        else:
            self.requests.set('plant', {'hold_at': self._hold(what, *arguments)})

    def _push(self, joint: int, torque: float, lasts: float) -> None:
        none = [0.0] * len(self._reader.names)
        torques = [torque if i == joint else x for i, x in enumerate(none)]
        # Only a change pushes: the same push again is one after none.
        self.requests.set('plant', {'disturbance.push_duration': lasts},
                          {'disturbance.push': none}, {'disturbance.push': torques})

    def _typed(self, node: str, name: str, value: str) -> Any:
        """Return what a field says, with the type that the parameter has now."""
        known = self._reader.parameters[node].get(name)
        if isinstance(known, str) or known is None:
            return value
        found = numbers(value, len(self._reader.names))
        if isinstance(known, (int, float)) and isinstance(found, list):
            return found[0] if len(set(found)) == 1 else value
        return found

    def _hold(self, what: str, samples: int) -> float:
        """Return ``hold_at`` for a click on hold, step or run [s]."""
        if what == 'run' or self._reader.config is None:
            return 0.0
        period = round(self._reader.config.control_period * NANOSECONDS)
        instant = self._reader.instant()
        latest = max(self._reader.clock, instant.t if instant is not None else 0.0)
        k = round(latest * NANOSECONDS / period) + (samples if what == 'step' else 1)
        return seconds(k * period)
