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
from ctc_chattering.analysis.drawing import FigureFile, legend_of
from ctc_chattering.analysis.output import check_format, prepare, write_json, writing
from ctc_chattering.analysis.tables import columns, number_text, rounded, Table
from ctc_chattering.configuration import parameter_file
from ctc_chattering.runs.figures import log_axis, Mark, panels, trade_off
from ctc_chattering.runs.search import (
    CONSTRAINTS,
    DIVERGED,
    OverDraws,
    RATE,
    SPACE,
    space,
    TORQUE,
    Trial,
)
from ctc_chattering.runs.spec import rows_of
from ctc_chattering.runs.tune import Candidate, TuneSpec, Tuning
from matplotlib.figure import Figure

#: Part of a range, on a logarithmic scale, that counts as its end.
_END = 1.05
#: Most joints whose numbers are all shown.
_MANY = 3
_VERBS = {DIVERGED: 'diverge', TORQUE: 'exceed the torque limit',
          RATE: 'exceed the limit of the torque rate'}
#: Names in the directory.
TUNED, NUMBERS, POINTS, FIGURES, PAGE = NAMES = (
    'tuned.yaml', 'tune.json', 'front', 'figures', 'index.html')
_LEAD = ('Gains with little error and little torque variation for a robot that is known in part: '
         'the best compromises of a search, and what they do on draws that it has not seen.')
#: Colours: the front on the draws of the search, on fresh draws, and the recommended point.
_DRAWN, _FRESH, _KNEE = '#0072B2', '#D55E00', '#CC3311'
_OTHERS = ('#222222', '#7B5EA7', '#007A5A')
#: Colour and mark of a trial that violates a constraint.
_VIOLATING = {TORQUE: ('#B8860B', 'x'), RATE: ('#888888', '+')}


def facts(tuning: Tuning) -> Iterator[tuple[str, str]]:
    """Yield what was done: heading and text."""
    spec, config = tuning.spec, tuning.spec.setup.controller
    yield 'law', f'{config.law} {config.switching_in_force}'.strip()
    yield 'search', (f'{len(tuning.trials)} trials × {len(tuning.drawn)} draws '
                     f'({spec.repeats.sampling}), seed {tuning.seed}')
    yield 'runs', (f'{spec.setup.plant.duration:g} s, evaluated from {spec.window[0]:g} s to '
                   f'{spec.window[1]:g} s; start within '
                   f'{spec.setup.reference.start_duration:g} s')
    yield 'validation', f'{len(tuning.fresh)} fresh draws, seed {tuning.fresh.spec.repeats.seed}'
    yield from rows_of({'uncertain': spec.tree['uncertain']})
    for name, most, unit in ((TORQUE, spec.limits.torque, 'N·m'),
                             (RATE, spec.limits.rate, 'N·m/s')):
        yield f'limit of the {name}', 'none' if min(most) == inf else (
            f'{number_text(most)} {unit}')
    yield 'trials', trials_text(tuning.trials)


def trials_text(trials: Sequence[Trial]) -> str:
    """Return how many trials violate what."""
    counts = [(name, sum(bool(x.score.violating[name]) for x in trials)) for name in CONSTRAINTS]
    broken = [f'{n} {_VERBS[name]}' for name, n in counts if n]
    kept = sum(x.score.allowed for x in trials)
    return (f'in some run {", ".join(broken)}; {kept} of {len(trials)} keep all limits'
            if broken else 'all within the limits')


def violations_text(score: OverDraws) -> str:
    """Return what runs violate, with their number; empty for nothing."""
    return ', '.join(f'{name}: {n} of {len(score.runs)}'
                     for name, n in score.violating.items() if n)


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
            *(number_text(values[name], _MANY) if config.takes(name) and (
                name in searched or name not in SPACE) else '' for name in gains),
            f'{x.drawn.error:.3g}', f'{x.fresh.error:.3g}',
            f'{x.drawn.variation:.4g}', f'{x.fresh.variation:.4g}',
            *(number_text([rounded(y) for y in most], _MANY)
              for most in (x.fresh.torque, x.fresh.rate)), violations_text(x.fresh)])
    return rows


