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
Page of runs, with figures, numbers and samples.

`write_runs` writes all of it for `ctc plot`, `ctc reproduce` and the public API.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
import os
from pathlib import Path
from typing import Any, NamedTuple

from ctc_chattering.analysis import page
from ctc_chattering.analysis.markup import fragment, Markup
from ctc_chattering.analysis.metrics import BAND
from ctc_chattering.analysis.page import FigureFile
from ctc_chattering.analysis.result import METRICS, Result, write_metrics
from ctc_chattering.analysis.run_names import gains_text, name_runs
from ctc_chattering.analysis.run_samples import write_samples
from ctc_chattering.analysis.signals import PARTS, Series, SignalOrigin
from ctc_chattering.analysis.tables import Table
from ctc_chattering.control.laws.registry import BASELINE_LAW
from ctc_chattering.errors import ParameterError
from ctc_chattering.output_files import check_format, finite
from ctc_chattering.output_folder import new_folder
from ctc_chattering.parameters import check_not_empty

#: The command that writes runs.
PLOT = 'ctc plot'
#: The page in the directory of `write_runs`.
PAGE = 'index.html'
#: Signals that are terms of the law.
_TERMS = ('v', 'V', *PARTS)
#: Names of signals in the table of origins.
_SIGNALS = {
    'q': 'position q',
    'dq': 'velocity dq',
    'q_d': 'reference q_d',
    'e': 'error e',
    'torque': 'torque sent',
    'v': 'filtered error v',
    'V': 'V',
    'nominal': 'nominal',
    'compensation': 'compensation',
    'robust': 'robust',
}


class Column(NamedTuple):
    """Column of the table: key of the metrics, heading, unit."""

    key: str
    heading: str
    unit: str


LARGEST_ERROR = 'max_error_norm1_rad'
RUN_COLUMNS = (
    Column(LARGEST_ERROR, 'Largest Σ |eᵢ|', 'rad'),
    Column('reaching_time_s', 'v reached', 's'),
)
JOINT_COLUMNS = (
    Column('rms_error_rad', 'RMS error', 'rad'),
    Column('rms_torque_nm', 'RMS torque', 'N·m'),
    Column('torque_variation_nm_per_s', 'Torque variation', 'N·m/s'),
    Column('max_torque_step_nm', 'Largest torque step', 'N·m'),
    Column('max_torque_rate_nm_per_s', 'Largest torque rate', 'N·m/s'),
)


class PageRun(NamedTuple):
    """
    Run of the page.

    Attributes
    ----------
    result : Result
        The run.
    name, colour : str
        Name and colour among all runs of the page.
    metrics : dict
        Numbers of the run, as `Result.metrics` returns them, with None for what is not finite.

    """

    result: Result
    name: str
    colour: str
    metrics: dict[str, Any]


