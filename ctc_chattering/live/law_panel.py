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

"""The page's own controls: law, gains, recording; what it shows and what it may ask."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
import time
from typing import Any

from ctc_chattering.control.controller import LAWS
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.errors import CtcError
from ctc_chattering.live.gains import gains_of

#: Answers that are shown.
_ANSWERS = 6


class LawPanel:
    """
    What controls.js draws, and what it sends: words on the subject ``ask``.

    Parameters
    ----------
    ask : callable
        Called with a word and its arguments, as those of `Controls`; and ``record`` with a name,
        or with None to stop.

    """

    def __init__(self, ask: Callable[..., None]) -> None:
        self._ask = ask
        self._names: tuple[str, ...] = ()
        self._parameters: Mapping[str, Any] = {}
        self._answers: deque[dict[str, Any]] = deque(maxlen=_ANSWERS)
        self._answered = 0

    def state(self, names: Sequence[str], parameters: Mapping[str, Any],
              record: Mapping[str, Any]) -> dict[str, Any]:
        """
        Return what the page is to show.

        Parameters
        ----------
        names : sequence of str
            The joints.
        parameters : mapping
            The controller's, in force.
        record : mapping
            As `RecorderProcess.shown` returns it.

        """
        self._names, self._parameters = tuple(names), parameters
        law, switching = (str(parameters.get(x, '')) for x in ('law', 'switching'))
        return {
            'law': law, 'laws': LAWS, 'joints': self._names,
            'switching': switching if law == 'chattering' else None,
            'switchings': SWITCHINGS, 'record': record,
            'gains': [gain.shown() for gain in gains_of(parameters, names)],
            'answers': list(self._answers), 'answered': self._answered}

    def answer(self, what: str, done: bool, text: str) -> None:
        """Note what became of a request."""
        self._answered += 1
        self._answers.appendleft({'what': what, 'done': done, 'text': text[:1000],
                                  'at': time.strftime('%H:%M:%S')})

    def receive(self, asked: Any) -> None:
        """Take what a page asks for; what it cannot ask is passed over."""
        if not isinstance(asked, dict) or len(asked) != 1:
            return
        (what, value), = asked.items()
        if what in _CHOICES:
            if value in _CHOICES[what]:
                self._ask('set', 'controller', what, value)
        elif what == 'gain':
            self._receive_gain(value)
        elif what == 'record' and (value is None or isinstance(value, str)):
            self._ask('record', value)

    def _receive_gain(self, value: Any) -> None:
        if not isinstance(value, dict) or set(value) != {'name', 'joint', 'value'}:
            return
        for gain in gains_of(self._parameters, self._names):
            if gain.spec.name == value['name']:
                try:
                    changed = gain.changed(value['joint'], value['value'])
                except CtcError as error:
                    self.answer(gain.spec.name, False, str(error))
                else:
                    if changed is not None:
                        self._ask('gain', gain.spec.name, changed)


#: What can be chosen, by parameter.
_CHOICES = {'law': LAWS, 'switching': SWITCHINGS}
