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

"""What is written of runs: figures, numbers, samples and the page with interactive plots."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
import json
import os
from pathlib import Path
from typing import Any

from ctc_chattering.analysis import page
from ctc_chattering.analysis.markup import fragment, Markup
from ctc_chattering.analysis.metrics import BAND
from ctc_chattering.analysis.page import FigureFile
from ctc_chattering.analysis.result import (
    colours,
    gains,
    METRICS,
    names,
    Result,
    write_metrics,
)
from ctc_chattering.analysis.signals import by_times, compressed, PARTS, Series, SignalOrigin
from ctc_chattering.analysis.tables import Table
from ctc_chattering.control.laws.registry import BASELINE_LAW
from ctc_chattering.errors import ParameterError
from ctc_chattering.output_files import (
    check_format,
    file_stem,
    finite,
    new_folder,
    write_text,
)
from ctc_chattering.parameters import check_some
from ctc_chattering.simulation.closed_loop import Array

#: The command that writes runs.
PLOT = 'ctc plot'
#: Numbers of a run that a page has; of more, those of the first samples.
MOST = 8_000_000
#: Numbers of a run up to which they are exact.
MOST_EXACT = 1_000_000
#: Signals that are shown at first.
_CHOSEN = ('e', 'torque', 'V')


def write_samples(results: Sequence[Result], directory: Path) -> list[page.SignalPlots]:
    """
    Write the samples of each run as a script, and return plots: one for each experiment.

    Parameters
    ----------
    results : sequence of Result
        Runs.
    directory : Path
        Created if necessary.

    Raises
    ------
    CtcError
        If a file cannot be written.

    """
    groups: dict[tuple[str, ...], list[tuple[Result, str, str]]] = {}
    for result, name, colour in zip(results, names(results), colours(results)):
        groups.setdefault((result.experiment, *result.joint_names, *result.position_units),
                          []).append((result, name, colour))
    used: set[str] = set()
    return [_written(group, directory, used) for group in groups.values()]


def _written(group: Sequence[tuple[Result, str, str]], directory: Path, used: set[str]
             ) -> page.SignalPlots:
    """Write the samples of runs that are plotted together."""
    first, runs, long, rounded = group[0][0], [], [], []
    for result, name, colour in group:
        # The page has q from q_d and e; beside each other, runs have no parts of the torque.
        left_out = ('q', *(PARTS if len(group) > 1 else ()))
        signals = {x: y for x, y in result.signals.items() if x not in left_out}
        tracks, end = _first_samples(by_times(signals))
        is_rounded = _count(tracks) > MOST_EXACT
        path = directory / f'{file_stem(name, used)}.js'
        texts = [compressed(t, values, is_rounded) for t, values in tracks]
        write_text(path, f'ctcSamples[{json.dumps(path.stem)}] = {json.dumps(texts)};\n')
        runs.append(page.PlottedRun(name.removeprefix(f'{result.experiment}: '), path, colour,
                                    result.torque.received))
        long += [f'{name} to {end:.4g} s'] if end < result.run.t[-1] else []
        rounded += [name] if is_rounded else []
    # Not the start, with its large errors.
    settled = min(first.window[0], 0.4 * float(first.run.t[-1]))
    marks = {time for result, _, _ in group for time, _ in result.marks}
    text = ('Error e = q_d − q, torque sent, V and further signals, each at the times and with '
            'the origin that the table below says. While times after '
            f'{2.0 * settled:.3g} s are shown, axes are scaled without the first {settled:.3g} s.')
    if rounded:
        text += (f' Values of {", ".join(rounded)} are rounded by at most 2e-5 of each, times to '
                 '1 µs.')
    if long:
        text += (f' Too long to show all: {", ".join(long)}. Figures show the whole run, and ctc '
                 'export writes it.')
    if len(marks) == 1:
        text += ' The line marks the change of law or switching.'
    return page.SignalPlots(
        f'Signals of {first.experiment}', text, first.joint_names, first.position_units, runs,
        _CHOSEN, settled, marks.pop() if len(marks) == 1 else None)


def _count(tracks: list[tuple[Array, dict[str, Array]]]) -> int:
    """Return the number of numbers in tracks."""
    return sum(len(t) * (1 + sum(y.shape[1] for y in values.values())) for t, values in tracks)


def _first_samples(tracks: list[tuple[Array, dict[str, Array]]]
                   ) -> tuple[list[tuple[Array, dict[str, Array]]], float]:
    """Return the first `MOST` numbers of tracks, and the time up to which these are [s]."""
    end = max(float(t[-1]) for t, _ in tracks)
    count = _count(tracks)
    if count <= MOST:
        return tracks, end
    begin = min(float(t[0]) for t, _ in tracks)
    end = begin + (end - begin) * MOST / count
    return [(t[t <= end], {name: y[t <= end] for name, y in values.items()})
            for t, values in tracks if t[0] <= end], end


#: What the signals of a run are called in the table of origins, together where one origin has
#: them.
_SIGNALS = {'q': 'position q', 'dq': 'velocity dq', 'q_d': 'reference q_d', 'e': 'error e',
            'torque': 'torque sent', 'v': 'filtered error v', 'V': 'V', 'nominal': 'nominal',
            'compensation': 'compensation', 'robust': 'robust'}


def origins_table(results: Sequence[Result]) -> Table:
    """Return where the samples of each signal come from, a row for each origin of a run."""
    rows: list[list[str]] = []
    for result, run_name in zip(results, names(results)):
        groups: dict[tuple[str, ...], list[str]] = {}
        for signal, series in result.signals.items():
            groups.setdefault(_origin(result, signal, series), []).append(_SIGNALS[signal])
        rows += [['' if k else run_name, ', '.join(signals), *origin]
                 for k, (origin, signals) in enumerate(groups.items())]
    heads = ['Run', 'Signals', 'Origin', 'From', 'Samples', 'Usual step']
    return Table('Where the samples come from', heads, rows, 4)


def _origin(result: Result, signal: str, series: Series) -> tuple[str, ...]:
    """Return origin, what it is from, number of samples and usual step."""
    source = result.topics.get(signal, 'simulation')
    if series.received:
        source += ', each when the recorder received it'
    elif signal not in ('q', 'dq', 'q_d', 'e', 'torque') and result.replay and (
            series.origin is SignalOrigin.COMPUTED):
        source += ': the law gives every torque and term recorded'
    if series.origin is SignalOrigin.UNKNOWN:
        return series.origin.value, '', '', ''
    return (series.origin.value, source, str(len(series.t)),
            f'{1e3 * series.step:.3g} ms' if series.step else '')


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
#: A run under chattering, its metrics, and those of the experiment under compensation.
Pair = tuple[Result, dict[str, Any], dict[str, Any]]


def write_page(results: Sequence[Result], figures: Sequence[FigureFile], path: Path,
               bags: Sequence[str] = (), plots: Sequence[page.SignalPlots] = (), command: str = ''
               ) -> None:
    """
    Write a page with the results.

    Parameters
    ----------
    results : sequence of Result
        Rows of the table; ``metrics.json`` with their numbers is beside the page.
    figures : sequence of FigureFile
        As `save_figures` returns them; linked relative to the page. Those of a run are folded.
    path : Path
        The page, for example ``out/index.html``.
    bags : sequence of str
        Path of each result's bag relative to the page; left out for no links.
    plots : sequence of page.SignalPlots
        As `write_samples` returns them.
    command : str
        What was run.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    runs = [{**finite(result.metrics()), 'name': name}
            for result, name in zip(results, names(results))]
    pairs = _pairs(results, runs)
    folded = [page.Folded(name, list(mine), len(results) == 1) for name, mine in groupby(
        figures, lambda x: x.group) if name]
    page.write_page(path, _headline(pairs), _LEAD, [
        page.Section('Result', [*([page.Cards(list(map(_gain, pairs)))] if pairs else []),
                                *(x for x in figures if not x.group)]),
        page.Section('Signals', [*plots, origins_table(results)] if plots else []),
        page.Section('Numbers', [_table(results, runs), *(
            page.Note(f'{text}.', f'{run["name"]}:') for run in runs for text in run['notes'])]),
        page.Section('Figures of each run', folded)],
        [('metrics.json', 'metrics.json'), *(
            (bag, f'bag of {run["name"]}') for run, bag in zip(runs, bags))], command)


