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

"""The page of a map: which law fails how often, where it is worse than the base, figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.drawing import FigureFile
from ctc_chattering.analysis.page import Folded, Note, Section, write_page
from ctc_chattering.analysis.tables import (
    counted,
    percent,
    scientific,
    short,
    span,
    Table,
    two_lines,
)
from ctc_chattering.runs.map_data import (
    Contrast,
    contrast,
    Counts,
    GridAxis,
    KINDS,
    MapData,
    passing,
    pooled,
    side,
)
from ctc_chattering.runs.map_figures import save_map_figures, sobol_table
from ctc_chattering.runs.spec import MapSpec, Quantity, Uncertain
from ctc_chattering.runs.store import FIGURES, JSON, PAGE, TABLE
import numpy as np

#: Names of laws, and what is said of them.
Sentences = list[tuple[str, str]]


def write_map_page(data: MapData, figures: Sequence[FigureFile], path: Path,
                   facts: Mapping[str, str], files: Mapping[str, str], command: str = ''
                   ) -> None:
    """
    Write the page of a map.

    Parameters
    ----------
    data : MapData
        Of the map.
    figures : sequence of FigureFile
        As `save_map_figures` returns them; linked relative to the page, the first at the top.
    path : Path
        The page, for example ``out/index.html``.
    facts : mapping of str to str
        What axes and uncertain parameters are, by name, and further lines of the summary, for
        example what counts as a failure.
    files : mapping of str to str
        Names of files beside the page, and what they are.
    command : str
        What was run.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    sobol = sobol_table(data) if data.saltelli else None
    boundaries = list(_boundaries(data))
    write_page(
        path, _headline(data), _lead(data), [
            Section('Result', [*figures[:1], _failures(data)]),
            _worse(data),
            Section('Further figures', figures[1:]),
            Section('Further numbers', [
                *([sobol] if sobol and sobol.rows else []), *(
                    Folded(x.title, [x._replace(title='')], len(boundaries) == 1)
                    for x in boundaries)]),
            Section('What was run', [Table('', (), _summary(data, facts))])],
        [(name, f'{name} ({what})') for name, what in files.items()], command)


def _worse(data: MapData) -> Section:
    """Return where laws are worse than the base; without items if there is none."""
    worse, better = _against_base(data)
    name = '' if data.base is None else data.variants[data.base]
    items = [*(Note(text, law) for law, text in worse),
             *(Note(text, law, attention=False) for law, text in better)]
    return Section(f'Where a law is worse than {name}', [*items, Note(
        'Of runs at the same point, with the same draw and the same noise. '
        'ctc map SPEC --explain RUN shows one.', attention=False)] if items else [])


def _headline(data: MapData) -> str:
    """Return how often the best law fails, and the base, or the worst one."""
    failed, runs = data.kinds.sum(axis=0), _runs(data)
    if not failed.any():
        return 'No run fails'
    order = np.argsort(failed / runs, kind='stable').tolist()
    shown = list(dict.fromkeys([order[0], order[-1] if data.base is None else data.base,
                                order[-1]]))[:2]
    return ', '.join(
        f'{data.variants[v]} {"" if k else "fails "}in {percent(failed[v], runs[v])}'
        for k, v in enumerate(shown)) + ' of the runs'


def _lead(data: MapData) -> str:
    axes = ' × '.join(axis.name for axis in data.axes)
    points = f'over {axes}: {counted(int(np.prod(data.shape)), "point")}, ' if axes else ''
    return (f'{counted(len(data.variants), "law")} {points or "with "}'
            f'{counted(data.repeats, "draw")}{" each" if axes else ""}, '
            f'{counted(len(data.rows), "run")} in all'
            + (', near the boundary only: any other point is shown as the nearest one that was '
               'run, and shares are of the runs made.' if data.refined else '.'))


def _failures(data: MapData) -> Table:
    """Return the table of failures: a row a variant, a column a kind."""
    used = [k for k in range(len(KINDS)) if data.kinds[k].any()]
    heads = ['law', 'runs', 'fail', *(KINDS[k] for k in used), 'median error [rad], 95 % quantile',
             *(['points that pass / undecided / fail'] if data.axes else [])]
    sides = side(data.failed, data.runs)
    rows = []
    for v, name in enumerate(data.variants):
        runs = int(_runs(data)[v])
        error = np.sort(data.of(v)['error'])
        middle, high = (scientific(x) if np.isfinite(x) else 'diverged' for x in (
            error[int(np.ceil(q * runs)) - 1] for q in (0.5, 0.95)))
        rows.append([name, f'{runs}', *(_share(*data.of_draws(v, kind)) for kind in (None, *used)),
                     two_lines(middle, high)])
        if data.axes:
            rows[-1].append(' / '.join(str(int(((sides[v] == x) & (data.runs[v] > 0)).sum()))
                                       for x in (-1, 0, 1)))
    return Table('', heads, rows, note=(
        'Below each share: its interval of 95 % '
        + ('for other draws on this grid; all points have the same draws, so it is as wide as '
           'these differ, and there is none for one draw. A point passes if its own interval '
           '(Wilson) is below one half, and fails if it is above.' if data.axes else '(Wilson).')
        + ' A run counts under the first kind that applies; one that diverged has an infinite '
        'error.'))


def _against_base(data: MapData) -> tuple[Sentences, Sentences]:
    """Return laws that are worse than the base somewhere, the worst first, and the others."""
    base = data.base
    if base is None:
        return [], []
    name = data.variants[base]
    found = {v: contrast(data, v, base) for v in range(len(data.variants)) if v != base}
    worse = sorted((v for v, x in found.items() if x.larger or x.worse),
                   key=lambda v: (-found[v].worse, -found[v].loss))
    return [(data.variants[v], _sentences(found[v], name)) for v in worse], [
        (data.variants[v], f'nowhere; {name} fails where it does not in {x.better} of '
         f'{counted(x.runs, "run")}.') for v, x in found.items() if v not in worse]


