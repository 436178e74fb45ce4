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
from functools import cached_property
import itertools
from typing import Any, NamedTuple

from ctc_chattering.analysis.tables import short, span, Table, two_lines
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import unit_text
import numpy as np
import numpy.typing as npt
import pandas  # type: ignore[import-untyped]
from scipy.special import ndtri, stdtrit  # type: ignore[import-untyped]

Counts = npt.NDArray[np.int64]
#: Failure probability of the boundary, and confidence of all intervals.
LEVEL, CONFIDENCE = 0.5, 0.95
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

    def text(self, value: float) -> str:
        """Return a value in words."""
        return f'{self.name} {short(value)} {self.unit}'.rstrip()

    def at(self, k: int) -> str:
        """Return the value with this index in words."""
        return self.text(self.values[k])


def wilson(failures: npt.ArrayLike, runs: npt.ArrayLike, confidence: float = CONFIDENCE
           ) -> tuple[Array, Array]:
    """
    Return Wilson's interval of a probability, without correction for continuity.

    Parameters
    ----------
    failures, runs : array_like of int
        Failures among independent runs; arrays that broadcast. Without a run: 0 and 1.
    confidence : float
        Probability that the interval contains the true one.

    Returns
    -------
    (ndarray, ndarray)
        Lower and upper ends.

    """
    k, n = np.broadcast_arrays(np.asarray(failures, float), np.asarray(runs, float))
    return _score_interval(k / np.maximum(n, 1.0), n, float(ndtri(0.5 + 0.5 * confidence)))


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


def side(failures: npt.ArrayLike, runs: npt.ArrayLike) -> npt.NDArray[np.int_]:
    """Return -1 where the interval is below `LEVEL`, 1 where it is above, 0 where it has both."""
    low, high = wilson(failures, runs)
    return (low > LEVEL).astype(int) - (high < LEVEL)