def _gain(pair: Pair) -> page.Card:
    """Return the card of a run under another law than compensation."""
    result, run, base = pair
    unit = result.position_units[0]
    return page.Card(run['name'], _factor(base[_LARGEST], run[_LARGEST]), [
        f'Largest error: {base[_LARGEST]:.3g} {unit} under {BASELINE_LAW} → '
        f'{run[_LARGEST]:.3g} {unit} with {result.law}.'])


def _table(results: Sequence[Result], runs: Sequence[dict[str, Any]]) -> Table:
    """Return the numbers: a row a joint, those of the whole run in the first of them."""
    rows: list[list[str]] = []
    for result, run, colour in zip(results, runs, colours(results)):
        title = fragment(
            '<i class="dot" style="background: {{ colour }}"></i>{{ name }}<br><small>'
            '{% if source %}bag {{ source }}; {% endif %}{{ gains }}</small>', colour=colour,
            name=run['name'], source=result.source, gains=gains(result))
        for i, joint in enumerate(result.joint_names):
            rows.append([
                '' if i else title, joint,
                *('' if i else _value(result, 0, run[key], unit) for key, _, unit in RUN_COLUMNS),
                *(_value(result, i, run[key] and run[key][i], unit)
                  for key, _, unit in JOINT_COLUMNS)])
    note = (f'v reached: the time from which every |vᵢ| stays within {BAND:g} rad/s to the end. '
            'Torque variation: Σ |Δτ| per second; step and rate: from one sample to the next.')
    windows = {tuple(run['window_s']): run['name'] for run in runs if run['rms_error_rad']}
    if windows:
        over = ', '.join(f'{low:.4g} s to {high:.4g} s' + (
            f' ({called})' if len(windows) > 1 else '') for (low, high), called in windows.items())
        note = f'Errors and torques: over t = {over}. {note}'
    return Table('', ['Run', 'Joint', *(
        fragment('{{ name }}<br><small>[{{ unit }}]</small>', name=heading, unit=unit)
        for _, heading, unit in (*RUN_COLUMNS, *JOINT_COLUMNS))], rows, 2, note)


