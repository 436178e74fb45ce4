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

"""Recorded runs as one HTML file: it opens from a disk and needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.interactive_plots import coded, component
from ctc_chattering.analysis.markup import page
from ctc_chattering.analysis.output import write_text
from ctc_chattering.live.bag_page import check_comparable, RecordedRun
from ctc_chattering.live.page import scripts
from ctc_chattering.live.skeleton import as_json, places, stage

#: Most samples of a run in the file; of more, every so many-th is taken.
_MOST = 60_000


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
    text = page('ctc_chattering.live', 'export.html', component=component(),
                title=' and '.join(run.about['name'] for run in runs), data=_data(runs),
                scripts=scripts(('numbers.js', 'player.js', 'arm.js')))
    write_text(path, text)
    return len(text.encode())


def _data(runs: Sequence[RecordedRun]) -> dict[str, Any]:
    """Return what the scripts of the page read."""
    reach, middle, floor = stage(run.skeleton for run in runs)
    every = [-(-len(run.result.run.t) // _MOST) for run in runs]
    return {
        'joints': runs[0].result.joint_names, 'units': runs[0].result.position_units,
        'reach': reach, 'middle': middle, 'floor': floor, 'begin': min(run.begin for run in runs),
        'end': max(run.end for run in runs), 'settled': max(run.settled for run in runs),
        'every': every, 'runs': [_run(*given) for given in zip(
            runs, places(len(runs), reach), every)]}


def _run(run: RecordedRun, place: Sequence[float], every: int) -> dict[str, Any]:
    part = slice(None, None, every)
    return {
        **run.about, 'place': place,
        'bodies': [] if run.skeleton is None else as_json(run.skeleton),
        'packed': coded(run.result.run.t[part], {
            name: values[part] for name, values in run.signals.items()})}
