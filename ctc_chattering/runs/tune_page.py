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

"""A search for gains in words and figures, and what `ctc tune` writes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import json
from math import inf
from pathlib import Path
from typing import Any

from ctc_chattering.analysis import drawing, page
from ctc_chattering.analysis.drawing import FigureFile, legend_of
from ctc_chattering.analysis.output import check_format, finite, prepare, write_text, writing
from ctc_chattering.analysis.tables import columns, csv_text, number_text, rounded, Table
from ctc_chattering.configuration import parameter_file
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
from ctc_chattering.runs.spec import Uncertain
from ctc_chattering.runs.tune import Candidate, Tuning
from ctc_chattering.runs.tune_spec import Draws, PossibleDrives, TuneSpec
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
import numpy as np

#: Part of a range, on a logarithmic scale, that counts as its end.
_END = 1.05
#: Most joints whose numbers are all shown.
_MANY = 3
_VERBS = {DIVERGED: 'diverge', TORQUE: 'exceed the torque limit',
          RATE: 'exceed the limit of the torque rate'}


def facts(tuning: Tuning) -> Iterator[tuple[str, str]]:
    """Yield what was done: heading and text."""
    spec, config = tuning.spec, tuning.spec.setup.controller
    n, fresh = spec.repeats.repeats, len(tuning.fresh.setups)
    yield 'law', f'{config.law} {config.switching_in_force}'.strip()
    yield 'search', (f'{len(tuning.trials)} trials × {n} draws ({spec.repeats.sampling}), seed '
                     f'{tuning.seed}')
    yield 'runs', (f'{spec.setup.plant.duration:g} s, evaluated from {spec.window[0]:g} s to '
                   f'{spec.window[1]:g} s; start within '
                   f'{spec.setup.reference.start_duration:g} s')
    yield 'validation', f'{fresh} fresh draws, seed {tuning.fresh.seed}'
    yield 'uncertain', '; '.join(map(uncertain_text, spec.uncertain)) or 'noise only'
    for name, most, unit in ((TORQUE, spec.limits.torque, 'N·m'),
                             (RATE, spec.limits.rate, 'N·m/s')):
        yield f'limit of the {name}', 'none' if min(most) == inf else (
            f'{number_text(most)} {unit}')
    yield 'trials', trials_text(tuning.trials)


def uncertain_text(quantity: Uncertain) -> str:
    """Return what is drawn, in words."""
    if isinstance(quantity, PossibleDrives):
        return quantity.text
    numbers = [f'{x:g}' for x in quantity.numbers]
    drawn = {'normal': f'normal, mean {numbers[0]}, deviation {numbers[-1]}',
             'choice': ' or '.join(numbers)}.get(
        quantity.distribution, f'{numbers[0]} to {numbers[-1]}')
    spaced = ', logarithmic' if quantity.distribution == 'log_uniform' else ''
    times = 'times ' if quantity.factor else ''
    return f'{quantity.name} {times}{drawn} {quantity.unit}'.rstrip() + spaced


def trials_text(trials: Sequence[Trial]) -> str:
    """Return how many trials violate what."""
    counts = [(name, sum(bool(x.score.violating[name]) for x in trials)) for name in CONSTRAINTS]
    broken = [f'{n} {_VERBS[name]}' for name, n in counts if n]
    if not broken:
        return 'all within the limits'
    kept = sum(x.score.allowed for x in trials)
    return f'in some run {", ".join(broken)}; {kept} of {len(trials)} keep all limits'


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
        name = f'{x.name} *' if x is tuning.best else x.name
        rows.append([
            name, *_gains(x, gains, tuning), f'{x.drawn.error:.3g}', f'{x.fresh.error:.3g}',
            f'{x.drawn.variation:.4g}', f'{x.fresh.variation:.4g}',
            number_text([rounded(y) for y in x.fresh.torque], _MANY),
            number_text([rounded(y) for y in x.fresh.rate], _MANY), violations_text(x.fresh)])
    return rows


def _gains(x: Candidate, names: Sequence[str], tuning: Tuning) -> list[str]:
    """Return the gains of a candidate in words; empty where its law has none of that name."""
    config = tuning.spec.setup.controller.changed(x.values)
    values, searched = config.as_mapping(), space(config)
    return [number_text(values[name], _MANY) if config.takes(name) and (
        name in searched or name not in SPACE) else '' for name in names]


def headline(tuning: Tuning) -> str:
    """Return what is recommended against the file's gains, and what is better, fresh draws."""
    if tuning.best is None:
        return 'No trial keeps the limits'
    new, old = tuning.best.fresh, tuning.others[0].fresh
    text = ('The gains of the file diverge, what is recommended does not' if old.error == inf else
            'The gains of the file remain' if tuning.best is tuning.others[0] else
            _ratios(old, new) + ' of the gains of the file')
    better = [x for x in tuning.others if x.fresh.allowed and _product(x) < _product(tuning.best)]
    if better:
        least = min(better, key=_product)
        text += f'; {least.name}, not tuned, has {_ratios(new, least.fresh)} of these'
    return text


