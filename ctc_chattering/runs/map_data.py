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

"""The runs of a map as a DataFrame: failures with intervals, laws compared, what it depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import itertools
from typing import Any, NamedTuple

from ctc_chattering.analysis.tables import Table, two_lines
from ctc_chattering.control.laws.registry import BASELINE_LAW
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import unit_text
import numpy as np
import numpy.typing as npt
import pandas  # type: ignore[import-untyped]
from scipy.special import ndtri, stdtrit  # type: ignore[import-untyped]

Counts = npt.NDArray[np.int64]
#: Failure probability of the boundary, and confidence of all intervals.
LEVEL, CONFIDENCE = 0.5, 0.95
#: Kinds of failure, the worst first.
KINDS = ('diverged', 'error', 'saturated', 'slips', 'not reached', 'refused')
#: Columns of the results that are read, besides axes and uncertain parameters.
COLUMNS = ('run', 'repeat', 'seed', 'variant', 'law', 'engine', 'failure', 'error')
#: Of the error.
QUANTILES = (0.05, 0.5, 0.95)
#: Distance of two values of an axis that was not refined.
_FAR = 1e6
#: In place of an infinite error where one interpolates, and what only such errors exceed.
_HUGE, _LARGE = 1e300, 1e290
#: Most rows of a table.
_ROWS = 60
#: Resamples of the intervals of Sobol indices, and the ends of these.
_RESAMPLES, _ENDS = 500, (2.5, 97.5)


class GridAxis(NamedTuple):
    """An axis of a map: its column, the grid, ascending, and the unit, empty for a number."""

    name: str
    values: tuple[float, ...]
    unit: str = ''

    @property
    def label(self) -> str:
        """Name and unit."""
        return f'{self.name} [{self.unit}]' if self.unit else self.name

    def at(self, k: int) -> str:
        """Return the value with this index in words."""
        return f'{self.name} {self.values[k]:.4g} {self.unit}'.rstrip()


def wilson(failures: npt.ArrayLike, runs: npt.ArrayLike) -> tuple[Array, Array]:
    """
    Return Wilson's 95 % interval of a probability, without correction for continuity.

    Parameters
    ----------
    failures, runs : array_like of int
        Failures among independent runs; arrays that broadcast. Without a run: 0 and 1.

    Returns
    -------
    (ndarray, ndarray)
        Lower and upper ends.

    """
    k, n = np.broadcast_arrays(np.asarray(failures, float), np.asarray(runs, float))
    return _score_interval(k / np.maximum(n, 1.0), n, float(ndtri(0.5 + 0.5 * CONFIDENCE)))


def _score_interval(p: Array, n: Array, z: float) -> tuple[Array, Array]:
    """Return the ends where a share `p` of `n` runs is `z` standard deviations off."""
    middle, half = n * p + 0.5 * z * z, z * np.sqrt(n * p * (1.0 - p) + 0.25 * z * z)
    return (np.where(n * p > 0.0, (middle - half) / (n + z * z), 0.0),
            np.where(n * p < n, (middle + half) / (n + z * z), 1.0))


def pooled(failures: npt.ArrayLike, runs: npt.ArrayLike) -> tuple[float, float]:
    """
    Return the 95 % interval of a probability from runs at several points that share their draws.

    It is Wilson's for as many independent runs as would vary as much as the draws do, with
    Student's quantile in place of the normal one. Where no run fails, or every one, there are
    as many as draws. A bootstrap over draws has no width there, and covers too little where
    failures are rare.

    Parameters
    ----------
    failures, runs : array_like of int, shape (m,)
        Of each draw, over all points.

    Returns
    -------
    (float, float)
        Lower and upper end; nan for a single draw, which does not show what others do.

    """
    n = np.asarray(runs, float)
    k, n = np.asarray(failures, float)[n > 0.0], n[n > 0.0]
    m, total = len(n), float(n.sum())
    if total == m:
        low, high = wilson(k.sum(), total)
        return float(low), float(high)
    if m < 2:
        return np.nan, np.nan
    p = k.sum() / total
    variance = m / (m - 1.0) * np.square(k - p * n).sum() / total ** 2
    likely = p * (1.0 - p)
    independent = m if likely == 0.0 else min(total, likely / variance) if variance else total
    low, high = _score_interval(np.asarray(p), np.asarray(float(independent)),
                                float(stdtrit(m - 1, 0.5 + 0.5 * CONFIDENCE)))
    return float(low), float(high)


def share(failures: npt.ArrayLike, runs: npt.ArrayLike) -> Array:
    """Return failures / runs; nan without a run."""
    k, n = np.broadcast_arrays(np.asarray(failures, float), np.asarray(runs, float))
    found: Array = np.divide(k, n, out=np.full(k.shape, np.nan), where=n > 0.0)
    return found


def passing_ranges(values: npt.ArrayLike, probability: npt.ArrayLike) -> str:
    """
    Return first and last value of each stretch of `values` where the law passes, as text.

    Parameters
    ----------
    values : array_like, shape (n,)
        Grid of one axis.
    probability : array_like, shape (n,)
        Failure probability there, nan where nothing is known; a law passes below `LEVEL`.

    """
    pairs: Any = zip(np.asarray(values).tolist(), np.asarray(probability).tolist())
    stretches = ([value for value, _ in stretch] for passes, stretch in itertools.groupby(
        pairs, key=lambda pair: pair[1] < LEVEL) if passes)
    return ', '.join(' to '.join(dict.fromkeys(f'{x:.4g}' for x in (mine[0], mine[-1])))
                     for mine in stretches) or 'none'


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
    axes : tuple of GridAxis
        Axes with two values or more.
    uncertain : tuple of str
        As given.
    variants, laws : tuple of str, V each
        Names in the order of the rows, and the law of each.
    base : int or None
        Index of the first variant under law `BASELINE_LAW`, if there is one.
    runs, failed : array, shape (V, *shape)
        How many runs there are at each point, and how many of them failed in any way.
    probability : array, shape (V, *shape)
        Share of failures; nan without a run.
    quantiles : array, shape (3, V, *shape)
        `QUANTILES` of the error; infinite, or nan without a run.
    median : array, shape (V, *shape)
        The middle one of these.

    """

    def __init__(self, table: Any, axes: Mapping[str, str], uncertain: Sequence[str] = (),
                 refined: Sequence[str] = (), saltelli: bool = False) -> None:
        self.rows = rows = table.select([*COLUMNS, *axes, *uncertain]).to_pandas()
        rows['error'] = rows['error'].fillna(np.inf)
        every = [GridAxis(name, tuple(np.unique(rows[name]).tolist()), unit_text(unit))
                 for name, unit in axes.items()]
        self.axes = tuple(x for x in every if len(x.values) > 1)
        self.uncertain, self.refined, self.saltelli = tuple(uncertain), tuple(refined), saltelli
        first = rows.drop_duplicates('variant')
        self.variants, self.laws = tuple(first['variant']), tuple(first['law'])
        self.base = self.laws.index(BASELINE_LAW) if BASELINE_LAW in self.laws else None

        def labels(name: str, values: Sequence[Any]) -> Any:
            # A column: of plain categories, as many as there are rows, pandas takes the list of
            # them for one of labels.
            return pandas.Series(pandas.Categorical(rows[name], values), rows.index)

        cells = [labels('variant', self.variants), *(labels(x.name, x.values) for x in self.axes)]

        def grid(column: Any, what: str, *arguments: Any) -> Any:
            found = getattr(column.groupby(cells, observed=False), what)(*arguments)
            return found.to_numpy().reshape(len(self.variants), *self.shape)

        self.runs: Counts = grid(rows['error'], 'size')
        self.failed: Counts = grid((rows['failure'] != '').astype(int), 'sum')
        error = rows['error'].clip(upper=_HUGE)
        self.quantiles: Array = np.array([grid(error, 'quantile', q) for q in QUANTILES])
        self.quantiles[self.quantiles > _LARGE] = np.inf
        if refined:
            from scipy.ndimage import distance_transform_edt  # type: ignore[import-untyped]
            along = [_FAR ** 2, *(1.0 if x.name in refined else _FAR for x in self.axes)]
            nearest = tuple(distance_transform_edt(self.runs == 0, along, return_distances=False,
                                                   return_indices=True))
            self.runs, self.failed = self.runs[nearest], self.failed[nearest]
            self.quantiles = np.array([each[nearest] for each in self.quantiles])
        self.probability = share(self.failed, self.runs)
        self.median = self.quantiles[1]

    @property
    def shape(self) -> tuple[int, ...]:
        """Return the number of values of each axis."""
        return tuple(len(axis.values) for axis in self.axes)

    def of(self, variant: int) -> pandas.DataFrame:
        """Return the rows of a variant."""
        return self.rows[self.rows['variant'] == self.variants[variant]]


