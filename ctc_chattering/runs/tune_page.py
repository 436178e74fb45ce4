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

"""What a search for gains writes: parameter files, numbers, figures and page; its text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf
from pathlib import Path
from typing import Any

from ctc_chattering.analysis import drawing, page
from ctc_chattering.analysis.drawing import legend_of
from ctc_chattering.analysis.page import FigureFile
from ctc_chattering.analysis.tables import columns, Table
from ctc_chattering.configuration import parameter_file
from ctc_chattering.number_format import format_joint_values, round_number
from ctc_chattering.output_files import check_format, replacing, write_json
from ctc_chattering.output_folder import new_folder
from ctc_chattering.runs.figures import Mark, panels, trade_off
from ctc_chattering.runs.spec import rows_of
from ctc_chattering.runs.store import write_table
from ctc_chattering.runs.tune import Candidate, CONSTRAINTS, OverDraws, RATE, TORQUE, Trial, Tuning
from ctc_chattering.runs.tune_spec import SPACE, space, TuneSpec
from matplotlib.figure import Figure

#: Most joints whose numbers are all shown.
_MANY = 3
#: Names in the directory.
TUNED, NUMBERS, TABLE, POINTS, FIGURES, PAGE = (
    'tuned.yaml', 'tune.json', 'tune.parquet', 'front', 'figures', 'index.html')
#: The command that writes it.
TUNE = 'ctc tune'
_LEAD = ('Gains with little error and little torque variation for a robot that is known in part: '
         'the best compromises of a search, and what they do on draws that it has not seen.')
_CAPTION = (
    'A dot a trial; the front has those that no other beats in both. The numbers are those of the '
    'table. Star, square, diamond and cross are on fresh draws. Where fresh draws lie above or to '
    'the right of the front, the search has fitted its own draws.')
#: Colours of the front on the draws of the search, on fresh draws, and of the recommended point.
_DRAWN, _FRESH, _KNEE = '#0072B2', '#D55E00', '#CC3311'
#: Colours and marks of other settings, and of other trials within the limits and beyond.
_OTHERS = ('#222222', 's'), ('#7B5EA7', 'D'), ('#007A5A', 'P')
_TRIALS = ('other trials within the limits', '.', '#88aacc'), ('beyond a limit', 'x', '#B8860B')


def facts(tuning: Tuning) -> Iterator[tuple[str, str]]:
    """Yield what was done: heading and text."""
    spec, config = tuning.spec, tuning.spec.setup.controller
    yield 'law', f'{config.law} {config.switching_in_force}'.strip()
    yield 'search', (f'{len(tuning.trials)} trials × {len(tuning.drawn)} draws '
                     f'({spec.repeats.sampling}), seed {tuning.seed}')
    yield 'validation', f'{len(tuning.fresh)} fresh draws, seed {tuning.fresh.spec.repeats.seed}'
    yield from rows_of({'uncertain': spec.tree['uncertain']})
    for name, most, unit in ((TORQUE, spec.limits.torque, 'N·m'),
                             (RATE, spec.limits.rate, 'N·m/s')):
        yield f'limit of the {name}', 'none' if min(most) == inf else (
            f'{format_joint_values(most)} {unit}')
    yield 'trials that violate', ', '.join(
        f'{name}: {n}' for name in CONSTRAINTS
        if (n := sum(x.score.excess[name] > 0.0 for x in tuning.trials))) or 'none'


def violated(score: OverDraws) -> str:
    """Return by how much, or in which part of the runs, what is violated; empty for nothing."""
    return ', '.join(f'{name} {x:+.1%}' for name, x in score.excess.items() if x > 0.0)


def table_of(tuning: Tuning) -> list[list[str]]:
    """Return the rows of the table of candidates, the names of the columns first."""
    gains = list(tuning.spec.gains(tuning.trials[0].numbers))
    rows = [['gains', *gains, 'error [rad]', 'fresh', 'variation [N·m/s]', 'fresh',
             'torque [N·m]', 'rate [N·m/s]', 'violates, fresh']]
    for x in (*tuning.others, *tuning.points):
        config = tuning.spec.setup.controller.changed(x.values)
        values, searched = config.as_mapping(), space(config)
        rows.append([
            f'{x.name} *' if x is tuning.best else x.name,
            *(format_joint_values(values[name], _MANY) if config.takes(name) and (
                name in searched or name not in SPACE) else '' for name in gains),
            f'{x.drawn.error:.3g}', f'{x.fresh.error:.3g}',
            f'{x.drawn.variation:.4g}', f'{x.fresh.variation:.4g}',
            *(format_joint_values([round_number(y) for y in most], _MANY)
              for most in (x.fresh.torque, x.fresh.rate)),
            violated(x.fresh)])
    return rows


def notes(tuning: Tuning) -> Iterator[str]:
    """Yield what the user should know of the recommended point."""
    point = tuning.best
    if point is None:
        yield f'no trial keeps the limits; {closest(tuning.trials)}'
    elif not point.fresh.allowed:
        yield f'{point.name} violates limits on fresh draws, as all points do'


def closest(trials: Sequence[Trial]) -> str:
    """Return which trial comes closest to the limits, and what it violates."""
    k, score = min(enumerate(x.score for x in trials), key=lambda x: max(x[1].excess.values()))
    return f'trial {k} comes closest: {violated(score)}'


def text(tuning: Tuning) -> str:
    """Return everything for a terminal."""
    head = columns([[f'{name}:', value] for name, value in facts(tuning)])
    return '\n'.join([*head, '', *columns(table_of(tuning)), '', *(
        f'note: {note}' for note in notes(tuning))]).rstrip()


def front_figure(tuning: Tuning) -> Figure:
    """Draw error over torque variation: trials, the front, the validation, and others."""
    figure, (ax,) = panels('Error and torque variation', [
        f'what {tuning.percentile:g} % of the draws do not exceed'], 'RMS error [rad]', 5.2)
    rest = [x.score for k, x in enumerate(tuning.trials) if k not in tuning.front]
    for (name, marker, colour), within in zip(_TRIALS, (True, False)):
        mine = [x for x in rest if x.allowed == within]
        if mine:
            ax.plot([x.variation for x in mine], [x.error for x in mine], marker, color=colour,
                    markersize=5, label=f'{name} ({len(mine)})')
    drawn, fresh = ([(x.variation, x.error) for x in found] for found in (
        [x.drawn for x in tuning.points], [x.fresh for x in tuning.points]))
    if drawn:
        ax.plot(*zip(*drawn), 'o-', color=_DRAWN, label='front, draws of the search',
                linewidth=1.3, markersize=6, zorder=3)
        ax.plot(*zip(*fresh), 'o', color=_FRESH, label='the same on fresh draws', markersize=6,
                markerfacecolor='white', zorder=3)
    marks: list[Mark] = [(x.fresh.variation, x.fresh.error, {
        'marker': marker, 'color': colour, 'markersize': 9, 'linestyle': '', 'zorder': 4,
        'markerfacecolor': 'none', 'markeredgewidth': 1.8, 'label': x.name})
        for x, (colour, marker) in zip(tuning.others, _OTHERS)]
    if tuning.best is not None:
        marks.append((tuning.best.fresh.variation, tuning.best.fresh.error, {
            'marker': '*', 'color': _KNEE, 'markersize': 17, 'linestyle': '',
            'markeredgecolor': 'white', 'zorder': 5, 'label': 'recommended point'}))
    trade_off(ax, marks, 'without a finite error', [*drawn, *fresh])
    legend_of(ax)
    return figure


def write_tuning(tuning: Tuning, out: str | Path, extra: str = 'svg', command: str = '',
                 overwrite: bool = False) -> None:
    """
    Write parameter files, numbers, figures and page of a search for gains.

    Parameters
    ----------
    tuning : Tuning
        What `tune` has found.
    out : str or Path
        Directory for ``tuned.yaml``, which `simulate` and all nodes take, ``front``, with those
        of all points, ``tune.json``, ``tune.parquet``, a row a run, ``figures``, ``index.html``.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        What was run, for the page.
    overwrite : bool
        Replace what an earlier call has written there.

    Raises
    ------
    CtcError
        If there are files already, or one cannot be written.

    """
    check_format(extra)
    with new_folder(Path(out), TUNE, overwrite) as folder:
        for point in tuning.points:
            write_parameters(tuning.spec, point, folder / POINTS / f'{point.name}.yaml')
        if tuning.best:
            write_parameters(tuning.spec, tuning.best, folder / TUNED)
        write_json(as_mapping(tuning), folder / NUMBERS)
        with replacing(folder / TABLE) as stream:
            write_table(tuning.table, stream)
        figures = drawing.save(
            [('front', front_figure(tuning), _CAPTION)], folder / FIGURES, ('svg', extra))
        write_page(tuning, figures, folder / PAGE, command)


def write_page(tuning: Tuning, files: Sequence[FigureFile], path: Path, command: str = ''
               ) -> None:
    """Write the page; raise `CtcError` if that cannot be done."""
    head, *rows = table_of(tuning)
    numbers = Table('', head, rows, note=(
        '* recommended: of all under the tuned law that keep the limits on fresh draws, the one '
        'with the smallest product of error and torque variation there. These are '
        f'what {tuning.percentile:g} % of the draws do not exceed; torque and rate are the '
        'largest of all fresh draws. A column fresh is on draws that the search has not seen.'))
    page.write_page(path, 'Gains that were tuned', _LEAD, [
        page.Section('Result', [*files, *map(page.Note, notes(tuning)), numbers]),
        page.Section('What was run', [Table('', (), list(facts(tuning)))])],
        [(name, name) for name in (TUNED, POINTS, NUMBERS, TABLE) if (
            tuning.best or name in (NUMBERS, TABLE))], command)


def write_parameters(spec: TuneSpec, point: Candidate, path: Path) -> None:
    """
    Write the file's parameters with the law and the gains of a point.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    controller = spec.setup.controller.changed(point.values).as_mapping()
    values = {**spec.values, 'controller': {**spec.values['controller'], **controller}}
    parameter_file.dump(values, path)


