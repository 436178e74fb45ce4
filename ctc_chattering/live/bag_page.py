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

"""The page over recorded runs: a slider of time, play, pause and speed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import math
import time
from typing import Any

from ctc_chattering.analysis.markup import Markup
from ctc_chattering.errors import CtcError
from ctc_chattering.live.arm_view import View
from ctc_chattering.live.page import Page
from ctc_chattering.live.recorded import check_comparable, Player, RecordedRun
from ctc_chattering.live.samples import table
from ctc_chattering.live.samples_socket import Message, word
import numpy as np

#: Between two pictures of the arm, and between two of the numbers [s].
_FRAME, _NUMBERS = 1 / 30, 0.15
#: Samples of a run, evenly spaced, that the camera shows.
_SEEN = 40
#: What "fit the view" shows before and after now [s].
_AROUND = 0.5
_SPEEDS = ('0.1', '0.25', '0.5', '1', '2', '5', '10')


class BagPage:
    """
    One or two recorded runs.

    Parameters
    ----------
    page : Page
    runs : sequence of RecordedRun
        One or two, of the same joints.

    Raises
    ------
    CtcError
        If the runs cannot be compared.

    """

    def __init__(self, page: Page, runs: Sequence[RecordedRun]) -> None:
        if reason := check_comparable(runs):
            raise CtcError(reason)
        self._page, self._runs = page, runs
        self._player = Player(max(run.end for run in runs), min(run.begin for run in runs))
        self._arms = page.show_arms([run.skeleton for run in runs])
        self._look()
        gui = page.server.gui
        with page.main:
            begin, end = self._player.begin, self._player.end
            self._slider = gui.add_slider(
                'time [s]', begin, max(end, begin + 1e-3), 0.001, begin)
            self._play = gui.add_button('play')
            self._speed = gui.add_dropdown('speed', _SPEEDS, initial_value='1')
            self._view = View(gui, self._fit)
        self._shown: tuple[Any, ...] | None = None
        self._numbered = 0.0
        self._wanted: float | None = None
        self._slider.on_update(self._on_slider)
        self._play.on_click(self._on_play)
        self._speed.on_update(self._on_speed)
        page.samples.on('seek', self._seek)

    def _look(self, seconds: float = math.inf) -> None:
        """Have cameras show the motion of so many seconds before and after now."""
        t = self._player.t
        drawn = []
        for arm, run in zip(self._arms, self._runs):
            if arm is not None:
                rows = slice(run.index(t - seconds), run.index(t + seconds) + 1)
                rows = slice(rows.start, rows.stop, (rows.stop - rows.start) // _SEEN + 1)
                drawn.append(arm.points((*run.result.run.q[rows], *run.result.run.q_d[rows])))
        if drawn:
            self._page.cameras.look(np.concatenate(drawn), len(drawn))

    def _fit(self, event: Any) -> None:
        self._look(_AROUND)
        self._page.cameras.fit(event.client)

    def _on_slider(self, event: Any) -> None:
        if event.client_id is not None:
            self._wanted = float(self._slider.value)

    def _seek(self, t: Any) -> None:
        """Go to a time that was clicked in a plot, if it is one."""
        if type(t) in (int, float) and t == t:  # Not nan.
            self._wanted = float(min(max(self._player.begin, t), self._player.end))
            self._slider.value = round(self._wanted, 3)

    def _on_play(self, _event: Any) -> None:
        if self._player.playing:
            self._player.playing = False
        else:
            self._player.play()

    def _on_speed(self, _event: Any) -> None:
        self._player.speed = float(self._speed.value)

    def update(self, elapsed: float) -> None:
        """Go on by `elapsed` seconds and show what has changed."""
        self._page.samples.poll(self._greeting)
        self._page.cameras.follow()
        player = self._player
        if self._wanted is not None:
            player.seek(self._wanted)
            self._wanted = None
        was_playing = player.playing
        player.advance(elapsed)
        label = 'pause' if player.playing else 'play'
        if self._play.label != label:
            self._play.label = label
        shown = player.t, self._view.magnified
        if shown == self._shown:
            return
        self._show_arms(was_playing)
        self._page.samples.tell(mark=player.t)
        now = time.monotonic()
        if not player.playing or now - self._numbered > _NUMBERS:
            self._numbered = now
            self._show_numbers()
            self._shown = shown

    def _show_arms(self, follow: bool) -> None:
        with self._page.server.atomic():
            for arm, run in zip(self._arms, self._runs):
                if arm is not None:
                    instant = run.at(self._player.t)
                    arm.magnified = self._view.magnified
                    arm.show(instant.q, instant.q_d)
            if follow:
                self._slider.value = round(self._player.t, 3)

    def _greeting(self) -> Iterator[Message]:
        """Yield what a new page gets: all samples."""
        first = self._runs[0].result
        yield word(show={
            'joints': first.joint_names, 'units': first.position_units,
            'runs': [run.name for run in self._runs],
            'options': {'signals': ('e', 'V', 'torque'), 'seek': True,
                        'settled': max(run.settled for run in self._runs)},
            'note': 'Drawn: every sample.'})
        for r, run in enumerate(self._runs):
            yield from run.packed(r)
        yield word(mark=self._player.t)

    def _show_numbers(self) -> None:
        t = self._player.t
        parts = [run.before(t, 1.0) for run in self._runs]
        with self._page.server.atomic():
            self._page.numbers.content = str(Markup().join(
                table(run.result.joint_names, run.at(t), part, f'{run.name}: {run.law(t)},')
                for run, part in zip(self._runs, parts)))

    def run(self, stop: Sequence[int]) -> None:
        """Serve until a signal is in `stop`."""
        last = time.monotonic()
        while not stop:
            time.sleep(_FRAME)
            now = time.monotonic()
            self.update(now - last)
            last = now