def notes(tuning: Tuning) -> Iterator[str]:
    """Yield what the user should know of the recommended point."""
    point = tuning.best
    if point is None:
        yield f'no trial keeps the limits; {closest(tuning.trials)}'
        return
    if not point.fresh.allowed:
        yield (f'{point.name} violates limits on fresh draws ({violations_text(point.fresh)}), as '
               'all points do')
    if point not in tuning.points:
        yield f'no point of the front is better than {point.name}, which tuned.yaml has'
        return
    numbers = tuning.trials[tuning.front[tuning.points.index(point)]].numbers
    for name, limits in tuning.spec.ranges.items():
        for end, edge in (('low', limits.low), ('high', limits.high)):
            if limits.low < limits.high and 1.0 / _END < numbers[name] / edge < _END:
                yield (f'{name} of point {point.name} is at the {end} end of its range, {edge:g}: '
                       'a wider one may be better')


def closest(trials: Sequence[Trial]) -> str:
    """Return which trial comes closest to the limits, and what it violates."""
    k = min(range(len(trials)), key=lambda k: max(trials[k].score.excess.values()))
    score = trials[k].score
    excess = max(score.excess.values())
    worst = next(name for name in CONSTRAINTS if score.excess[name] == excess)
    if worst == DIVERGED:
        reason = next(x.failure for x in score.runs if x.failure)
        return f'trial {k} comes closest: {excess:.0%} of its runs diverge, the first: {reason}'
    return f'trial {k} comes closest: it exceeds the limit of the {worst} by {excess:.0%}'


def text(tuning: Tuning) -> str:
    """Return everything for a terminal."""
    head = columns([[f'{name}:', value] for name, value in facts(tuning)])
    return '\n'.join([*head, '', *columns(table_of(tuning)), '', headline(tuning), *(
        f'note: {note}' for note in (*notes(tuning), *tuning.spec.notes))]).rstrip()


def part_of_runs(percentile: float) -> str:
    """Return what error and variation of a candidate are, in words."""
    if percentile == 100.0:
        return 'the largest of all draws'
    return f'what {percentile:g} % of the draws do not exceed'


def _product(x: Candidate) -> float:
    """Return the product of error and torque variation on fresh draws."""
    return x.fresh.error * x.fresh.variation


def _ratios(before: OverDraws, after: OverDraws) -> str:
    """Return by what factors error and torque variation differ."""
    return (f'{_ratio(before.error, after.error)} error and '
            f'{_ratio(before.variation, after.variation)} torque variation')


def _ratio(before: float, after: float) -> str:
    """Return by what factor a number is smaller or larger."""
    factor = after / before if before else inf
    return f'{factor:.2g} times the' if factor >= 0.1 else f'1/{1.0 / factor:.3g} of the'


#: Colours: the front on the draws of the search, on fresh draws, and the recommended point.
_DRAWN, _FRESH, _KNEE = '#0072B2', '#D55E00', '#CC3311'
_OTHERS = ('#222222', '#7B5EA7', '#007A5A')
#: Colour and mark of a trial that violates a constraint.
_VIOLATING = {'torque': ('#B8860B', 'x'), 'torque rate': ('#888888', '+')}
#: What numbers are, where they are not the parameters of the same name.
_MEANING = {'pole': ', p of kp = p² [rad/s]', 'damping': ', d of kv = 2 d p',
            'ka': ", times the file's", 'ki': ', times kp kv',
            'adaptation_gain': ', times the friction'}
#: Panels beside each other.
_COLUMNS = 3
#: Room around what is drawn, as a factor.
_ROOM = 1.4


