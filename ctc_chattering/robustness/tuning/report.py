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

"""A search for gains in words and tables: for the terminal and for the page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf

from ctc_chattering.analysis.number_format import number_text, rounded
from ctc_chattering.analysis.tables import columns
from ctc_chattering.robustness.quantity import Uncertain
from ctc_chattering.robustness.tuning.identified import PossibleDrives
from ctc_chattering.robustness.tuning.runs import Candidate, Tuning
from ctc_chattering.robustness.tuning.search import (
    CONSTRAINTS,
    DIVERGED,
    OverDraws,
    RATE,
    TORQUE,
    Trial,
)
from ctc_chattering.studies.tuning import SPACE, space

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


def table(tuning: Tuning) -> list[list[str]]:
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
    return '\n'.join([*head, '', *columns(table(tuning)), '', headline(tuning), *(
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