def passing_ranges(values: npt.ArrayLike, probability: npt.ArrayLike
                   ) -> list[tuple[float, float]]:
    """
    Return first and last value of each stretch of `values` where the law passes.

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
    return [(mine[0], mine[-1]) for mine in stretches]


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
        along = [_FAR ** 2, *(1.0 if x.name in self.refined else _FAR for x in self.axes)]
        return tuple(distance_transform_edt(none, along, return_distances=False,
                                            return_indices=True))

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

    @cached_property
    def kinds(self) -> Counts:
        """Return the number of failures of each of `KINDS` and variant, shape (7, V)."""
        counts = pandas.crosstab(self.rows['failure'], self.rows['variant'])
        found: Counts = counts.reindex(KINDS, columns=self.variants, fill_value=0).to_numpy()
        return found

    @cached_property
    def made(self) -> Counts:
        """Return the number of runs of each variant, shape (V,)."""
        return np.array([len(self.of(v)) for v in range(len(self.variants))])

    def of_draws(self, variant: int, kind: int | None = None) -> tuple[Counts, Counts]:
        """Return failures, of one of `KINDS` or all, and runs of each draw, shape (draws,)."""
        rows = self.of(variant)
        failed = rows['failure'] != '' if kind is None else rows['failure'] == KINDS[kind]
        found = failed.groupby(rows['repeat']).agg(['sum', 'count'])
        return found['sum'].to_numpy(), found['count'].to_numpy()


def spaced(n: int, most: int) -> list[int]:
    """Return at most `most` of n indices, evenly spaced, the first and the last among them."""
    return sorted({round(x) for x in np.linspace(0, n - 1, min(n, most)).tolist()})


def against(data: MapData, base: int) -> pandas.DataFrame:
    """
    Return a row for each other law against a base, the worst first.

    Of runs at the same point with the same draw: how many there are (`runs`), in how many only the
    law fails (`worse`), only the base (`better`), and the law has the larger error (`larger`; one
    that diverged has the largest). `loss` is the largest ratio of both errors, 0 where no run of
    both has one; `run` and the columns of the axes say where.
    """
    axes = [axis.name for axis in data.axes]
    both = data.rows[data.rows['variant'] != data.variants[base]].merge(
        data.of(base), on=[*axes, 'repeat'], suffixes=('', '_base'))
    failed, failed_base = both['failure'] != '', both['failure_base'] != ''
    error, original = both['error'], both['error_base']
    usable = np.isfinite(error) & np.isfinite(original) & (original > 0.0)
    both = both.assign(runs=1, worse=failed & ~failed_base, better=failed_base & ~failed,
                       larger=error > original, loss=(error / original).where(usable, 0.0))
    laws = both.groupby('variant', sort=False)
    found = laws[['runs', 'worse', 'better', 'larger']].sum()
    most = both.loc[laws['loss'].idxmax()].set_index('variant')
    return found.join(most[['loss', 'run', *axes]]).sort_values(
        ['worse', 'loss'], ascending=False, kind='stable')


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
    others = [k for k in range(len(data.axes)) if k != along]
    every = list(itertools.product(*(range(data.shape[k]) for k in others)))
    p = np.moveaxis(data.probability, 1 + along, -1)
    values = data.axes[along].values
    rows = [(', '.join(data.axes[k].at(i) for k, i in zip(others, every[row])),
             [_ranges(values, mine[every[row]]) for mine in p])
            for row in spaced(len(every), _ROWS)]
    return rows, len(every)


def _ranges(values: tuple[float, ...], probability: Array) -> str:
    if np.isnan(probability).all():
        return '–'
    found = passing_ranges(values, probability)
    if found == [(values[0], values[-1])]:
        return 'all'
    return ', '.join(span(*ends) for ends in found) or 'none'


def rank_correlations(data: MapData) -> Array:
    """
    Return Spearman's rank correlations, shape (V, axes and uncertain parameters).

    A run without an error counts as the largest; nan where one of both never changes.
    """
    ranks = [data.of(v)[[*data.columns, 'error']].rank() for v in range(len(data.variants))]
    return np.array([x.corr()['error'][data.columns] for x in ranks])


def dependence_table(data: MapData) -> Table:
    """Return the table of a page: a row a law, a column a quantity."""
    rows = [[name, *(f'{x:.2f}' for x in mine)]
            for name, mine in zip(data.variants, np.nan_to_num(rank_correlations(data)))]
    return Table('What the error depends on', ['law', *data.columns], rows, note=(
        'Rank correlation (Spearman) of the error with each quantity over all runs; a run that '
        'diverged has the largest error. Above 0 the error grows with the quantity.'))


class SobolIndices(NamedTuple):
    """Of each of m quantities: index of first order and total one; with ends, shape (2, m)."""

    first: Array
    total: Array
    first_ends: Array
    total_ends: Array


def sobol_indices(values: Array, m: int) -> SobolIndices:
    """
    Return the indices of what a run gives, for draws of `sampling: saltelli`.

    Estimators of SciPy (Saltelli et al., *Variance based sensitivity analysis of model output*,
    Computer Physics Communications 181, 2010); intervals of 95 % are percentiles of a bootstrap.

    Parameters
    ----------
    values : array, shape ((m + 2) n,)
        Of each draw, in their order.
    m : int
        Number of uncertain quantities.

    """
    from scipy import stats  # type: ignore[import-untyped]
    parts = np.asarray(values, float).reshape(m + 2, 1, -1)
    n, rng = parts.shape[-1], np.random.default_rng(0)

    def of(which: npt.NDArray[np.int_]) -> Array:
        A, B, *AB = parts[..., which]
        found = stats.sobol_indices(func={'f_A': A, 'f_B': B, 'f_AB': np.array(AB)}, n=n)
        return np.stack([found.first_order.reshape(m), found.total_order.reshape(m)])

    with np.errstate(divide='ignore', invalid='ignore'):
        first, total = of(np.arange(n))
        ends = np.nanpercentile([of(rng.integers(0, n, n)) for _ in range(_RESAMPLES)], _ENDS,
                                axis=0)
    return SobolIndices(first, total, ends[:, 0], ends[:, 1])


def sensitivities(data: MapData) -> list[tuple[str, str, SobolIndices]]:
    """
    Return law, result and indices of the results that vary, with draws for such indices.

    Of the error its logarithm, if all runs have one; of failures whether a run fails.
    """
    found = []
    for v, name in enumerate(data.variants if data.saltelli else ()):
        rows = data.of(v).sort_values('repeat')
        error = rows['error'].to_numpy()
        results = {'fails': (rows['failure'] != '').to_numpy(float)}
        if np.isfinite(error).all() and (error > 0.0).all():
            results = {'log error': np.log10(error), **results}
        found += [(name, result, sobol_indices(values, len(data.uncertain)))
                  for result, values in results.items() if np.ptp(values) > 0.0]
    return found


def sobol_table(data: MapData) -> Table:
    """Return the table of a page: a row for each law and result, two columns a quantity."""
    rows = [[name, result, *(
        two_lines(f'{value[k]:.2f}', ' to '.join(f'{x:.2f}' for x in ends[:, k]))
        for k in range(len(data.uncertain))
        for value, ends in ((found.first, found.first_ends), (found.total, found.total_ends)))]
        for name, result, found in sensitivities(data)]
    heads = [f'{name}{what}' for name in data.uncertain for what in ('', ', total')]
    return Table('Sobol indices', ['law', 'of', *heads], rows, names=2, note=(
        'Part of the variance of log₁₀ of the RMS error, and of whether a run fails, that is due '
        'to a quantity alone, and in total with all that it does together with others; below, '
        'intervals of 95 % (bootstrap). The error is left out where a run has none.'))
