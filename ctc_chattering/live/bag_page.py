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
Page of recorded runs, and its export as a file.

`ctc live BAG` serves a `BagPage`. The browser gets all samples once and plays them. It sends the
time that it shows. `ctc live BAG --export` calls `write_export`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
import time
from typing import Any

from ctc_chattering.analysis.markup import component
from ctc_chattering.analysis.markup import page as render_page
from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.signals import by_times, coded, packed, SignalOrigin
from ctc_chattering.errors import CtcError
from ctc_chattering.live.page import describe_law, Page, scripts
from ctc_chattering.live.page_socket import encode_message, Message
from ctc_chattering.live.skeleton import as_json, root_positions, Skeleton, skeleton_of, stage
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.output_files import write_text
import numpy as np

#: Time between two pictures of the arm [s].
_ARM_PERIOD_S = 1 / 30
#: Times are rounded to a millisecond, so a sample is taken as of a little before its time [s].
_TIME_TOLERANCE_S = 5e-7
#: Samples of a run in an exported file. Of a longer run every so many-th is taken.
_MAX_EXPORTED = 60_000


class RecordedRun:
    """
    Samples of a run.

    Parameters
    ----------
    result : Result
        The run, as `read_bag` returns it.

    Attributes
    ----------
    result : Result
    about : dict of str to Any
        ``name`` of the bag, its ``laws`` with the times from which on they were in force [s], and
        ``received``: True if torques have times of reception.
    skeleton : Skeleton or None
        Shapes of the arm. None without a description that can be drawn.
    remark : str
        Reason why it cannot be drawn, or an empty text.
    tracks : list of (ndarray, dict of str to ndarray)
        Times [s], and the signals that have them, by name.
    begin, end : float
        Times of the first and of the last sample [s].
    settled : float
        Time after which errors and torques of the start have faded [s].

    """

    def __init__(self, result: Result) -> None:
        self.result = result
        self.about: dict[str, Any] = {
            # The name of a file may have bytes that are no text.
            'name': (result.source or result.label).encode('utf-8', 'replace').decode(),
            'received': result.torque.received,
            'laws': [(begin, describe_law(config)) for begin, config in result.configs]}
        self.skeleton: Skeleton | None = None
        self.remark = ''
        try:
            self.skeleton = skeleton_of(result.config, result.description)
        except CtcError as error:
            self.remark = f'the arm cannot be drawn: {error}'
        self.begin = float(result.run.t[0])
        self.end = float(result.run.t[-1])
        # A motion settles within a second, or a fifth of a short run.
        self.settled = self.begin + min(1.0, 0.2 * (self.end - self.begin))
        self.tracks = by_times(result.signals)

    def positions(self, t: float) -> tuple[Array, Array]:
        """Return q and q_d at a time, each of shape (n,)."""
        run = self.result.run
        samples = int(np.searchsorted(run.t, t + _TIME_TOLERANCE_S, side='right'))
        sample = max(0, samples - 1)
        return run.q[sample], self.result.q_d[sample]

    def note(self) -> str:
        """Return a line on the origin of the signals."""
        signals = self.result.signals
        recorded, computed = (
            ', '.join(name for name, x in signals.items() if x.origin is origin)
            for origin in (SignalOrigin.RECORDED, SignalOrigin.COMPUTED))
        torques = ' Torques have the times at which they were received.' * self.about['received']
        return (f'The plots show every sample of {self.about["name"]}.{torques} Recorded: '
                f'{recorded}. Computed exactly from them: {computed}.')


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
        joints = '; '.join(map(', '.join, names))
        raise CtcError(f'the bags have different joints, so they cannot be compared: {joints}')