def as_mapping(tuning: Tuning) -> dict[str, Any]:
    """Return everything as JSON has it."""
    spec, config = tuning.spec, tuning.spec.setup.controller

    def score(x: OverDraws) -> dict[str, Any]:
        return {'error_rad': x.error, 'torque_variation_nm_per_s': x.variation,
                'max_torque_nm': x.torque, 'max_torque_rate_nm_per_s': x.rate,
                'excess': x.excess}

    return {
        'law': config.law, 'switching': config.switching_in_force or None,
        'percentile': tuning.percentile, 'seed': tuning.seed,
        'duration_s': spec.setup.plant.duration,
        'limits': {'torque_nm': spec.limits.torque, 'torque_rate_nm_per_s': spec.limits.rate},
        'uncertain': spec.tree['uncertain'],
        'draws': {name: {'seed': x.spec.repeats.seed, 'values': x.draws.tolist()}
                  for name, x in (('search', tuning.drawn), ('fresh', tuning.fresh))},
        'search': {name: x[:2] for name, x in spec.ranges.items()},
        'recommended': tuning.best and tuning.best.name,
        'front': tuning.front,
        'candidates': [{'name': x.name, 'parameters': x.values, 'drawn': score(x.drawn),
                        'fresh': score(x.fresh)} for x in (*tuning.others, *tuning.points)],
        'trials': [{'trial': k, 'numbers': x.numbers, **score(x.score)}
                   for k, x in enumerate(tuning.trials)]}
