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

"""Page of a map: how often laws fail, where they are worse than the paper's, what was run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.drawing import save
from ctc_chattering.analysis.page import FigureFile, Folded, Section, write_page
from ctc_chattering.analysis.tables import Table, two_lines
from ctc_chattering.number_format import format_count
from ctc_chattering.runs.map_data import against, KINDS, MapData, passing, pooled, sobol_table
from ctc_chattering.runs.map_figures import figures
from ctc_chattering.runs.spec import MapSpec, rows_of
from ctc_chattering.runs.store import FIGURES, JSON, PAGE, TABLE
import matplotlib
import numpy as np


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
    with matplotlib.rc_context({'svg.hashsalt': 'map'}):  # Equal data give equal files.
        files = save(figures(data), directory / FIGURES, ('svg', extra))
    write_map_page(data, files, directory / PAGE, dict(rows_of(spec.tree)), command)
    return directory / PAGE


def write_map_page(data: MapData, files: Sequence[FigureFile], path: Path,
                   facts: Mapping[str, str], command: str = '') -> None:
    """
    Write the page of a map.

    Parameters
    ----------
    data : MapData
        Of the map.
    files : sequence of FigureFile
        Linked relative to the page, the first at the top.
    path : Path
        The page, for example ``out/index.html``.
    facts : mapping of str to str
        What was run, besides numbers of runs.
    command : str
        What was run.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    boundaries = list(_boundaries(data))
    sobol = sobol_table(data)
    write_page(
        path, headline(data), lead(data), [
            Section('Result', [*files[:1], failures(data), *against_base(data)]),
            Section('Further figures', files[1:]),
            Section('Further numbers', [
                *(Folded(x.title, [x._replace(title='')], len(boundaries) == 1)
                  for x in boundaries), *([sobol] if sobol.rows else [])]),
            Section('What was run', [Table('', (), list(facts.items()))])],
        [(TABLE, f'{TABLE} (a row a run)'), (JSON, f'{JSON} (spec and versions)')], command)


def headline(data: MapData) -> str:
    """Return how often the best and the worst law fail."""
    failed = (data.rows['failure'] != '').groupby(data.rows['variant'], sort=False).mean()
    shown = dict.fromkeys((failed.idxmin(), failed.idxmax()))
    return ', '.join(f'{law} {"" if k else "fails "}in {100.0 * failed[law]:.1f} %'
                     for k, law in enumerate(shown)) + ' of the runs'


def lead(data: MapData) -> str:
    axes = ' × '.join(axis.name for axis in data.axes)
    return (f'{format_count(len(data.variants), "law")}'
            + (f' over {axes}, {format_count(int(np.prod(data.shape)), "point")}' if axes else '')
            + f': {format_count(len(data.rows), "run")}'
            + (' near the boundary only: any other point is shown as the nearest one that was '
               'run, and shares are of the runs made.' if data.refined else '.'))


def failures(data: MapData) -> Table:
    """Return the table of failures: a row a variant, a column a kind."""
    used = [kind for kind in KINDS if (data.rows['failure'] == kind).any()]
    rows = []
    for v, name in enumerate(data.variants):
        mine, failure = data.of(v), data.of(v)['failure']
        error = np.sort(mine['error'])
        rows.append([name, f'{len(mine)}', *(
            _share(failed, mine['repeat']) for failed in (
                failure != '', *(failure == kind for kind in used))),
            two_lines(*(f'{x:.2e}' if np.isfinite(x) else 'diverged' for x in (
                error[int(np.ceil(q * len(error))) - 1] for q in (0.5, 0.95))))])
    return Table('', ['law', 'runs', 'fail', *used, 'median error [rad], 95 % quantile'], rows,
                 note='Below each share: its 95 % interval for other draws on this grid, as wide '
                 'as the draws differ; none for one draw. A run counts under the first kind that '
                 'applies; one that diverged has an infinite error.')


def _share(failed: Any, repeat: Any) -> str:
    """Return the share of runs that failed, with its interval, if there is one."""
    draws = failed.groupby(repeat).agg(['sum', 'count'])
    low, high = (100.0 * x for x in pooled(draws['sum'], draws['count']))
    share = f'{100.0 * failed.mean():.1f} %'
    return share if np.isnan(low) else two_lines(share, f'{low:.1f} to {high:.1f}')


def against_base(data: MapData) -> Iterator[Table]:
    """Yield the table of the laws against the base, if there are both."""
    if data.base is None or len(data.variants) == 1:
        return
    base = data.variants[data.base]
    yield Table(f'Against {base}', ['law', 'runs', 'only the law fails', f'only {base} fails'],
                [[law, *map(str, x)] for law, x in against(data, data.base).iterrows()],
                note='Runs at the same point, with the same draw and the same noise.')


def _boundaries(data: MapData) -> Iterator[Table]:
    """Yield a table for each axis: which of its values pass, at values of the others."""
    for k, axis in enumerate(data.axes):
        rows, count = passing(data, k)
        others = ', '.join(x.name for x in data.axes if x is not axis)
        yield Table(
            f'Values of {axis.label} at which less than half of the runs fail',
            [others, *data.variants], [[name or axis.label, *cells] for name, cells in rows],
            note=f'{len(rows)} of {count} rows.' if len(rows) < count else '')