def spaced(n: int, most: int) -> list[int]:
    """Return at most `most` of n indices, evenly spaced, the first and the last among them."""
    return sorted({round(x) for x in np.linspace(0, n - 1, min(n, most)).tolist()})


def against(data: MapData, base: int) -> pandas.DataFrame:
    """
    Return a row for each other law against a base, the worst first.

    Of runs at the same point with the same draw: how many there are (`runs`), and in how many only
    the law fails (`worse`), or only the base (`better`).
    """
    rows = data.rows.assign(failed=data.rows['failure'] != '')
    mine = rows['variant'] == data.variants[base]
    both = rows[~mine].merge(rows[mine], on=[*(axis.name for axis in data.axes), 'repeat'],
                             suffixes=('', '_base'))
    both = both.assign(runs=1, worse=both['failed'] & ~both['failed_base'],
                       better=both['failed_base'] & ~both['failed'])
    return both.groupby('variant', sort=False)[['runs', 'worse', 'better']].sum().sort_values(
        'worse', ascending=False, kind='stable')


def passing(data: MapData, along: int) -> tuple[list[tuple[str, list[str]]], int]:
    """
    Return which values of one axis pass at values of the others.

    Returns
    -------
    rows : list of (str, list of str)
        Values of the other axes, and the values that pass for each variant.
    count : int
        How many rows there are; of more than a page takes, some are returned.

    """
    p = np.moveaxis(data.probability, 1 + along, -1)
    others = [axis for k, axis in enumerate(data.axes) if k != along]
    every = list(np.ndindex(*p.shape[1:-1]))
    rows = [(', '.join(map(GridAxis.at, others, every[row])),
             [passing_ranges(data.axes[along].values, mine[every[row]]) for mine in p])
            for row in spaced(len(every), _ROWS)]
    return rows, len(every)