def front_figure(tuning: Tuning) -> Figure:
    """Draw error over torque variation: trials, the front, the validation, and others."""
    figure, grid = drawing.sheet('Error and torque variation', 1, (1.0,), 5.2)
    ax = drawing.panel(figure, grid[0, 0], part_of_runs(tuning.percentile), 'RMS error [rad]')
    ax.set(xlabel='torque variation [N·m/s]', xscale='log', yscale='log')
    _trials(ax, tuning)
    for candidate in tuning.points:
        ax.plot(*zip(_place(candidate, False), _place(candidate, True)), color='#bbbbbb',
                linewidth=0.8, zorder=2)
    for fresh, form, colour, name in (
            (False, 'o-', _DRAWN, 'front, draws of the search'),
            (True, 'o', _FRESH, 'the same on fresh draws')):
        places = [_place(x, fresh) for x in tuning.points]
        if places:
            ax.plot(*zip(*places), form, color=colour, label=name, linewidth=1.3, markersize=6,
                    markerfacecolor='white' if fresh else colour, zorder=3)
    _marks(ax, tuning)
    _fit(ax, [_place(x, fresh) for x in (*tuning.points, *tuning.others) for fresh in (0, 1)])
    legend_of(ax)
    return figure


def _trials(ax: Axes, tuning: Tuning) -> None:
    """Draw the trials that are not on the front."""
    scores = [x.score for x in tuning.trials]
    rest = [x for k, x in enumerate(scores) if x.allowed and k not in tuning.front]
    if rest:
        ax.plot([x.variation for x in rest], [x.error for x in rest], '.', color='#88aacc',
                markersize=5, label=f'other trials within the limits ({len(rest)})')
    for name, (colour, marker) in _VIOLATING.items():
        mine = [x for x in scores if x.violating[name] and not x.violating[DIVERGED]
                and name == next(y for y in CONSTRAINTS if x.violating[y])]
        if mine:
            ax.plot([x.variation for x in mine], [x.error for x in mine], marker, color=colour,
                    markersize=5, label=f'beyond the limit of the {name} ({len(mine)})')
    gone = sum(bool(x.violating[DIVERGED]) for x in scores)
    if gone:
        drawing.note(ax, f'{gone} trials with a run that diverges are not shown')


def _marks(ax: Axes, tuning: Tuning) -> None:
    """Draw the recommended point and the others, on fresh draws."""
    gone: list[dict[str, Any]] = []
    if tuning.best is not None:
        ax.plot(*_place(tuning.best, True), '*', color=_KNEE, markersize=17,
                markeredgecolor='white', zorder=5, label='recommended point')
    for candidate, colour, marker in zip(tuning.others, _OTHERS, 'sDP'):
        broken = ', '.join(x for x in CONSTRAINTS if candidate.fresh.violating[x])
        look: dict[str, Any] = {
            'marker': marker, 'color': colour, 'markersize': 9, 'linestyle': '', 'zorder': 4,
            'markerfacecolor': 'none', 'markeredgewidth': 1.8,
            'label': candidate.name + (f' (violates: {broken})' if broken else '')}
        if np.isfinite(_place(candidate, True)).all():
            ax.plot(*_place(candidate, True), **look)
        else:
            gone.append(look)
    drawing.beyond(ax, 'without a finite error', gone)
    for k, candidate in enumerate(tuning.points):
        if k in (0, len(tuning.points) - 1) or candidate is tuning.best:
            ax.annotate(candidate.name, _place(candidate, False), xytext=(5, 4),
                        textcoords='offset points', fontsize=9, color=_DRAWN, zorder=6)


def _place(candidate: Candidate, fresh: object) -> tuple[float, float]:
    """Return torque variation and error of a candidate."""
    score = candidate.fresh if fresh else candidate.drawn
    return score.variation, score.error


def _fit(ax: Axes, places: Sequence[tuple[float, float]]) -> None:
    """Fit the axes to places; trials far from them are not shown."""
    for axis, values in zip('xy', zip(*places)):
        finite = [x for x in values if 0.0 < x < np.inf]
        if finite:
            ax.set(**{f'{axis}lim': (min(finite) / _ROOM, max(finite) * _ROOM)})
    _ticks(ax.xaxis, ax.yaxis)


def _ticks(*axes: Axis) -> None:
    """Put plain numbers at 1, 2 and 5 times powers of ten."""
    for axis in axes:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda x, _: f'{x:g}'))
        axis.set_minor_locator(NullLocator())