def write_page(
    results: Sequence[Result],
    figures: Sequence[FigureFile],
    path: Path,
    bags: Sequence[str] = (),
    plots: Sequence[page.SignalPlots] = (),
    command: str = '',
) -> None:
    """
    Write a page with the results.

    Parameters
    ----------
    results : sequence of Result
        Rows of the table. Their ``metrics.json`` is beside the page.
    figures : sequence of FigureFile
        Figures of `save_figures`, linked relative to the page. Those of a run are folded.
    path : Path
        The page, for example ``out/index.html``.
    bags : sequence of str
        Path of each result's bag relative to the page, or none for no links.
    plots : sequence of page.SignalPlots
        Plots of `write_samples`.
    command : str
        The command line that the page shows, or ''.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    runs = [
        PageRun(x.result, str(x.name), x.colour, finite(x.result.metrics()))
        for x in name_runs(results)
    ]
    cards = list(_error_ratios(runs))
    folded = [
        page.Folded(name, list(of_run), len(results) == 1)
        for name, of_run in groupby(figures, lambda x: x.group)
        if name
    ]
    headline = 'Computed torque plus compensation plus chattering'
    if cards:
        result = cards[0].result
        headline = f'With {result.law} the largest tracking error is {cards[0].factor}'
        headline += f' ({result.experiment})'
    page.write_page(
        path,
        headline,
        'A robot arm has friction that the controller does not know. It runs under computed '
        'torque plus compensation, under the same law plus a chattering term Ka sgn(v), or under '
        'other laws.',
        [
            page.Section(
                'Result',
                [
                    *([page.Cards([x.card() for x in cards])] if cards else []),
                    *(x for x in figures if not x.group),
                ],
            ),
            page.Section('Signals', [*plots, origins_table(runs)] if plots else []),
            page.Section(
                'Numbers',
                [
                    numbers_table(runs),
                    *(
                        page.Note(f'{text}.', f'{run.name}:')
                        for run in runs
                        for text in run.metrics['notes']
                    ),
                ],
            ),
            page.Section('Figures of each run', folded),
        ],
        [(METRICS, METRICS), *((bag, f'bag of {run.name}') for run, bag in zip(runs, bags))],
        command,
    )


class _ErrorRatio(NamedTuple):
    """Largest error of a run, and that under compensation."""

    result: Result
    name: str
    error: float
    base_error: float

    @property
    def factor(self) -> str:
        """Factor of the errors in words."""
        if self.error == self.base_error:
            return 'the same'
        if not self.error or not self.base_error:
            return 'no longer zero' if self.error else 'zero'
        ratio = max(self.base_error / self.error, self.error / self.base_error)
        if ratio < 1.05:
            return 'about the same'
        word = 'smaller' if self.error < self.base_error else 'larger'
        return f'{ratio:.{0 if ratio > 9.95 else 1}f}× {word}'

    def card(self) -> page.Card:
        """Return the card with both errors."""
        unit = self.result.position_units[0]
        return page.Card(
            self.name,
            self.factor,
            [
                f'Largest error: {self.base_error:.3g} {unit} under {BASELINE_LAW} → '
                f'{self.error:.3g} {unit} with {self.result.law}.'
            ],
        )


def _error_ratios(runs: Sequence[PageRun]) -> Iterator[_ErrorRatio]:
    """
    Yield runs that can be compared with compensation.

    They are under one other law, and their experiment has both.
    """
    under_one_law = [
        run for run in runs if not run.result.changes and run.metrics[LARGEST_ERROR] is not None
    ]
    base_errors = {
        run.result.experiment: run.metrics[LARGEST_ERROR]
        for run in reversed(under_one_law)
        if run.result.law == BASELINE_LAW
    }
    for run in under_one_law:
        base_error = base_errors.get(run.result.experiment)
        if run.result.law != BASELINE_LAW and base_error is not None:
            yield _ErrorRatio(run.result, run.name, run.metrics[LARGEST_ERROR], base_error)


def origins_table(runs: Sequence[PageRun]) -> Table:
    """
    Return the table of the signals' origins.

    A run has a row for each origin.
    """
    rows: list[list[str]] = []
    for run in runs:
        groups: dict[tuple[str, ...], list[str]] = {}
        for signal, series in run.result.signals.items():
            groups.setdefault(_origin(run.result, signal, series), []).append(_SIGNALS[signal])
        rows += [
            ['' if k else run.name, ', '.join(signals), *origin]
            for k, (origin, signals) in enumerate(groups.items())
        ]
    heads = ['Run', 'Signals', 'Origin', 'From', 'Samples', 'Usual step']
    return Table('Origin of the samples', heads, rows, 4)


def _origin(result: Result, signal: str, series: Series) -> tuple[str, ...]:
    """Return origin, source, count and step of a signal."""
    if series.origin is SignalOrigin.UNKNOWN:
        return series.origin.value, '', '', ''
    source = result.topics.get(signal, 'simulation')
    if series.received:
        source += ', each when the recorder received it'
    elif result.replay and series.origin is SignalOrigin.COMPUTED and signal in _TERMS:
        source += '; the law reproduces every recorded torque and term'
    step = f'{1e3 * series.step:.3g} ms' if series.step else ''
    return series.origin.value, source, str(len(series.t)), step


def numbers_table(runs: Sequence[PageRun]) -> Table:
    """
    Return the table of numbers, a row a joint.

    Numbers of the whole run are in its first row.
    """
    rows: list[list[str]] = []
    for run in runs:
        result, numbers = run.result, run.metrics
        title = fragment(
            '<i class="dot" style="background: {{ run.colour }}"></i>{{ run.name }}<br><small>'
            '{% if run.result.source %}bag {{ run.result.source }}; {% endif %}{{ gains }}'
            '</small>',
            run=run,
            gains=gains_text(result),
        )
        of_run = [_cell(result, 0, numbers[x.key], x.unit) for x in RUN_COLUMNS]
        for i, joint in enumerate(result.joint_names):
            of_joint = [
                _cell(result, i, numbers[x.key] and numbers[x.key][i], x.unit)
                for x in JOINT_COLUMNS
            ]
            rows.append(
                ['', joint, *[''] * len(of_run), *of_joint]
                if i
                else [title, joint, *of_run, *of_joint]
            )
    heads = [
        fragment('{{ x.heading }}<br><small>[{{ x.unit }}]</small>', x=x)
        for x in (*RUN_COLUMNS, *JOINT_COLUMNS)
    ]
    return Table('', ['Run', 'Joint', *heads], rows, 2, _note_on_numbers(runs))


def _note_on_numbers(runs: Sequence[PageRun]) -> str:
    """Return definitions of the numbers, with their times."""
    windows = {
        tuple(run.metrics['window_s']): run.name for run in runs if run.metrics['rms_error_rad']
    }
    times = [
        f'{begin:.4g} s to {end:.4g} s' + (f' ({name})' if len(windows) > 1 else '')
        for (begin, end), name in windows.items()
    ]
    note = f'Errors and torques are computed over t = {", ".join(times)}. ' if times else ''
    return note + (
        f'“v reached” is the time from which every |vᵢ| stays within {BAND:g} rad/s to the end. '
        'Torque variation is Σ |Δτ| per second. Step and rate are from one sample to the next.'
    )


def _cell(result: Result, joint: int, number: float | None, unit: str) -> Markup:
    """
    Return a number for a cell.

    It has its unit if a prismatic joint has another than the heading.
    """
    if result.position_units[joint] == 'rad' or unit == 's':
        unit = ''
    return fragment(
        '{{ number | number }}{% if unit %} <small>{{ unit }}</small>{% endif %}',
        number=number,
        unit=unit.replace('rad', 'm').replace('N·m', 'N'),
    )


def write_runs(
    results: Sequence[Result],
    out: str | Path,
    bags: Sequence[str | Path] = (),
    extra: str = 'svg',
    command: str = '',
    overwrite: bool = False,
) -> None:
    """
    Write figures, numbers and a page with plots.

    Runs are compared on the page.

    Parameters
    ----------
    results : sequence of Result
        Runs of `simulate` and `read_bag`.
    out : str or Path
        Directory for ``index.html``, ``metrics.json``, ``figures``, ``samples``.
    bags : sequence of str or Path
        The bag of each result, to which the page links, or none for no links.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        The command line that the page shows, or ''.
    overwrite : bool
        Replace what an earlier call has written there.

    Raises
    ------
    CtcError
        If there is no result, a run has no samples, other files are there, or one cannot be
        written.

    """
    check_not_empty('results', results)
    if len(bags) not in (0, len(results)):
        raise ParameterError('bags', bags, f'none, or {len(results)}, one of each result')
    check_format(extra)
    links = [os.path.relpath(bag, out) for bag in bags]
    with new_folder(Path(out), PLOT, overwrite) as folder:
        fill_folder(results, folder, links, extra, command)


def fill_folder(
    results: Sequence[Result],
    folder: Path,
    links: Sequence[str],
    extra: str = 'svg',
    command: str = '',
) -> None:
    """
    Write the files of `write_runs`.

    The page has these links to the bags.
    """
    from ctc_chattering.analysis.run_figures import save_figures  # Takes time.

    figures = save_figures(results, folder / 'figures', extra)
    write_metrics(results, folder / METRICS)
    plots = write_samples(results, folder / 'samples')
    write_page(results, figures, folder / PAGE, links, plots, command)
