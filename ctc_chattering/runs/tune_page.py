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
Report of a search for gains.

`ctc tune` prints `report_text` of a `Tuning` and calls `write_tuning`. Candidates are the gains of
other settings and those of the front. Each has a score on the draws of the search and on fresh
ones.
"""

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
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.number_format import format_joint_values, round_number
from ctc_chattering.output_files import check_format, replacing, write_json
from ctc_chattering.output_folder import new_folder
from ctc_chattering.runs.law_figures import draw_panels, draw_trade_off, Mark
from ctc_chattering.runs.spec import spec_rows
from ctc_chattering.runs.store import write_table
from ctc_chattering.runs.tune import (
    Candidate,
    CONSTRAINTS,
    GainsScore,
    RATE,
    TORQUE,
    Trial,
    Tuning,
)
from ctc_chattering.runs.tune_spec import SPACE, space, TuneSpec
from matplotlib.figure import Figure

#: The command that writes the files.
TUNE = 'ctc tune'
#: Parameter file of the recommended point.
TUNED = 'tuned.yaml'
#: Folder with a parameter file of each point of the front.
POINTS = 'front'
NUMBERS = 'tune.json'
TABLE = 'tune.parquet'
PAGE = 'index.html'
#: A cell has the number of each joint up to this many joints, and a range beyond.
_MAX_JOINTS = 3
_CAPTION = (
    'A dot is a trial. No other trial beats one of the front in both error and variation. The '
    'numbers are those of the table. Star, square, diamond and cross are on fresh draws. If they '
    'lie above or to the right of the front, the search has fitted its own draws.')
#: Colour and mark of each other setting.
_OTHER_SETTINGS = ('#222222', 's'), ('#7B5EA7', 'D'), ('#007A5A', 'P')


def fact_rows(tuning: Tuning) -> Iterator[tuple[str, str]]:
    """Yield headings and texts about the search."""
    spec, config = tuning.spec, tuning.spec.setup.controller
    yield 'law', f'{config.law} {config.switching_in_force}'.strip()
    yield 'search', (f'{len(tuning.trials)} trials × {len(tuning.drawn)} draws '
                     f'({spec.repeats.sampling}), seed {tuning.seed}')
    yield 'validation', f'{len(tuning.fresh)} fresh draws, seed {tuning.fresh.spec.repeats.seed}'
    yield from spec_rows({'uncertain': spec.tree['uncertain']})
    for name, limit, unit in ((TORQUE, spec.limits.torque, 'N·m'),
                              (RATE, spec.limits.rate, 'N·m/s')):
        yield f'limit of the {name}', (
            'none' if min(limit) == inf else f'{format_joint_values(limit)} {unit}')
    counts = {name: sum(trial.score.excess[name] > 0.0 for trial in tuning.trials)
              for name in CONSTRAINTS}
    yield 'trials that violate', ', '.join(
        f'{name}: {count}' for name, count in counts.items() if count) or 'none'


def violation_text(score: GainsScore) -> str:
    """Return the violated constraints, each with its excess."""
    return ', '.join(f'{name} {x:+.1%}' for name, x in score.excess.items() if x > 0.0)


def candidate_table(tuning: Tuning) -> list[list[str]]:
    """Return the table of candidates, with its heads."""
    gains = list(tuning.spec.gains(tuning.trials[0].numbers))
    rows = [['gains', *gains, 'error [rad]', 'fresh', 'variation [N·m/s]', 'fresh',
             'torque [N·m]', 'rate [N·m/s]', 'violates, fresh']]
    for candidate in (*tuning.others, *tuning.points):
        drawn, fresh = candidate.drawn, candidate.fresh
        rows.append([
            f'{candidate.name} *' if candidate is tuning.best else candidate.name,
            *_gain_texts(tuning.spec.setup.controller.changed(candidate.values), gains),
            f'{drawn.error:.3g}', f'{fresh.error:.3g}',
            f'{drawn.variation:.4g}', f'{fresh.variation:.4g}',
            format_joint_values([*map(round_number, fresh.torque)], _MAX_JOINTS),
            format_joint_values([*map(round_number, fresh.rate)], _MAX_JOINTS),
            violation_text(fresh)])
    return rows


def _gain_texts(config: ControllerConfig, gains: Sequence[str]) -> Iterator[str]:
    """Yield the free gains of a law, and empty texts for others."""
    values = config.as_mapping()
    searched = space(config)
    for name in gains:
        is_shown = config.takes(name) and (name in searched or name not in SPACE)
        yield format_joint_values(values[name], _MAX_JOINTS) if is_shown else ''


def notes(tuning: Tuning) -> Iterator[str]:
    """Yield warnings about the recommended point."""
    point = tuning.best
    if point is None:
        yield f'no trial keeps the limits; {closest_trial_text(tuning.trials)}'
    elif not point.fresh.allowed:
        yield f'{point.name} violates limits on fresh draws, as all points do'


def closest_trial_text(trials: Sequence[Trial]) -> str:
    """Return the trial closest to the limits, with its violations."""
    excess = [max(trial.score.excess.values()) for trial in trials]
    k = excess.index(min(excess))
    return f'trial {k} comes closest: {violation_text(trials[k].score)}'


def report_text(tuning: Tuning) -> str:
    """Return facts, table and notes for a terminal."""
    head = columns([[f'{name}:', value] for name, value in fact_rows(tuning)])
    return '\n'.join([*head, '', *columns(candidate_table(tuning)), '', *(
        f'note: {note}' for note in notes(tuning))]).rstrip()


def draw_front(tuning: Tuning) -> Figure:
    """Draw error over torque variation of all trials and gains."""
    figure, (ax,) = draw_panels('Error and torque variation', [
        f'bound that {tuning.percentile:g} % of the draws do not exceed'], 'RMS error [rad]', 5.2)
    scores = [x.score for k, x in enumerate(tuning.trials) if k not in tuning.front]
    for is_allowed, name, marker, colour in (
            (True, 'other trials within the limits', '.', '#88aacc'),
            (False, 'beyond a limit', 'x', '#B8860B')):
        points = [(x.variation, x.error) for x in scores if x.allowed == is_allowed]
        if points:
            ax.plot(*zip(*points), marker, color=colour, markersize=5,
                    label=f'{name} ({len(points)})')
    drawn = [(x.drawn.variation, x.drawn.error) for x in tuning.points]
    fresh = [(x.fresh.variation, x.fresh.error) for x in tuning.points]
    if drawn:
        ax.plot(*zip(*drawn), 'o-', color='#0072B2', label='front, draws of the search',
                linewidth=1.3, markersize=6, zorder=3)
        ax.plot(*zip(*fresh), 'o', color='#D55E00', label='the same on fresh draws', markersize=6,
                markerfacecolor='white', zorder=3)
    marks: list[Mark] = [(x.fresh.variation, x.fresh.error, {
        'marker': marker, 'color': colour, 'markersize': 9, 'linestyle': '', 'zorder': 4,
        'markerfacecolor': 'none', 'markeredgewidth': 1.8, 'label': x.name})
        for x, (colour, marker) in zip(tuning.others, _OTHER_SETTINGS)]
    if tuning.best is not None:
        marks.append((tuning.best.fresh.variation, tuning.best.fresh.error, {
            'marker': '*', 'color': '#CC3311', 'markersize': 17, 'linestyle': '',
            'markeredgecolor': 'white', 'zorder': 5, 'label': 'recommended point'}))
    draw_trade_off(ax, marks, 'without a finite error', [*drawn, *fresh])
    legend_of(ax)
    return figure


def write_tuning(tuning: Tuning, out: str | Path, extra: str = 'svg', command: str = '',
                 overwrite: bool = False) -> None:
    """
    Write all files of a search for gains.

    Parameters
    ----------
    tuning : Tuning
        Result of `tune`.
    out : str or Path
        Directory. ``tuned.yaml`` is for `simulate` and all nodes, and ``front`` has such a file of
        each point. ``tune.parquet`` has a row a run. ``tune.json``, ``figures`` and
        ``index.html`` are the others.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        Command line, for the page.
    overwrite : bool
        Replace the files of an earlier call.

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
            [('front', draw_front(tuning), _CAPTION)], folder / 'figures', ('svg', extra))
        write_page(tuning, figures, folder / PAGE, command)


