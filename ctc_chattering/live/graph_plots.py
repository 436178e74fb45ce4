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

"""The plots of a running graph: all its samples, from the reader to the pages."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ctc_chattering.analysis.result import position_units
from ctc_chattering.live.graph_reader import GraphReader
from ctc_chattering.live.samples_socket import Message, SamplesSocket, word

#: Last seconds that the plots follow [s].
WINDOW = 10.0
#: Between two messages to the pages [s].
_PERIOD = 0.1
_SIGNALS = ('e', 'V', 'torque', 'rate')


class GraphPlots:
    """
    Sends what is new.

    Parameters
    ----------
    samples : SamplesSocket
        To the pages.
    reader : GraphReader
        Of the graph.

    """

    def __init__(self, samples: SamplesSocket, reader: GraphReader) -> None:
        self._samples, self._reader = samples, reader
        self._shown: Any = None
        self._sent: dict[str, Any] = {}
        self._due = 0.0

    def update(self, now: float) -> None:
        """Send the samples that have come when it is time, and all to new pages."""
        reader, samples = self._reader, self._samples
        about = reader.names, reader.description, self._note()
        if about != self._shown:
            self._shown = about
            self._sent = {}
            samples.send(self._show())
        if now >= self._due:
            self._due = now + _PERIOD
            for message in self._news(self._sent):
                samples.send(message)
        samples.poll(self._greeting)

    def _greeting(self) -> list[Message]:
        # What comes next for the others must come next for the new page, too.
        for message in self._news(self._sent):
            self._samples.send(message)
        return [self._show(), *self._news({})]

    def _news(self, sent: dict[str, Any]) -> Iterator[bytes]:
        """Yield the samples that were not sent, and note that they are."""
        begin = self._reader.begin
        for name, track in self._reader.tracks.items():
            before, sent[name] = sent.get(name), track.mark(begin)
            if self._samples.watched and (data := track.packed(before, begin)):
                yield data

    def _show(self) -> str:
        names = self._reader.names
        return word(show={
            'joints': names, 'units': position_units(names, self._reader.description),
            'runs': [''],
            'options': {'window': WINDOW, 'signals': _SIGNALS},
            'note': self._note()})

    def _note(self) -> str:
        """Return which samples there are."""
        if not self._reader.names:
            return 'waiting for a graph'
        values = self._reader.parameters['controller']
        every = values.get('state_decimation')
        terms = ('those of its other topics' if not isinstance(every, int) else
                 'every sample of the law' if every == 1 else
                 f'every {every}th sample of the law (state_decimation)')
        return f'Drawn: every message of joint_states (q, dq, effort), and {terms}.'