class BagPage:
    """
    Page of recorded runs.

    Parameters
    ----------
    page : Page
    runs : sequence of RecordedRun
        One or two runs of the same joints.

    Raises
    ------
    CtcError
        If the runs cannot be compared.

    """

    def __init__(self, page: Page, runs: Sequence[RecordedRun]) -> None:
        check_comparable(runs)
        self._page = page
        self._runs = runs
        self._begin = min(run.begin for run in runs)
        self._end = max(run.end for run in runs)
        self._t = self._begin
        self._arms = page.show_arms([run.skeleton for run in runs])
        self._fit_view()
        #: Time and magnification that are shown.
        self._shown: Any = None
        page.socket.on('seek', float, self._on_seek)
        page.socket.on('fit', None, lambda _: self._fit_view())

    def _fit_view(self) -> None:
        """Show the whole motion."""
        points = []
        for arm, run in zip(self._arms, self._runs):
            if arm is not None:
                samples = run.result
                every = slice(None, None, len(samples.t) // 40 + 1)
                points.append(arm.points((*samples.q[every], *samples.q_d[every])))
        if points:
            self._page.cameras.look(np.concatenate(points))

    def _on_seek(self, t: float) -> None:
        self._t = min(max(self._begin, t), self._end)

    def update(self) -> None:
        """Show what has changed."""
        self._page.socket.poll(self._greet)
        magnification = self._page.magnification
        if (self._t, magnification) == self._shown:
            return
        self._shown = self._t, magnification
        with self._page.server.viser.atomic():
            for arm, run in zip(self._arms, self._runs):
                if arm is not None:
                    arm.show(*run.positions(self._t), magnification)
        self._page.socket.send(mark=self._t)

    def _greet(self) -> Iterator[Message]:
        """Yield all samples, for a new page."""
        yield encode_message(show={
            **_joints(self._runs),
            'runs': [run.about for run in self._runs],
            'time': (self._begin, self._end),
            'options': {'signals': ('e', 'V', 'torque'), 'settled': _settled(self._runs)},
            'note': ' '.join(run.note() for run in self._runs)})
        for r, run in enumerate(self._runs):
            for t, signals in run.tracks:
                yield packed(t, signals, run=r)

    def run(self, stop: Sequence[int]) -> None:
        """Serve until a signal is in `stop`."""
        while not stop:
            time.sleep(_ARM_PERIOD_S)
            self.update()


def _joints(runs: Sequence[RecordedRun]) -> dict[str, Any]:
    return {'joints': runs[0].result.joint_names, 'units': runs[0].result.position_units}


def _settled(runs: Sequence[RecordedRun]) -> float:
    return max(run.settled for run in runs)


def write_export(runs: Sequence[RecordedRun], path: Path) -> int:
    """
    Write the page into one file, and return its size [bytes].

    Parameters
    ----------
    runs : sequence of RecordedRun
        One or two runs of the same joints.
    path : Path
        File to write.

    Raises
    ------
    CtcError
        If the runs cannot be compared, or the file cannot be written.

    """
    check_comparable(runs)
    text = render_page(
        'ctc_chattering.live',
        'export.html',
        title=' and '.join(run.about['name'] for run in runs),
        component=component(),
        data=_export(runs),
        scripts=scripts('numbers.js', 'player.js', 'arm.js'))
    write_text(path, text)
    return len(text.encode())


def _export(runs: Sequence[RecordedRun]) -> dict[str, Any]:
    """Return the data of an exported page."""
    reach, floor = stage(run.skeleton for run in runs)
    steps = [-(-len(run.result.run.t) // _MAX_EXPORTED) for run in runs]
    roots = root_positions(len(runs), reach)
    return {
        **_joints(runs),
        'reach': reach,
        'floor': floor,
        'begin': min(run.begin for run in runs),
        'end': max(run.end for run in runs),
        'settled': _settled(runs),
        'every': steps,
        'runs': [_export_run(*values) for values in zip(runs, roots, steps)]}


def _export_run(run: RecordedRun, root: Sequence[float], step: int) -> dict[str, Any]:
    """Return the data of a run."""
    tracks = [
        coded(t[::step], {name: values[::step] for name, values in signals.items()})
        for t, signals in run.tracks]
    bodies = as_json(run.skeleton) if run.skeleton else []
    return {**run.about, 'place': root, 'bodies': bodies, 'packed': tracks}
