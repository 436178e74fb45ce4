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

"""HTML pages of results, without any external resource, and that of an experiment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import os
from pathlib import Path
from typing import Any

from ctc_chattering.analysis import markup
from ctc_chattering.analysis.drawing import FigureFile
from ctc_chattering.analysis.metrics import BAND
from ctc_chattering.analysis.output import finite, write_text
from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.run_names import colours, gains, names

#: Columns of the table, per run and per joint: key, heading, unit.
RUN_COLUMNS = (('max_error_norm1_rad', 'Largest Σ |eᵢ|', 'rad'),
               ('reaching_time_s', 'v reached', 's'))
JOINT_COLUMNS = (('rms_error_rad', 'RMS error', 'rad'), ('rms_torque_nm', 'RMS torque', 'N·m'),
                 ('torque_variation_nm_per_s', 'Torque variation', 'N·m/s'),
                 ('max_torque_step_nm', 'Largest torque step', 'N·m'),
                 ('max_torque_rate_nm_per_s', 'Largest torque rate', 'N·m/s'))
_LARGEST = 'max_error_norm1_rad'
_TITLE = 'Computed torque plus compensation plus chattering'
_LEAD = ('A robot arm with friction that the controller does not know, under computed torque\n'
         'plus compensation, under the same law plus a chattering term Ka sgn(v), or under '
         'others.')
#: Templates, in this package.
_PAGE, _RUNS = 'page.html', 'runs.html'
#: A run under chattering, its metrics, and those of the experiment under compensation.
Pair = tuple[Result, dict[str, Any], dict[str, Any]]


def write_page(results: Sequence[Result], figures: Sequence[FigureFile], path: Path,
               bags: Sequence[str] = ()) -> None:
    """
    Write a page with the results: metrics, then all figures.

    Parameters
    ----------
    results : sequence of Result
        Rows of the table; ``metrics.json`` with their numbers is beside the page.
    figures : sequence of FigureFile
        As `save_figures` returns them; linked relative to the page, the first at the top.
    path : Path
        The page, for example ``out/index.html``.
    bags : sequence of str
        Path of each result's bag relative to the page; left out for no links.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    runs = [{**finite(result.metrics()), 'name': name}
            for result, name in zip(results, names(results))]
    pairs = _pairs(results, runs)
    write_sections(
        path, _headline(pairs), figures,
        [('metrics.json', 'metrics.json'), *(
            (bag, f'bag of {run["name"]}') for run, bag in zip(runs, bags))],
        template=_RUNS, pairs=pairs, reachings=list(_reachings(results, runs)), largest=_LARGEST,
        factor=_factor, run_columns=RUN_COLUMNS, joint_columns=JOINT_COLUMNS, band=f'{BAND:g}',
        rows=list(zip(results, runs, colours(results), map(gains, results))),
        window=runs[0]['window_s'] if any(run['rms_error_rad'] for run in runs) else None)


def write_sections(path: Path, headline: str, figures: Sequence[FigureFile],
                   links: Sequence[tuple[str, str]], lead: str = _LEAD,
                   package: str = 'ctc_chattering.analysis', template: str = _PAGE,
                   **values: Any) -> None:
    """
    Write a page; everything is text, and escaped, unless it is `Markup`.

    Parameters
    ----------
    path : Path
        The page.
    headline, lead : str
        Its title, and what it is about.
    figures : sequence of FigureFile
        Linked relative to the page, the first at the top.
    links : sequence of (str, str)
        To data: path relative to the page, and text.
    package, template : str
        What extends ``page.html`` of this package, or that itself.
    **values : Any
        What the template names. ``page.html`` shows `attention`, texts, `tables`, as `Table` has
        them, and `lists`, pairs of title and texts, where they are given.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    write_text(path, markup.page(package, template, **{
        'attention': (), 'tables': (), 'lists': (), 'title': _TITLE, 'headline': headline,
        'lead': lead, 'links': links, 'figures': [
            {'url': Path(os.path.relpath(x.path, path.parent)).as_posix(), 'title': x.title,
             'caption': x.caption} for x in figures], **values}))


def _factor(before: float | None, after: float | None) -> str:
    """Return by what factor `after` is smaller or larger."""
    if before is None or after is None:
        return 'unknown'
    if before == after:
        return 'the same'
    if not after or not before:
        return 'zero' if not after else 'no longer zero'
    ratio = max(before / after, after / before)
    text = f'{ratio:.2g}' if ratio < 9.95 else f'{ratio:,.0f}'
    return f'{text}× {"smaller" if after < before else "larger"}'


def _pairs(results: Sequence[Result], runs: Sequence[dict[str, Any]]) -> list[Pair]:
    """Return each run under another law only, with its metrics and those under compensation."""
    whole = [(result, run) for result, run in zip(results, runs)
             if not result.changes and run[_LARGEST] is not None]
    base = {result.experiment: run for result, run in reversed(whole)
            if result.law == 'compensation'}
    return [(result, run, base[result.experiment]) for result, run in whole
            if result.law != 'compensation' and result.experiment in base]


def _headline(pairs: Sequence[Pair]) -> str:
    if not pairs:
        return _TITLE
    result, run, base = pairs[0]
    return (f'With {result.law} the largest tracking error is '
            f'{_factor(base[_LARGEST], run[_LARGEST])} ({result.experiment})')


def _reachings(results: Sequence[Result], runs: Sequence[dict[str, Any]]
               ) -> Iterator[tuple[str, float, str, float]]:
    """Yield name, time and law of a change after which v reached 0, and how long that took."""
    for result, run in zip(results, runs):
        reached = run['reaching_time_s']
        if result.changes and reached is not None and reached > result.changes[-1][0]:
            time, law = result.changes[-1]
            yield run['name'], time, law, reached - time