def headline(tuning: Tuning) -> str:
    """Return what is recommended against the file's gains, and what is better, fresh draws."""
    if tuning.best is None:
        return 'No trial keeps the limits'
    new, old = tuning.best.fresh, tuning.others[0].fresh
    text = ('The gains of the file diverge, what is recommended does not' if old.error == inf else
            'The gains of the file remain' if tuning.best is tuning.others[0] else
            _ratios(old, new) + ' of the gains of the file')
    least = min((x for x in tuning.others if x.fresh.allowed),
                key=lambda x: x.fresh.product, default=tuning.best)
    if least.fresh.product < new.product:
        text += f'; {least.name}, not tuned, has {_ratios(new, least.fresh)} of these'
    return text


def _ratios(before: OverDraws, after: OverDraws) -> str:
    """Return by what factors error and torque variation differ."""
    return (f'{after.error / before.error:.2g} times the error and '
            f'{after.variation / before.variation:.2g} times the torque variation')


def notes(tuning: Tuning) -> Iterator[str]:
    """Yield what the user should know of the recommended point."""
    point = tuning.best
    if point is None:
        yield f'no trial keeps the limits; {closest(tuning.trials)}'
    elif not point.fresh.allowed:
        yield (f'{point.name} violates limits on fresh draws ({violations_text(point.fresh)}), as '
               'all points do')
    if point in tuning.points:
        numbers = tuning.trials[tuning.front[tuning.points.index(point)]].numbers
        for name, limits in tuning.spec.ranges.items():
            for end, edge in (('low', limits.low), ('high', limits.high)):
                if limits.low < limits.high and 1.0 / _END < numbers[name] / edge < _END:
                    yield (f'{name} of point {point.name} is at the {end} end of its range, '
                           f'{edge:g}: a wider one may be better')
    elif point is not None:
        yield f'no point of the front is better than {point.name}, which tuned.yaml has'
    yield from tuning.spec.notes


def closest(trials: Sequence[Trial]) -> str:
    """Return which trial comes closest to the limits, and what it violates."""
    k, score = min(enumerate(x.score for x in trials), key=lambda x: max(x[1].excess.values()))
    worst, excess = max(score.excess.items(), key=lambda item: item[1])
    if worst == DIVERGED:
        reason = next(x.failure for x in score.runs if x.failure)
        return f'trial {k} comes closest: {excess:.0%} of its runs diverge, the first: {reason}'
    return f'trial {k} comes closest: it exceeds the limit of the {worst} by {excess:.0%}'


def text(tuning: Tuning) -> str:
    """Return everything for a terminal."""
    head = columns([[f'{name}:', value] for name, value in facts(tuning)])
    return '\n'.join([*head, '', *columns(table_of(tuning)), '', headline(tuning), *(
        f'note: {note}' for note in notes(tuning))]).rstrip()


def part_of_runs(percentile: float) -> str:
    """Return what error and variation of a candidate are, in words."""
    if percentile == 100.0:
        return 'the largest of all draws'
    return f'what {percentile:g} % of the draws do not exceed'