def _sentences(found: Contrast, base: str) -> str:
    text = (f'fails where {base} does not in {found.worse} of {counted(found.runs, "run")}; '
            f'the reverse in {found.better}.')
    if found.points:
        text += f' Half of its runs or more fail, and less of {base}, at {found.points}.'
    text += f' In {counted(found.larger, "run")} its error is the larger one'
    if found.loss > 1.0:
        text += f', up to {short(found.loss)} times as large in run {found.run}'
        text += f', {found.where}' if found.where else ''
    return text + '.'


def _boundaries(data: MapData) -> Iterator[Table]:
    """Yield a table for each axis: which of its values pass, at values of the others."""
    for k, axis in enumerate(data.axes):
        rows, count = passing(data, k)
        others = ', '.join(x.name for x in data.axes if x is not axis)
        yield Table(
            f'Values of {axis.label} at which less than half of the runs fail',
            [others, *data.variants], [[name or axis.label, *cells] for name, cells in rows],
            note=f'{len(rows)} of {count} rows.' if len(rows) < count else '')


def _summary(data: MapData, facts: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return axes, draws, seeds, ways of computing, then the `facts` of nothing of these."""
    seeds, engines = data.rows['seed'], data.rows['engine'].value_counts(sort=False)
    lines = {axis.label: ': '.join(filter(None, (_values(axis), facts.get(axis.name))))
             for axis in (*data.axes, *data.fixed)}
    lines |= {name: facts.get(name, 'drawn') for name in data.uncertain}
    lines['runs'] = (f'{counted(data.repeats, "run")} of each law'
                     + (' at each point' if data.axes else '')
                     + f'; seeds of the noise {seeds.min()} to {seeds.max()}')
    lines['simulated'] = ', '.join(
        f'{name or "not"}: {counted(n, "run")}' for name, n in engines.items())
    lines |= {name: text for name, text in facts.items() if name not in data.columns}
    return list(lines.items())


def _values(axis: GridAxis) -> str:
    ends = span(axis.values[0], axis.values[-1])
    return f'{len(axis.values)} values, {ends}' if len(axis.values) > 1 else ends


def _runs(data: MapData) -> Counts:
    return np.array([len(data.of(v)) for v in range(len(data.variants))])


def _share(failures: Counts, runs: Counts) -> str:
    """Return a share with its interval, if there is one, from the counts of each draw."""
    low, high = (100.0 * x for x in pooled(failures, runs))
    share = percent(int(failures.sum()), int(runs.sum()))
    return share if np.isnan(low) else two_lines(share, f'{low:.1f} to {high:.1f}')


#: Numbers of a distribution in words.
_WORDS = {'uniform': 'uniform, {} to {}', 'log_uniform': 'log-uniform, {} to {}',
          'normal': 'normal, {} ± {}'}


def write_report(spec: MapSpec, table: Any, directory: Path, extra: str = 'svg',
                 command: str = '') -> Path:
    """
    Write figures and page of a map beside its results, and return the page.

    Parameters
    ----------
    spec : MapSpec
        What was run.
    table : pyarrow.Table
        Its rows.
    directory : Path
        Of the results.
    extra : str
        A second format of the figures: ``pdf`` or ``png``.
    command : str
        What was run.

    Raises
    ------
    CtcError
        If a file cannot be written.

    """
    data = MapData(table, {x.name: x.unit for x in spec.axes}, [x.name for x in spec.uncertain],
                   [x.name for x, step in zip(spec.axes, spec.coarse) if step > 1],
                   spec.repeats.sampling == 'saltelli')
    figures = save_map_figures(data, directory / FIGURES, extra)
    write_map_page(data, figures, directory / PAGE, facts(spec),
                   {TABLE: 'a row a run', JSON: 'the spec, versions and counts'}, command)
    return directory / PAGE


def facts(spec: MapSpec) -> dict[str, str]:
    """Return what a page says of a spec, besides the grid and the numbers of runs."""
    plant, (low, high) = spec.setup.plant, spec.window
    found = {'map': spec.name, 'robot and motion': (
        f'{plant.experiment}, {plant.duration:g} s, evaluated from {low:g} s to {high:g} s')}
    found |= {x.name: _meaning(x) for x in (*spec.axes, *spec.uncertain)}
    if spec.uncertain:
        found['draws'] = f'{spec.repeats.sampling}, with seed {spec.repeats.seed}'
    return {**found, 'a run fails if': ', or '.join(_failure_words(spec))}


def _failure_words(spec: MapSpec) -> Iterator[str]:
    limits = spec.failure
    yield 'it diverges'
    if isfinite(limits.error_above):
        yield f'the RMS error of a joint exceeds {limits.error_above:g} rad'
    if limits.saturated_above < 1.0:
        yield (f'a torque is at its limit in more than {100.0 * limits.saturated_above:g} % of '
               'the samples')
    if limits.not_reached:
        yield 'v never stays within its band'
    yield f'it would take more than {short(limits.steps_above)} steps of the integrator'


def _meaning(x: Quantity) -> str:
    """Return what a quantity sets, and how it is drawn."""
    names = [f'{node}.{spec.name}' for node, spec in x.targets]
    text = ('factor of ' if x.factor else '') + ' and '.join(names)
    if isinstance(x, Uncertain):
        numbers = [short(y) for y in x.numbers]
        text += ', ' + (_WORDS[x.distribution].format(*numbers) if x.distribution in _WORDS
                        else 'one of ' + ', '.join(numbers))
    return text
