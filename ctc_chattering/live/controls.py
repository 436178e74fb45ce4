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

"""Buttons and fields beside the view; each click becomes a command, and nothing else does."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ctc_chattering.analysis.markup import fragment
from ctc_chattering.analysis.tables import in_field

#: Parameters with a field of their own: title, node, name.
FIELDS = (
    ('observer_bandwidth', 'controller', 'observer_bandwidth'),
    ('Coulomb friction [N·m]', 'plant', 'coulomb_friction'),
    ('viscous friction', 'plant', 'viscous_friction'),
    ('disturbance [N·m]', 'plant', 'disturbance.amplitude'),
    ('its frequency [rad/s]', 'plant', 'disturbance.frequency'))
_REASON = '<div class="ctc-reason" style="font-size:0.8em;padding:0 12px 4px">{{ reason }}</div>'
#: Why simulated time cannot be stopped, where it cannot.
_REAL = 'hold, step and run: the plant has pacing: {}; only in lockstep its time can be held'
_NO_PLANT = 'hold, step and run: nothing has been heard of a plant whose time can be held'


class Controls:
    """
    Buttons and fields in the current container of the page.

    Parameters
    ----------
    gui : GuiApi
    names : sequence of str
        The joints.
    ask : callable
        Called with a word and its arguments, in a thread of the server: ``set`` node, name, value;
        ``enable`` on; ``reset``; ``push`` joint number, torque, duration; ``hold``, ``step``
        samples, ``run``.

    """

    def __init__(self, gui: Any, names: Sequence[str], ask: Callable[..., None]) -> None:
        self._gui, self._ask = gui, ask
        self._fields: dict[tuple[str, str], Any] = {}
        self._values: dict[tuple[str, str], str] = {}
        self._folder = gui.add_folder('controls')
        with self._folder:
            self._torques()
            self._send()
            self._push(names)
            self._time()

    def _torques(self) -> None:
        group = self._gui.add_button_group('torques', ('enable', 'disable', 'reset'))

        def clicked(event: Any) -> None:
            if event.target.value == 'reset':
                self._ask('reset')
            else:
                self._ask('enable', event.target.value == 'enable')
        group.on_click(clicked)

    def _send(self) -> None:
        for title, node, name in FIELDS:
            self._fields[node, name] = self._gui.add_text(title, '')
        button = self._gui.add_button('set what was edited')

        def clicked(_event: Any) -> None:
            for (node, name), field in self._fields.items():
                if field.value != self._values.get((node, name), ''):
                    self._ask('set', node, name, field.value)
        button.on_click(clicked)

    def _push(self, names: Sequence[str]) -> None:
        joint = self._gui.add_dropdown('push on', tuple(names))
        torque = self._gui.add_number('torque [N·m]', 50.0, step=1.0)
        lasts = self._gui.add_number('duration [s]', 0.2, min=0.0, max=10.0, step=0.05)
        self._gui.add_button('push').on_click(lambda _: self._ask(
            'push', list(names).index(joint.value), float(torque.value), float(lasts.value)))

    def _time(self) -> None:
        steps = self._gui.add_number('samples a step', 1, min=1, max=100_000, step=1)
        # Single ones: viser cannot disable a group.
        self._time_inputs = [steps, *map(self._gui.add_button, ('hold', 'step', 'run'))]
        for button in self._time_inputs[1:]:
            button.on_click(lambda event: self._ask(event.target.label, int(steps.value)))
        self._reason = self._gui.add_html('')

    def update(self, parameters: Mapping[str, Mapping[str, Any]]) -> None:
        """Show values in force where they have changed, and what they do not allow."""
        for (node, name), field in self._fields.items():
            value = parameters.get(node, {}).get(name)
            if value is None:
                continue
            text = in_field(value)
            if self._values.get((node, name)) != text:
                self._values[node, name] = field.value = text
        pacing = parameters.get('plant', {}).get('pacing')
        for widget in self._time_inputs:
            if widget.disabled != (pacing != 'lockstep'):
                widget.disabled = pacing != 'lockstep'
        reason = '' if pacing == 'lockstep' else (
            _NO_PLANT if pacing is None else _REAL.format(pacing))
        self._reason.content = str(fragment(_REASON, reason=reason)) if reason else ''

    def remove(self) -> None:
        """Take them from the page."""
        self._folder.remove()


def numbers(text: str, count: int) -> list[float] | str:
    """
    Return the numbers in a field: one, or one for each of `count` joints; else the text itself.

    The service then refuses it and says why.
    """
    try:
        values = [float(word) for word in text.replace('[', ' ').replace(']', ' ')
                  .replace(',', ' ').split()]
    except ValueError:
        return text
    if not values:
        return text
    return values * count if len(values) == 1 else values
