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
Samples of runs as scripts for plots of a page.

`write_samples` writes them for `run_page.write_page`. A page does not hold more than `MAX_COUNT`
numbers of a run, and of long runs it holds rounded ones.
"""

from __future__ import annotations

from collections.abc import Sequence
import json
from pathlib import Path

from ctc_chattering.analysis.page import PlottedRun, SignalPlots
from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.run_names import name_runs, NamedRun
from ctc_chattering.analysis.signals import by_times, compressed, PARTS
from ctc_chattering.output_files import file_stem, write_text
from ctc_chattering.simulation.closed_loop import Array

#: Numbers of a run that a page has at most. Of longer runs it has the first samples.
MAX_COUNT = 8_000_000
#: Numbers of a run up to which they are exact.
MAX_EXACT_COUNT = 1_000_000

#: Signals of the same times: these, shape (N,) [s], and values by name.
Track = tuple[Array, dict[str, Array]]


def write_samples(results: Sequence[Result], directory: Path) -> list[SignalPlots]:
    """
    Write the samples of each run as a script.

    Plots are returned, one for each experiment.

    Parameters
    ----------
    results : sequence of Result
        Runs.
    directory : Path
        Directory of the scripts, created if necessary.

    Raises
    ------
    CtcError
        If a file cannot be written.

    """
    groups: dict[tuple[str, ...], list[NamedRun]] = {}
    for run in name_runs(results):
        key = (run.result.experiment, *run.result.joint_names, *run.result.position_units)
        groups.setdefault(key, []).append(run)
    used: set[str] = set()
    return [_write_group(group, directory, used) for group in groups.values()]


def _write_group(group: Sequence[NamedRun], directory: Path, used: set[str]) -> SignalPlots:
    """Write the samples of runs that are plotted together."""
    # The page has q from q_d and e. Beside each other, runs have no parts of the torque.
    left_out = {'q', *(PARTS if len(group) > 1 else ())}
    plotted, cut_off, rounded = [], [], []
    for result, name, colour in group:
        tracks = by_times({x: y for x, y in result.signals.items() if x not in left_out})
        tracks, end = _first_samples(tracks)
        is_rounded = _count(tracks) > MAX_EXACT_COUNT
        path = directory / f'{file_stem(str(name), used)}.js'
        texts = [compressed(t, values, is_rounded) for t, values in tracks]
        write_text(path, f'ctcSamples[{json.dumps(path.stem)}] = {json.dumps(texts)};\n')
        plotted.append(PlottedRun(name.short, path, colour, result.torque.received))
        if end < result.t[-1]:
            cut_off.append(f'{name} to {end:.4g} s')
        if is_rounded:
            rounded.append(str(name))
    first = group[0].result
    # The start, with its large errors, does not scale the axes.
    settled = min(first.window[0], 0.4 * float(first.t[-1]))
    marks = {time for run in group for time, _ in run.result.marks}
    mark = marks.pop() if len(marks) == 1 else None
    return SignalPlots(
        f'Signals of {first.experiment}',
        _caption(settled, mark is not None, rounded, cut_off),
        first.joint_names,
        first.position_units,
        plotted,
        ('e', 'torque', 'V'),
        settled,
        mark,
    )


def _caption(
    settled: float, has_mark: bool, rounded: Sequence[str], cut_off: Sequence[str]
) -> str:
    """
    Return the caption of plots.

    Axes leave out the start up to `settled` [s].
    """
    text = (
        'Error e = q_d − q, torque sent, V and further signals. The table below lists the '
        f'times and the origin of each. While times after {2.0 * settled:.3g} s are shown, '
        f'the axes are scaled without the first {settled:.3g} s.'
    )
    if rounded:
        text += (
            f' Values of {", ".join(rounded)} are rounded by at most 2e-5 of each, and times '
            'to 1 µs.'
        )
    if cut_off:
        text += (
            f' Too long to show completely: {", ".join(cut_off)}. The figures below show the '
            'whole run, and `ctc export` writes it.'
        )
    if has_mark:
        text += ' The line marks the change of law or switching.'
    return text


def _count(tracks: Sequence[Track]) -> int:
    """Return the number of numbers in tracks."""
    return sum(t.size + sum(y.size for y in values.values()) for t, values in tracks)


def _first_samples(tracks: list[Track]) -> tuple[list[Track], float]:
    """Return the first `MAX_COUNT` numbers, and their end [s]."""
    begin = min(float(t[0]) for t, _ in tracks)
    end = max(float(t[-1]) for t, _ in tracks)
    count = _count(tracks)
    if count <= MAX_COUNT:
        return tracks, end
    end = begin + (end - begin) * MAX_COUNT / count
    return [
        (t[t <= end], {name: y[t <= end] for name, y in values.items()})
        for t, values in tracks
        if t[0] <= end
    ], end