def write_page(tuning: Tuning, files: Sequence[FigureFile], path: Path, command: str = ''
               ) -> None:
    """Write the page, or raise `CtcError` if that fails."""
    head, *rows = candidate_table(tuning)
    table = Table('', head, rows, note=(
        '* recommended: of all under the tuned law that keep the limits on fresh draws, the one '
        'with the smallest product of error and torque variation there. The numbers are bounds '
        f'that {tuning.percentile:g} % of the draws do not exceed. Torque and rate are the '
        'largest of all fresh draws. A column fresh is on draws that the search has not seen.'))
    lead = ('Gains with little error and little torque variation for a robot that is known in '
            'part: the best compromises of a search, and their scores on draws that it has not '
            'seen.')
    written = (TUNED, POINTS, NUMBERS, TABLE) if tuning.best else (NUMBERS, TABLE)
    page.write_page(path, 'Gains that were tuned', lead, [
        page.Section('Result', [*files, *map(page.Note, notes(tuning)), table]),
        page.Section('What was run', [Table('', (), list(fact_rows(tuning)))])],
        [(name, name) for name in written], command)


def write_parameters(spec: TuneSpec, point: Candidate, path: Path) -> None:
    """
    Write a parameter file with the gains of a point.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    controller = spec.setup.controller.changed(point.values).as_mapping()
    values = {**spec.values, 'controller': {**spec.values['controller'], **controller}}
    parameter_file.dump(values, path)


def as_mapping(tuning: Tuning) -> dict[str, Any]:
    """Return all numbers for JSON."""
    spec, config = tuning.spec, tuning.spec.setup.controller

    def score(x: GainsScore) -> dict[str, Any]:
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
