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

"""Recorded runs: their page, which gets all samples once, and their export as one file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
import time
from typing import Any

from ctc_chattering.analysis.markup import component
from ctc_chattering.analysis.markup import page as page_of
from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.signals import by_times, coded, packed, SignalOrigin
from ctc_chattering.errors import CtcError
from ctc_chattering.live.page import Page, scripts
from ctc_chattering.live.page_socket import Message, word
from ctc_chattering.live.skeleton import as_json, places, Skeleton, skeleton_of, stage
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.output_files import write_text
import numpy as np

#: Between two pictures of the arm [s].
_FRAME = 1 / 30
#: Samples of a run, evenly spaced, that the camera shows.
_SEEN = 40
#: What is taken at most for the time in which a motion settles [s].
_SETTLED = 1.0
#: Most samples of a run in the file; of more, every so many-th is taken.
_MOST = 60_000


class RecordedRun:
    """
    The samples of a run.

    Parameters
    ----------
    result : Result
        As `read_bag` returns it.

    Attributes
    ----------
    result : Result
    about : dict of str to Any
        ``name`` of the bag, ``laws``: from when on [s] which law and switching was in force, and
        whether torques stand at times of reception (``received``).
    skeleton : Skeleton or None
        None for a model without a description, or with one that cannot be drawn.
    remark : str
        Why it cannot; else empty.
    tracks : list of (ndarray, dict of str to ndarray)
        Signals of the same times together: times, and values by name.
    begin, end : float
        Times of the first and of the last sample [s].
    settled : float
        Time after which errors and torques that were large at the start are small [s].

    """

    def __init__(self, result: Result) -> None:
        t = result.run.t
        self.result = result
        self.about: dict[str, Any] = {
            # The name of a file may have bytes that are no text.
            'name': (result.source or result.label).encode('utf-8', 'replace').decode(),
            'received': result.torque.received,
            'laws': [(begin, config.law + (f', {config.switching}' if config.takes('switching')
                                           else '')) for begin, config in result.configs]}
        self.skeleton: Skeleton | None = None
        self.remark = ''
        try:
            self.skeleton = skeleton_of(result.config, result.description)
        except CtcError as error:
            self.remark = f'no picture of the arm: {error}'
        self.begin, self.end = float(t[0]), float(t[-1])
        self.settled = self.begin + min(_SETTLED, 0.2 * (self.end - self.begin))
        self.tracks = by_times(result.signals)

    def at(self, t: float) -> tuple[Array, Array]:
        """Return q and q_d at a time, that of the last sample before it, each of shape (n,)."""
        run = self.result.run
        # The slider's times are rounded to a millisecond, and a sum of steps.
        k = max(0, int(np.searchsorted(run.t, t + 5e-7, side='right')) - 1)
        return run.q[k], run.q_d[k]


def _note(run: RecordedRun) -> str:
    """Return what is drawn of a run."""
    recorded, computed = ([name for name, x in run.result.signals.items() if x.origin is origin]
                          for origin in (SignalOrigin.RECORDED, SignalOrigin.COMPUTED))
    times = ', torques when they were received' if run.result.torque.received else ''
    return (f'Drawn of {run.about["name"]}: every sample{times}; recorded: {", ".join(recorded)}; '
            f'computed exactly: {", ".join(computed)}.')


def check_comparable(runs: Sequence[RecordedRun]) -> None:
    """
    Raise unless runs can be shown side by side.

    Raises
    ------
    CtcError
        If they are of different joints.

    """
    names = [run.result.joint_names for run in runs]
    if len(set(names)) > 1:
        raise CtcError('the bags have different joints: ' + '; '.join(map(', '.join, names)))


class BagPage:
    """
    One or two recorded runs; the browser plays them, and says which time it shows.

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
        check_comparable(runs)
        self._page, self._runs = page, runs
        self._begin, self._end = min(run.begin for run in runs), max(run.end for run in runs)
        self._t = self._begin
        self._arms = page.show_arms([run.skeleton for run in runs])
        self._look()
        self._shown: Any = None
        page.socket.on('seek', float, self._seek)
        page.socket.on('fit', None, lambda _: self._look())

    def _look(self) -> None:
        """Have cameras show the motion."""
        points = []
        for arm, run in zip(self._arms, self._runs):
            if arm is not None:
                rows = slice(None, None, len(run.result.run.t) // _SEEN + 1)
                points.append(arm.points((*run.result.run.q[rows], *run.result.run.q_d[rows])))
        if points:
            self._page.cameras.look(np.concatenate(points))

    def _seek(self, t: float) -> None:
        """Go to a time that a browser shows."""
        self._t = min(max(self._begin, t), self._end)

    def update(self) -> None:
        """Show what has changed."""
        self._page.socket.poll(self._greeting)
        shown = self._t, self._page.magnified
        if shown == self._shown:
            return
        self._shown = shown
        with self._page.server.atomic():
            for arm, run in zip(self._arms, self._runs):
                if arm is not None:
                    arm.magnified = self._page.magnified
                    arm.show(*run.at(self._t))
        self._page.socket.tell(mark=self._t)

    def _greeting(self) -> Iterator[Message]:
        """Yield what a new page gets: all samples."""
        first = self._runs[0].result
        yield word(show={
            'joints': first.joint_names, 'units': first.position_units,
            'runs': [run.about for run in self._runs], 'time': (self._begin, self._end),
            'options': {'signals': ('e', 'V', 'torque'),
                        'settled': max(run.settled for run in self._runs)},
            'note': ' '.join(map(_note, self._runs))})
        for r, run in enumerate(self._runs):
            for t, signals in run.tracks:
                yield packed(t, signals, run=r)

    def run(self, stop: Sequence[int]) -> None:
        """Serve until a signal is in `stop`."""
        while not stop:
            time.sleep(_FRAME)
            self.update()


def write_export(runs: Sequence[RecordedRun], path: Path) -> int:
    """
    Write the page.

    Parameters
    ----------
    runs : sequence of RecordedRun
        One or two, of the same joints.
    path : Path
        File to write.

    Returns
    -------
    int
        Its size [bytes].

    Raises
    ------
    CtcError
        If the runs cannot be compared, or the file cannot be written.

    """
    check_comparable(runs)
    text = page_of('ctc_chattering.live', 'export.html', component=component(),
                   title=' and '.join(run.about['name'] for run in runs), data=_data(runs),
                   scripts=scripts(('numbers.js', 'player.js', 'arm.js')))
    write_text(path, text)
    return len(text.encode())


def _data(runs: Sequence[RecordedRun]) -> dict[str, Any]:
    """Return what the scripts of the page read."""
    reach, floor = stage(run.skeleton for run in runs)
    every = [-(-len(run.result.run.t) // _MOST) for run in runs]
    return {
        'joints': runs[0].result.joint_names, 'units': runs[0].result.position_units,
        'reach': reach, 'floor': floor, 'begin': min(run.begin for run in runs),
        'end': max(run.end for run in runs), 'settled': max(run.settled for run in runs),
        'every': every, 'runs': [_run(*given) for given in zip(
            runs, places(len(runs), reach), every)]}


def _run(run: RecordedRun, place: Sequence[float], every: int) -> dict[str, Any]:
    part = slice(None, None, every)
    return {
        **run.about, 'place': place,
        'bodies': [] if run.skeleton is None else as_json(run.skeleton),
        'packed': [
            coded(t[part], {name: values[part] for name, values in signals.items()})
            for t, signals in run.tracks]}