def _value(result: Result, joint: int, number: float | None, unit: str) -> Markup:
    """Return a number, with its unit where a prismatic joint has another than the heading."""
    other = unit != 's' and result.position_units[joint] != 'rad'
    return fragment('{{ number | number }}{% if unit %} <small>{{ unit }}</small>{% endif %}',
                    number=number, unit=unit.replace('rad', 'm').replace('N·m', 'N')
                    if other else '')


def _factor(before: float, after: float) -> str:
    """Return by what factor `after` is smaller or larger."""
    if before == after:
        return 'the same'
    if not after or not before:
        return 'zero' if not after else 'no longer zero'
    ratio = max(before / after, after / before)
    return f'{ratio:.{0 if ratio > 9.95 else 1}f}× {"smaller" if after < before else "larger"}'


def _pairs(results: Sequence[Result], runs: Sequence[dict[str, Any]]) -> list[Pair]:
    """Return each run under another law only, with its metrics and those under compensation."""
    whole = [(result, run) for result, run in zip(results, runs)
             if not result.changes and run[_LARGEST] is not None]
    base = {result.experiment: run for result, run in reversed(whole)
            if result.law == BASELINE_LAW}
    return [(result, run, base[result.experiment]) for result, run in whole
            if result.law != BASELINE_LAW and result.experiment in base]


def _headline(pairs: Sequence[Pair]) -> str:
    if not pairs:
        return _TITLE
    result, run, base = pairs[0]
    return (f'With {result.law} the largest tracking error is '
            f'{_factor(base[_LARGEST], run[_LARGEST])} ({result.experiment})')


#: Names in the directory of `write_runs`.
FIGURES, PAGE, SAMPLES = 'figures', 'index.html', 'samples'


def write_runs(results: Sequence[Result], out: str | Path, bags: Sequence[str | Path] = (),
               extra: str = 'svg', command: str = '', overwrite: bool = False) -> None:
    """
    Write figures, numbers and a page with interactive plots, on which runs are compared.

    Parameters
    ----------
    results : sequence of Result
        As `simulate` and `read_bag` return them.
    out : str or Path
        Directory for ``index.html``, ``metrics.json``, ``figures``, ``samples``.
    bags : sequence of str or Path
        The bag of each result, to which the page links; empty for no links.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        What was run, for the page.
    overwrite : bool
        Replace what an earlier call has written there.

    Raises
    ------
    CtcError
        If there is no result, a run has no samples, other files are there, or one cannot be
        written.

    """
    check_some('results', results)
    if len(bags) not in (0, len(results)):
        raise ParameterError('bags', bags, f'none, or {len(results)}, one of each result')
    check_format(extra)
    links = [os.path.relpath(bag, out) for bag in bags]
    with new_folder(Path(out), PLOT, overwrite) as folder:
        fill_folder(results, folder, links, extra, command)


def fill_folder(results: Sequence[Result], folder: Path, links: Sequence[str], extra: str = 'svg',
                command: str = '') -> None:
    """Write the files of `write_runs`; the page has these links to the bags."""
    from ctc_chattering.analysis.figures import save_figures  # Takes time.

    figures = save_figures(results, folder / FIGURES, extra)
    write_metrics(results, folder / METRICS)
    plots = write_samples(results, folder / SAMPLES)
    write_page(results, figures, folder / PAGE, links, plots, command)
