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

"""Rows of a map on the grid of its axes: failures, and quantiles of the error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
import itertools
from typing import Any

from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import unit_text
from ctc_chattering.robustness.report.axis import GridAxis
from ctc_chattering.robustness.report.boundary import share
import numpy as np
import numpy.typing as npt
import pandas  # type: ignore[import-untyped]

Counts = npt.NDArray[np.int64]
#: Law whose error is the measure of the others'.
BASE = 'compensation'
#: Kinds of failure, the worst first.
KINDS = ('diverged', 'error', 'saturated', 'slips', 'not reached', 'too long', 'refused')
#: Columns of the results that are read, besides axes and uncertain parameters.
COLUMNS = ('run', 'repeat', 'seed', 'variant', 'law', 'engine', 'failure', 'error')
#: Of the error.
QUANTILES = (0.05, 0.5, 0.95)
#: Distance of two values of an axis that was not refined.
_FAR = 1e6
#: In place of an infinite error where one interpolates, and what only such errors exceed.
_HUGE, _LARGE = 1e300, 1e290


class MapData:
    """
    The runs of a map: V variants, and for each a grid of the shape of the axes.

    Parameters
    ----------
    table : pyarrow.Table
        A row a run, with `COLUMNS`. Runs may be missing.
    axes : mapping of str to str
        Name and unit of each axis, in the order of the map.
    uncertain : sequence of str
        Names of the parameters that were drawn.
    refined : sequence of str
        Names of axes along which only points near the boundary were run: another point of the
        grid counts as the nearest one along them that was run; `rows` has those that were run.
    saltelli : bool
        Whether draws are such that Sobol indices follow.

    Attributes
    ----------
    rows : pandas.DataFrame
        The columns that are read; a run without an error has an infinite one.
    axes, fixed : tuple of GridAxis
        Axes with two values or more, and those of one.
    uncertain : tuple of str
        As given.
    variants, laws : tuple of str, V each
        Names in the order of the rows, and the law of each.

    Raises
    ------
    CtcError
        If there is no row, or a kind of failure is unknown.

    """

    def __init__(self, table: Any, axes: Mapping[str, str], uncertain: Sequence[str] = (),
                 refined: Sequence[str] = (), saltelli: bool = False) -> None:
        if not len(table):
            raise CtcError('no run in the results')
        self.rows = rows = table.select([*COLUMNS, *axes, *uncertain]).to_pandas()
        if unknown := sorted({*rows['failure']} - {*KINDS, ''}):
            raise CtcError(
                f'failure: {unknown[0]!r} is not allowed; allowed: {", ".join(KINDS)}')
        rows['error'] = rows['error'].fillna(np.inf)
        every = [GridAxis(name, tuple(np.unique(rows[name]).tolist()), unit_text(unit))
                 for name, unit in axes.items()]
        self.axes = tuple(x for x in every if len(x.values) > 1)
        self.fixed = tuple(x for x in every if len(x.values) == 1)
        self.uncertain, self.refined, self.saltelli = tuple(uncertain), tuple(refined), saltelli
        first = rows.drop_duplicates('variant')
        self.variants, self.laws = tuple(first['variant']), tuple(first['law'])
        self._cells = [pandas.Categorical(rows['variant'], self.variants), *(
            pandas.Categorical(rows[x.name], x.values) for x in self.axes)]

    @property
    def shape(self) -> tuple[int, ...]:
        """Return the number of values of each axis."""
        return tuple(len(axis.values) for axis in self.axes)

    @property
    def columns(self) -> list[str]:
        """Return the names of all axes and uncertain parameters."""
        return [name for name in self.rows.columns if name not in COLUMNS]

    @property
    def base(self) -> int | None:
        """Index of the first variant under law `BASE`, if there is one."""
        return self.laws.index(BASE) if BASE in self.laws else None

    def of(self, variant: int) -> pandas.DataFrame:
        """Return the rows of a variant."""
        return self.rows[self.rows['variant'] == self.variants[variant]]

    def _grid(self, column: pandas.Series, what: str, *arguments: Any) -> Any:
        """Return what `what` of each cell is, shape (V, *shape)."""
        found = getattr(column.groupby(self._cells, observed=False), what)(*arguments)
        values = found.to_numpy().reshape(len(self.variants), *self.shape)
        return values[self._nearest] if self.refined else values

    @cached_property
    def _nearest(self) -> tuple[npt.NDArray[np.int_], ...]:
        """Return indices of the nearest points that were run, each of shape (V, *shape)."""
        from scipy.ndimage import distance_transform_edt  # type: ignore[import-untyped]
        count = self.rows['error'].groupby(self._cells, observed=False).size().to_numpy()
        none = count.reshape(len(self.variants), *self.shape) == 0
        along = [1.0 if axis.name in self.refined else _FAR for axis in self.axes]
        found = [distance_transform_edt(x, along, return_distances=False, return_indices=True)
                 for x in none]
        first = np.arange(len(none)).reshape(-1, *(1,) * len(self.shape))
        return (np.broadcast_to(first, none.shape), *np.stack(found, axis=1))

    @cached_property
    def runs(self) -> Counts:
        """Return the number of runs, shape (V, *shape)."""
        found: Counts = self._grid(self.rows['error'], 'size')
        return found

    @cached_property
    def failed(self) -> Counts:
        """Return the number of runs that failed in any way, shape (V, *shape)."""
        found: Counts = self._grid((self.rows['failure'] != '').astype(int), 'sum')
        return found

    @cached_property
    def refused(self) -> Counts:
        """Return the number of runs that the law or the plant refused, shape (V, *shape)."""
        found: Counts = self._grid((self.rows['failure'] == 'refused').astype(int), 'sum')
        return found

    @property
    def probability(self) -> Array:
        """Share of failures, shape (V, *shape); nan without a run."""
        return share(self.failed, self.runs)

    @cached_property
    def quantiles(self) -> Array:
        """`QUANTILES` of the error, shape (3, V, *shape); infinite, or nan without a run."""
        error = self.rows['error'].clip(upper=_HUGE)
        found = np.array([self._grid(error, 'quantile', q) for q in QUANTILES])
        return np.where(found > _LARGE, np.inf, found)

    @property
    def median(self) -> Array:
        """Median of the error, shape (V, *shape)."""
        middle: Array = self.quantiles[1]
        return middle

    @property
    def repeats(self) -> int:
        """Largest number of runs of a variant at a point."""
        return int(self.runs.max(initial=0))

    @cached_property
    def kinds(self) -> Counts:
        """Return the number of failures of each of `KINDS` and variant, shape (6, V)."""
        counts = pandas.crosstab(self.rows['failure'], self.rows['variant'])
        found: Counts = counts.reindex(KINDS, columns=self.variants, fill_value=0).to_numpy()
        return found

    def of_draws(self, variant: int, kind: int | None = None) -> tuple[Counts, Counts]:
        """Return failures, of one of `KINDS` or all, and runs of each draw, shape (draws,)."""
        rows = self.of(variant)
        failed = rows['failure'] != '' if kind is None else rows['failure'] == KINDS[kind]
        found = failed.groupby(rows['repeat']).agg(['sum', 'count'])
        return found['sum'].to_numpy(), found['count'].to_numpy()


def slices(data: MapData, most: int) -> tuple[list[tuple[int, ...]], int]:
    """Return indices of the axes after the third, at most `most`, and how many there are."""
    every = list(itertools.product(*(range(n) for n in data.shape[3:])))
    return [every[k] for k in spaced(len(every), most)], len(every)


def spaced(n: int, most: int) -> list[int]:
    """Return at most `most` of n indices, evenly spaced, the first and the last among them."""
    return sorted({round(x) for x in np.linspace(0, n - 1, min(n, most)).tolist()})