def front_figure(tuning: Tuning) -> Figure:
    """Draw error over torque variation: trials, the front, the validation, and others."""
    figure, (ax,) = panels('Error and torque variation', [part_of_runs(tuning.percentile)],
                           'RMS error [rad]', 5.2)
    rest = [x.score for k, x in enumerate(tuning.trials) if k not in tuning.front]
    for kind in ('', *CONSTRAINTS):  # The first constraint that a trial violates.
        mine = [x for x in rest if kind == next((y for y in CONSTRAINTS if x.violating[y]), '')]
        colour, marker = _VIOLATING.get(kind, ('#88aacc', '.'))
        name = f'beyond the limit of the {kind}' if kind else 'other trials within the limits'
        if mine and kind == DIVERGED:
            drawing.note(ax, f'{len(mine)} trials with a run that diverges are not shown')
        elif mine:
            ax.plot([x.variation for x in mine], [x.error for x in mine], marker, color=colour,
                    markersize=5, label=f'{name} ({len(mine)})')
    drawn, fresh = ([_place(getattr(x, name)) for x in tuning.points]
                    for name in ('drawn', 'fresh'))
    for one, other in zip(drawn, fresh):
        ax.plot(*zip(one, other), color='#bbbbbb', linewidth=0.8, zorder=2)
    if drawn:
        ax.plot(*zip(*drawn), 'o-', color=_DRAWN, label='front, draws of the search',
                linewidth=1.3, markersize=6, zorder=3)
        ax.plot(*zip(*fresh), 'o', color=_FRESH, label='the same on fresh draws', markersize=6,
                markerfacecolor='white', zorder=3)
    marks: list[Mark] = []
    for x, colour, marker in zip(tuning.others, _OTHERS, 'sDP'):
        broken = ', '.join(name for name in CONSTRAINTS if x.fresh.violating[name])
        marks.append((*_place(x.fresh), {
            'marker': marker, 'color': colour, 'markersize': 9, 'linestyle': '', 'zorder': 4,
            'markerfacecolor': 'none', 'markeredgewidth': 1.8,
            'label': x.name + (f' (violates: {broken})' if broken else '')}))
    if tuning.best is not None:
        marks.append((*_place(tuning.best.fresh), {
            'marker': '*', 'color': _KNEE, 'markersize': 17, 'linestyle': '',
            'markeredgecolor': 'white', 'zorder': 5, 'label': 'recommended point'}))
    trade_off(ax, marks, 'without a finite error', [*drawn, *fresh])
    for k, x in enumerate(tuning.points):
        if k in (0, len(tuning.points) - 1) or x is tuning.best:
            ax.annotate(x.name, drawn[k], xytext=(5, 4), textcoords='offset points', fontsize=9,
                        color=_DRAWN, zorder=6)
    legend_of(ax)
    return figure


def _place(score: OverDraws) -> tuple[float, float]:
    """Return torque variation and error."""
    return score.variation, score.error


def draws_figure(tuning: Tuning) -> Figure:
    """Draw the error of every fresh draw over each uncertain quantity."""
    figure, axes = panels('Error over what is uncertain, fresh draws', [
        x.name for x in tuning.spec.uncertain], 'RMS error [rad]', 2.4)
    for ax, quantity, x in zip(axes, tuning.spec.uncertain, tuning.fresh.draws.T):
        unit = f' [{quantity.unit}]' if quantity.unit else ' [factor]' if quantity.factor else ''
        ax.set(xlabel=f'{quantity.name}{unit}', yscale='log')
        if quantity.distribution == 'log_uniform':
            log_axis(ax, 'x', x)
        elif quantity.distribution == 'choice':
            ax.set_xticks(quantity.numbers)
        for candidate, form, colour, name in (
                (tuning.others[0], 's', _OTHERS[0], 'gains of the file'),
                (tuning.best, 'o', _KNEE, 'recommended point')):
            if candidate is not None:
                ax.plot(x, [run.error for run in candidate.fresh.runs], form, color=colour,
                        markersize=3.5, alpha=0.7, label=name)
    legend_of(figure.axes[0])
    return figure


def figures(tuning: Tuning) -> Iterator[tuple[str, Figure, str]]:
    """Yield name, figure and caption, in the order in which to show them."""
    yield 'front', front_figure(tuning), (
        'A dot a trial; the front has those that no other beats in both. The numbers are those '
        'of the table. Star, square, diamond and cross are on fresh draws. Where fresh draws lie '
        'above or to the right of the front, the search has fitted its own draws.')
    if tuning.spec.uncertain:
        yield 'draws', draws_figure(tuning), (
            'A dot a draw: which uncertain quantity makes the error.')


