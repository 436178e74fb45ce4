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
Page of a map.

`compute_map` calls `write_report` with the rows of `map.parquet`. The page shows how often laws
fail, where they are worse than the paper's, and what was run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.drawing import save
from ctc_chattering.analysis.page import FigureFile, Folded, Section, write_page
from ctc_chattering.analysis.tables import Table, two_lines
from ctc_chattering.number_format import format_count
from ctc_chattering.runs.map_data import (
    compare_with_base,
    KINDS,
    MapData,
    passing_values,
    pooled_interval,
    sobol_table,
    spaced_indices,
)
from ctc_chattering.runs.map_figures import figures
from ctc_chattering.runs.spec import MapSpec, spec_rows
from ctc_chattering.runs.store import FIGURES, JSON, PAGE, TABLE
import matplotlib
import numpy as np


def write_report(spec: MapSpec, table: Any, directory: Path, extra: str = 'svg',
                 command: str = '') -> Path:
    """
    Write figures and page of a map, and return the page.

    Parameters
    ----------
    spec : MapSpec
        Spec of the map.
    table : pyarrow.Table
        Its rows.
    directory : Path
        Folder of the results.
    extra : str
        A second format of the figures, ``pdf`` or ``png``.
    command : str
        Command line.

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
    write_map_page(data, files, directory / PAGE, dict(spec_rows(spec.tree)), command)
    return directory / PAGE


def write_map_page(data: MapData, files: Sequence[FigureFile], path: Path,
                   facts: Mapping[str, str], command: str = '') -> None:
    """
    Write the page of a map.

    Parameters
    ----------
    data : MapData
        Numbers of the map.
    files : sequence of FigureFile
        Figures, linked relative to the page. The first is at the top.
    path : Path
        The page, for example ``out/index.html``.
    facts : mapping of str to str
        Spec, besides numbers of runs.
    command : str
        Command line.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    boundaries = list(_passing_tables(data))
    sobol = sobol_table(data)
    write_page(
        path, headline(data), lead(data), [
            Section('Result', [*files[:1], failure_table(data), *base_tables(data)]),
            Section('Further figures', files[1:]),
            Section('Further numbers', [
                *(Folded(x.title, [x._replace(title='')], len(boundaries) == 1)
                  for x in boundaries), *([sobol] if sobol.rows else [])]),
            Section('What was run', [Table('', (), list(facts.items()))])],
        [(TABLE, f'{TABLE} (a row a run)'), (JSON, f'{JSON} (spec and versions)')], command)


def headline(data: MapData) -> str:
    """Return the failures of the best and worst law."""
    failed = (data.rows['failure'] != '').groupby(data.rows['variant'], sort=False).mean()
    laws = dict.fromkeys((failed.idxmin(), failed.idxmax()))
    return ', '.join(f'{law} {"" if k else "fails "}in {100.0 * failed[law]:.1f} %'
                     for k, law in enumerate(laws)) + ' of the runs'


def lead(data: MapData) -> str:
    """Return the size of the map in a sentence."""
    text = format_count(len(data.variants), 'law')
    if data.axes:
        axes = ' × '.join(axis.name for axis in data.axes)
        text += f' over {axes}, {format_count(int(np.prod(data.shape)), "point")}'
    text += f': {format_count(len(data.rows), "run")}'
    if not data.refined:
        return f'{text}.'
    return (f'{text} near the boundary only. Any other point is shown as the nearest one that was '
            'run. Shares are those of the runs made.')


def failure_table(data: MapData) -> Table:
    """Return the table of failures by variant and kind."""
    kinds = [name for name in KINDS if (data.rows['failure'] == name).any()]
    rows = []
    for v, name in enumerate(data.variants):
        runs = data.variant_rows(v)
        failure = runs['failure']
        failed = [failure != '', *map(failure.eq, kinds)]
        error = np.sort(runs['error'])
        quantiles = [error[int(np.ceil(q * len(error))) - 1] for q in (0.5, 0.95)]
        rows.append([
            name, f'{len(runs)}', *(_share_text(x, runs['repeat']) for x in failed),
            two_lines(*(f'{x:.2e}' if np.isfinite(x) else 'diverged' for x in quantiles))])
    return Table(
        '', ['law', 'runs', 'fail', *kinds, 'median error [rad], 95 % quantile'], rows, note=(
            'Below each share is its 95 % interval for other draws on this grid, as wide as the '
            'draws differ. A single draw has none. A run counts under the first kind that '
            'applies. One that diverged has an infinite error.'))


def _share_text(failed: Any, repeat: Any) -> str:
    """Return the share of failed runs, with any interval."""
    draws = failed.groupby(repeat).agg(['sum', 'count'])
    low, high = pooled_interval(draws['sum'], draws['count'])
    share = f'{100.0 * failed.mean():.1f} %'
    if np.isnan(low):
        return share
    return two_lines(share, f'{100.0 * low:.1f} to {100.0 * high:.1f}')


def base_tables(data: MapData) -> Iterator[Table]:
    """Yield any table of laws against the base."""
    if data.base is None or len(data.variants) == 1:
        return
    base = data.variants[data.base]
    counts = compare_with_base(data, data.base)
    yield Table(f'Against {base}', ['law', 'runs', 'only the law fails', f'only {base} fails'],
                [[law, *map(str, row)] for law, row in counts.iterrows()],
                note='Both runs of a pair have the same point, draw and noise.')


def _passing_tables(data: MapData) -> Iterator[Table]:
    """Yield a table of passing values for each axis."""
    for k, axis in enumerate(data.axes):
        values = passing_values(data, k)
        rows = spaced_indices(len(values), 60)
        yield Table(
            f'Values of {axis.label} at which less than half of the runs fail',
            [', '.join(x.name for x in data.axes if x is not axis), *data.variants],
            [[values.index[row] or axis.label, *values.iloc[row]] for row in rows],
            note=f'{len(rows)} of {len(values)} rows.' if len(rows) < len(values) else '')