def sobol_indices(values: Array, m: int) -> tuple[Array, Array]:
    """
    Return the indices of what a run gives, for draws of `sampling: saltelli`, and their intervals.

    Estimators of SciPy (Saltelli et al., *Variance based sensitivity analysis of model output*,
    Computer Physics Communications 181, 2010); intervals of 95 % are percentiles of a bootstrap.

    Parameters
    ----------
    values : array, shape ((m + 2) n,)
        Of each draw, in their order.
    m : int
        Number of uncertain quantities.

    Returns
    -------
    indices : array, shape (m, 2)
        Of each quantity, that of first order and the total one.
    ends : array, shape (2, m, 2)
        Lower and upper ends of the intervals of these.

    """
    from scipy import stats  # type: ignore[import-untyped]
    parts = np.asarray(values, float).reshape(m + 2, 1, -1)
    n, rng = parts.shape[-1], np.random.default_rng(0)

    def of(which: npt.NDArray[np.int_]) -> Array:
        A, B, *AB = parts[..., which]
        found = stats.sobol_indices(func={'f_A': A, 'f_B': B, 'f_AB': np.array(AB)}, n=n)
        return np.stack([found.first_order.reshape(m), found.total_order.reshape(m)], -1)

    with np.errstate(divide='ignore', invalid='ignore'):
        resampled = [of(rng.integers(0, n, n)) for _ in range(_RESAMPLES)]
        return of(np.arange(n)), np.nanpercentile(resampled, _ENDS, axis=0)


def sobol_table(data: MapData) -> Table:
    """
    Return the table of a page: a row for each law and result that varies, two columns a quantity.

    Of the error it is the logarithm, if all runs have one; of failures whether a run fails.
    """
    rows = []
    for v, name in enumerate(data.variants if data.saltelli else ()):
        mine = data.of(v).sort_values('repeat')
        error = mine['error'].to_numpy()
        results = {'fails': (mine['failure'] != '').to_numpy(float)}
        if np.isfinite(error).all() and (error > 0.0).all():
            results = {'log error': np.log10(error), **results}
        for result, values in results.items():
            if np.ptp(values) > 0.0:
                indices, ends = sobol_indices(values, len(data.uncertain))
                rows.append([name, result, *(
                    two_lines(f'{index:.2f}', f'{low:.2f} to {high:.2f}')
                    for index, low, high in zip(indices.flat, *ends.reshape(2, -1)))])
    heads = [f'{name}{what}' for name in data.uncertain for what in ('', ', total')]
    return Table('Sobol indices', ['law', 'of', *heads], rows, names=2, note=(
        'Part of the variance of log₁₀ of the RMS error, and of whether a run fails, that is due '
        'to a quantity alone, and in total with all that it does together with others; below, '
        'intervals of 95 % (bootstrap). The error is left out where a run has none.'))