def write_tuning(tuning: Tuning, out: str | Path, extra: str = 'svg', command: str = '') -> None:
    """
    Write parameter files, numbers, figures and page of a search for gains.

    Parameters
    ----------
    tuning : Tuning
        What `tune` has found.
    out : str or Path
        Directory for ``tuned.yaml``, which `simulate` and all nodes take, ``front``, with those
        of all points, ``tune.json``, ``figures``, ``index.html``.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        What was run, for the page.

    Raises
    ------
    CtcError
        If a file exists already, or cannot be written.

    """
    check_format(extra)
    out = prepare(Path(out), NAMES)
    for point in tuning.points:
        write_parameters(tuning.spec, point, out / POINTS / f'{point.name}.yaml')
    if tuning.best:
        write_parameters(tuning.spec, tuning.best, out / TUNED)
    write_json(as_mapping(tuning), out / NUMBERS)
    write_page(tuning, drawing.save(figures(tuning), out / FIGURES, ('svg', extra)), out / PAGE,
               command)


def write_page(tuning: Tuning, files: Sequence[FigureFile], path: Path, command: str = ''
               ) -> None:
    """Write the page; raise `CtcError` if that cannot be done."""
    there = {TUNED: 'parameter file of what is recommended', POINTS: 'of all points of the '
             'front', NUMBERS: 'all numbers'}
    head, *rows = table_of(tuning)
    numbers = Table('', head, rows, note=(
        '* recommended: of all under the tuned law that keep the limits on fresh draws, the one '
        'with the smallest product of error and torque variation there. These are '
        f'{part_of_runs(tuning.percentile)}; torque and rate are the largest of all fresh '
        'draws. A column fresh is on draws that the search has not seen.'))
    page.write_page(path, headline(tuning), _LEAD, [
        page.Section('Result', [*files[:1], *map(page.Note, notes(tuning)), numbers]),
        page.Section('Further figures', files[1:]),
        page.Section('What was run', [Table('', (), list(facts(tuning)))])],
        [(name, f'{name} ({what})') for name, what in there.items()
         if tuning.best or name == NUMBERS], command)


def write_parameters(spec: TuneSpec, point: Candidate, path: Path) -> None:
    """
    Write the file's parameters with the law and the gains of a point, and check them.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    controller = spec.setup.controller.changed(point.values).as_mapping()
    values = {**spec.values, 'controller': {**spec.values['controller'], **controller}}
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        parameter_file.dump(values, path)
    parameter_file.load(path)


def as_mapping(tuning: Tuning) -> dict[str, Any]:
    """Return everything as JSON has it."""
    spec, config = tuning.spec, tuning.spec.setup.controller

    def score(x: OverDraws) -> dict[str, Any]:
        return {'error_rad': x.error, 'torque_variation_nm_per_s': x.variation,
                'max_torque_nm': x.torque, 'max_torque_rate_nm_per_s': x.rate,
                'runs': len(x.runs),
                'violating_runs': {name: n for name, n in x.violating.items() if n}}

    def candidate(x: Candidate) -> dict[str, Any]:
        return {'name': x.name, 'parameters': x.values, 'drawn': score(x.drawn),
                'fresh': score(x.fresh)}

    return {
        'name': spec.name, 'law': config.law, 'switching': config.switching_in_force or None,
        'percentile': tuning.percentile, 'seed': tuning.seed,
        'joint_names': config.joint_names, 'duration_s': spec.setup.plant.duration,
        'window_s': spec.window, 'sampling': spec.repeats.sampling,
        'limits': {'torque_nm': spec.limits.torque, 'torque_rate_nm_per_s': spec.limits.rate},
        'uncertain': [{
            'name': x.name, 'parameters': [f'{node}.{target.name}' for node, target in x.targets],
            'factor': x.factor, 'distribution': x.distribution, 'numbers': x.numbers}
            for x in spec.uncertain],
        'draws': {name: {'seed': x.spec.repeats.seed, 'values': x.draws.tolist()}
                  for name, x in (('search', tuning.drawn), ('fresh', tuning.fresh))},
        'search': {name: x[:2] for name, x in spec.ranges.items()},
        'recommended': tuning.best and tuning.best.name,
        'front': [{'trial': k, **candidate(x)} for k, x in zip(tuning.front, tuning.points)],
        'references': [candidate(x) for x in tuning.others],
        'trials': [{'trial': k, 'numbers': x.numbers, **score(x.score)}
                   for k, x in enumerate(tuning.trials)],
        'notes': list(notes(tuning))}