def gains_figure(tuning: Tuning) -> Figure:
    """Draw each number that is searched along the front, with its range."""
    names = list(tuning.spec.ranges)
    columns = min(_COLUMNS, len(names))
    figure, grid = drawing.sheet('Numbers along the front', -(-len(names) // columns),
                                 (1.0,) * columns, 2.2)
    x = [point.drawn.variation for point in tuning.points]
    for k, name in enumerate(names):
        ax = drawing.panel(figure, grid[k // columns, k % columns], name + _MEANING.get(name, ''),
                           '')
        limits = tuning.spec.ranges[name]
        y = [tuning.trials[i].numbers[name] for i in tuning.front]
        ax.plot(x, y, 'o', color=_DRAWN, markersize=5)
        if tuning.best in tuning.points:
            best = tuning.points.index(tuning.best)
            ax.plot(x[best], y[best], '*', color=_KNEE, markersize=14,
                    markeredgecolor='white')
        ax.set(xlabel='torque variation [N·m/s]', xscale='log', yscale='log',
               ylim=(limits.low / 1.2, limits.high * 1.2))
        _ticks(ax.xaxis, ax.yaxis)
        for end in limits[:2]:
            ax.axhline(end, color='#999999', linewidth=0.8, linestyle='--')
    return figure


def draws_figure(tuning: Tuning) -> Figure:
    """Draw the error of every fresh draw over each uncertain quantity."""
    spec, fresh = tuning.spec, tuning.fresh
    columns = min(_COLUMNS, len(spec.uncertain))
    figure, grid = drawing.sheet('Error over what is uncertain, fresh draws',
                                 -(-len(spec.uncertain) // columns), (1.0,) * columns, 2.4)
    shown = [(tuning.others[0], _OTHERS[0], 's', 3.0)]
    if tuning.best is not None:
        shown.append((tuning.best, _KNEE, 'o', 4.0))
    for k, quantity in enumerate(spec.uncertain):
        unit = f' [{quantity.unit}]' if quantity.unit else ' [factor]' if quantity.factor else ''
        ax = drawing.panel(figure, grid[k // columns, k % columns], quantity.name,
                           '' if k % columns else 'RMS error [rad]')
        ax.set(xlabel=f'{quantity.name}{unit}', yscale='log')
        if quantity.distribution == 'log_uniform':
            ax.set_xscale('log')
            _ticks(ax.xaxis)
        elif quantity.distribution == 'choice':
            ax.set_xticks(quantity.numbers)
        for candidate, colour, marker, size in shown:
            ax.plot([row[k] for row in fresh.values], [x.error for x in candidate.fresh.runs],
                    marker, color=colour, markersize=size, alpha=0.7,
                    label='gains of the file' if colour in _OTHERS else
                    'recommended point')
    legend_of(figure.axes[0])
    return figure


def save_tune_figures(tuning: Tuning, directory: Path, extra: str = 'svg'
                      ) -> list[drawing.FigureFile]:
    """
    Write the figures of a search as SVG and `extra`; return them in the order to show them.

    Raises
    ------
    CtcError
        If a file cannot be written.

    """
    return drawing.save(_all(tuning), directory, ('svg', extra))


def _all(tuning: Tuning) -> Iterator[tuple[str, Figure, str]]:
    yield 'front', front_figure(tuning), (
        'A dot a trial; the front has those that no other beats in both. The numbers are those '
        'of the table. Star, square, diamond and cross are on fresh draws. Where fresh draws lie '
        'above or to the right of the front, the search has fitted its own draws.')
    if tuning.points:
        yield 'numbers', gains_figure(tuning), (
            'What was searched, at each point of the front. Star: recommended, if it is '
            'on the front. Dashed: ends of the range that is searched. At an end the range may be '
            'too narrow.')
    if tuning.spec.uncertain:
        yield 'draws', draws_figure(tuning), (
            'A dot a draw: which uncertain quantity makes the error.')


#: Names in the directory.
TUNED, NUMBERS, FRONT, POINTS, FIGURES, PAGE = NAMES = (
    'tuned.yaml', 'tune.json', 'front.csv', 'front', 'figures', 'index.html')
_LEAD = ('Gains with little error and little torque variation for a robot that is known in part: '
         'the best compromises of a search, and what they do on draws that it has not seen.')


def write_tuning(tuning: Tuning, out: str | Path, extra: str = 'svg', command: str = '') -> None:
    """
    Write parameter files, numbers, figures and page of a search for gains.

    Parameters
    ----------
    tuning : Tuning
        What `tune` has found.
    out : str or Path
        Directory for ``tuned.yaml``, which `simulate` and all nodes take, ``front``, with those
        of all points, ``front.csv``, ``tune.json``, ``figures``, ``index.html``.
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
    write_text(out / NUMBERS, json.dumps(
        finite(as_mapping(tuning)), indent=1, ensure_ascii=False) + '\n')
    write_text(out / FRONT, to_csv(tuning))
    write_page(tuning, save_tune_figures(tuning, out / FIGURES, extra), out / PAGE, command)


def write_page(tuning: Tuning, figures: Sequence[FigureFile], path: Path, command: str = ''
               ) -> None:
    """Write the page; raise `CtcError` if that cannot be done."""
    files = {TUNED: 'parameter file of what is recommended', POINTS: 'of all points of the '
             'front', FRONT: 'their numbers', NUMBERS: 'all trials'}
    links = [(name, f'{name} ({what})') for name, what in files.items()
             if tuning.best or name == NUMBERS]
    remarks = [page.Note(text) for text in (*notes(tuning), *tuning.spec.notes)]
    numbers, run = _tables(tuning)
    page.write_page(path, headline(tuning), _LEAD, [
        page.Section('Result', [*figures[:1], *remarks, numbers]),
        page.Section('Further figures', figures[1:]), page.Section('What was run', [run])],
        links, command)


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
    return {
        'name': spec.name, 'law': config.law, 'switching': config.switching_in_force or None,
        'percentile': tuning.percentile, 'seed': tuning.seed,
        'joint_names': list(config.joint_names), 'duration_s': spec.setup.plant.duration,
        'window_s': list(spec.window), 'sampling': spec.repeats.sampling,
        'limits': {'torque_nm': list(spec.limits.torque),
                   'torque_rate_nm_per_s': list(spec.limits.rate)},
        'uncertain': [{
            'name': x.name, 'parameters': [f'{node}.{target.name}' for node, target in x.targets],
            'factor': x.factor, 'distribution': x.distribution, 'numbers': list(x.numbers)}
            for x in spec.uncertain],
        'draws': {'search': _draws(spec.draws()), 'fresh': _draws(tuning.fresh)},
        'search': {name: [x.low, x.high] for name, x in spec.ranges.items()},
        'recommended': tuning.best and tuning.best.name,
        'front': [{'trial': k, **_candidate(x)} for k, x in zip(tuning.front, tuning.points)],
        'references': [_candidate(x) for x in tuning.others],
        'trials': [{'trial': k, 'numbers': x.numbers, **_score(x.score)}
                   for k, x in enumerate(tuning.trials)],
        'notes': [*notes(tuning), *spec.notes]}


def _draws(draws: Draws) -> dict[str, Any]:
    return {'seed': draws.seed, 'values': draws.values}


def _candidate(x: Candidate) -> dict[str, Any]:
    return {'name': x.name, 'parameters': dict(x.values), 'drawn': _score(x.drawn),
            'fresh': _score(x.fresh)}


def _score(x: OverDraws) -> dict[str, Any]:
    return {'error_rad': x.error, 'torque_variation_nm_per_s': x.variation,
            'max_torque_nm': list(x.torque), 'max_torque_rate_nm_per_s': list(x.rate),
            'runs': len(x.runs), 'violating_runs': {name: n for name, n in x.violating.items()
                                                    if n}}


def to_csv(tuning: Tuning) -> str:
    """Return a line per point of the front, with a header; numbers in full."""
    rows = []
    for k, x in enumerate(tuning.points):
        numbers = tuning.trials[tuning.front[k]].numbers
        row: dict[str, object] = {'point': x.name, 'recommended': int(x is tuning.best), **{
            f'search_{name}': value for name, value in numbers.items()}}
        for name, value in x.values.items():
            row.update({f'{name}_{i}': y for i, y in enumerate(value, 1)} if isinstance(
                value, list) else {name: value})
        for title, score in (('', x.drawn), ('fresh_', x.fresh)):
            row.update({f'{title}error_rad': score.error,
                        f'{title}torque_variation_nm_per_s': score.variation,
                        **{f'{title}runs_violating_{name.replace(" ", "_")}': n
                           for name, n in score.violating.items()}})
        rows.append(row)
    return csv_text(rows, ['point'])


def _tables(tuning: Tuning) -> tuple[Table, Table]:
    """Return the tables of the page: numbers, and what was run."""
    head, *rows = table_of(tuning)
    return Table('', head, rows, note=(
        '* recommended: of all under the tuned law that keep the limits on fresh draws, the one '
        'with the smallest product of error and torque variation there. These are '
        f'{part_of_runs(tuning.percentile)}; torque and rate are the largest of all fresh '
        'draws. A column fresh is on draws that the search has not seen.')
    ), Table('', (), list(facts(tuning)))
