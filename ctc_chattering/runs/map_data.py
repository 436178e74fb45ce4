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
Numbers of a map.

These are failures with intervals, comparisons of laws, and Sobol indices.

`map_page` and `map_figures` make a `MapData` of the table that `compute_map` returns. Wilson's
interval of a failure probability has its ends where the share of failures is z standard deviations
off.
"""

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
#: A law passes where less than this share of the runs fails.
PASSING_SHARE = 0.5
#: Kinds of failure, the worst first.
KINDS = ('diverged', 'error', 'saturated', 'slips', 'not reached', 'refused')
#: Quantiles of the error.
QUANTILES = (0.05, 0.5, 0.95)
#: Stands for an infinite error in quantiles, which interpolate.
_HUGE_ERROR = 1e300
#: Upper tail of a two-sided interval of 95 %.
_UPPER_TAIL = 0.975


class GridAxis(NamedTuple):
    """
    An axis of a map.

    Attributes
    ----------
    name : str
        Column of the table.
    values : tuple of float
        Grid, ascending.
    unit : str
        Empty for a number.

    """

    name: str
    values: tuple[float, ...]
    unit: str = ''

    @property
    def label(self) -> str:
        """Name and unit."""
        return f'{self.name} [{self.unit}]' if self.unit else self.name

    def value_text(self, k: int) -> str:
        """Return a value with name and unit."""
        return f'{self.name} {self.values[k]:.4g} {self.unit}'.rstrip()


def wilson_interval(failures: npt.ArrayLike, runs: npt.ArrayLike) -> tuple[Array, Array]:
    """
    Return Wilson's 95 % interval of a probability.

    There is no correction for continuity.

    Parameters
    ----------
    failures, runs : array_like of int
        Failures among independent runs, of shapes that broadcast. The interval without a run is 0
        to 1.

    Returns
    -------
    (ndarray, ndarray)
        Lower and upper ends.

    """
    k, n = np.broadcast_arrays(np.asarray(failures, float), np.asarray(runs, float))
    return _score_interval(k / np.maximum(n, 1.0), n, float(ndtri(_UPPER_TAIL)))


def _score_interval(p: Array, n: Array, z: float) -> tuple[Array, Array]:
    """Return the ends where `p` is `z` standard deviations off."""
    middle = n * p + 0.5 * z * z
    half = z * np.sqrt(n * p * (1.0 - p) + 0.25 * z * z)
    low = np.where(n * p > 0.0, (middle - half) / (n + z * z), 0.0)
    high = np.where(n * p < n, (middle + half) / (n + z * z), 1.0)
    return low, high


def pooled_interval(failures: npt.ArrayLike, runs: npt.ArrayLike) -> tuple[float, float]:
    """
    Return the 95 % interval of a probability from shared draws.

    The runs are at several points, with the same draws at each. It is Wilson's interval for fewer
    runs, with Student's quantile in place of the normal one. So many independent runs would vary
    as much as the draws do. Where all runs or none fail, there are as many as draws. A bootstrap
    over draws has no width there, and covers less than 95 % of rare failures.

    Parameters
    ----------
    failures, runs : array_like of int, shape (m,)
        Counts of each draw, over all points.

    Returns
    -------
    (float, float)
        Lower and upper end. They are nan for a single draw, which does not show what others do.

    """
    n = np.asarray(runs, float)
    k = np.asarray(failures, float)[n > 0.0]
    n = n[n > 0.0]
    m, total = len(n), float(n.sum())
    if total == m:
        low, high = wilson_interval(k.sum(), total)
        return float(low), float(high)
    if m < 2:
        return np.nan, np.nan
    p = k.sum() / total
    variance = m / (m - 1.0) * np.square(k - p * n).sum() / total ** 2
    binomial = p * (1.0 - p)
    if binomial == 0.0:
        independent = float(m)
    else:
        independent = min(total, binomial / variance) if variance else total
    low, high = _score_interval(
        np.asarray(p), np.asarray(independent), float(stdtrit(m - 1, _UPPER_TAIL)))
    return float(low), float(high)


def failure_share(failures: npt.ArrayLike, runs: npt.ArrayLike) -> Array:
    """Return failures / runs, and nan without a run."""
    k, n = np.broadcast_arrays(np.asarray(failures, float), np.asarray(runs, float))
    result: Array = np.divide(k, n, out=np.full(k.shape, np.nan), where=n > 0.0)
    return result


def passing_ranges(values: npt.ArrayLike, probability: npt.ArrayLike) -> str:
    """
    Return the stretches of values where a law passes, as text.

    Parameters
    ----------
    values : array_like, shape (n,)
        Grid of one axis.
    probability : array_like, shape (n,)
        Failure probability there, nan without a run.

    """
    passes = np.asarray(probability) < PASSING_SHARE
    ranges = []
    for is_passing, stretch in itertools.groupby(
            zip(passes, np.asarray(values)), key=lambda item: item[0]):
        if is_passing:
            texts = [f'{value:.4g}' for _, value in stretch]
            ranges.append(' to '.join(dict.fromkeys((texts[0], texts[-1]))))
    return ', '.join(ranges) or 'none'


class MapData:
    """
    Runs of V variants on a grid.

    Parameters
    ----------
    table : pyarrow.Table
        A row a run. Runs may be missing.
    axes : mapping of str to str
        Name and unit of each axis, in the order of the map.
    uncertain : sequence of str
        Names of the parameters that were drawn.
    refined : sequence of str
        Names of axes along which only points near the boundary were run. Another point of the
        grid counts as the nearest one along them, and `rows` has the runs alone.
    saltelli : bool
        Whether Sobol indices follow from the draws.

    Attributes
    ----------
    rows : pandas.DataFrame
        Runs. One without an error has an infinite one.
    axes : tuple of GridAxis
        Axes with two values or more.
    uncertain : tuple of str
        The parameter.
    variants, laws : tuple of str, V each
        Names in the order of the rows, and the law of each.
    base : int or None
        Index of the first variant under law `BASELINE_LAW`, if there is one.
    runs, failed : array, shape (V, *shape)
        Number of runs at each point, and of those that failed in any way.
    probability : array, shape (V, *shape)
        Share of failures, and nan without a run.
    quantiles : array, shape (3, V, *shape)
        `QUANTILES` of the error, and nan without a run.
    median : array, shape (V, *shape)
        Median of the error.

    """

    def __init__(self, table: Any, axes: Mapping[str, str], uncertain: Sequence[str] = (),
                 refined: Sequence[str] = (), saltelli: bool = False) -> None:
        self.rows = rows = table.select(
            ['repeat', 'variant', 'law', 'failure', 'error', *axes, *uncertain]).to_pandas()
        rows['error'] = rows['error'].fillna(np.inf)
        grids = [GridAxis(name, tuple(np.unique(rows[name]).tolist()), unit_text(unit))
                 for name, unit in axes.items()]
        self.axes = tuple(axis for axis in grids if len(axis.values) > 1)
        self.uncertain = tuple(uncertain)
        self.refined = tuple(refined)
        self.saltelli = saltelli
        first = rows.drop_duplicates('variant')
        self.variants = tuple(first['variant'])
        self.laws = tuple(first['law'])
        self.base = self.laws.index(BASELINE_LAW) if BASELINE_LAW in self.laws else None

        cells = {'variant': self.variants, **{axis.name: axis.values for axis in self.axes}}
        # A Series each: pandas takes a list of plain categories for one of labels if there are as
        # many as rows.
        labels = [pandas.Series(pandas.Categorical(rows[name], values), rows.index)
                  for name, values in cells.items()]
        columns = pandas.DataFrame({'error': rows['error'].clip(upper=_HUGE_ERROR),
                                    'failed': (rows['failure'] != '').astype(int)})
        points = columns.groupby(labels, observed=False)
        shape = len(self.variants), *self.shape
        self.runs: Counts = points.size().to_numpy().reshape(shape)
        self.failed: Counts = points['failed'].sum().to_numpy().reshape(shape)
        self.quantiles: Array = np.array([
            points['error'].quantile(q).to_numpy().reshape(shape) for q in QUANTILES])
        self.quantiles[self.quantiles > 1e-10 * _HUGE_ERROR] = np.inf
        if refined:
            self._extend_to_grid()
        self.probability = failure_share(self.failed, self.runs)
        self.median = self.quantiles[1]

    def _extend_to_grid(self) -> None:
        """Take the numbers of the nearest run at each point."""
        from scipy.ndimage import distance_transform_edt  # type: ignore[import-untyped]
        far = 1e6  # Distance between values of an axis that was not refined.
        spacing = [far ** 2, *(1.0 if axis.name in self.refined else far for axis in self.axes)]
        nearest = tuple(distance_transform_edt(
            self.runs == 0, spacing, return_distances=False, return_indices=True))
        self.runs = self.runs[nearest]
        self.failed = self.failed[nearest]
        self.quantiles = np.array([quantile[nearest] for quantile in self.quantiles])

    @property
    def shape(self) -> tuple[int, ...]:
        """Size of the grid along each axis."""
        return tuple(len(axis.values) for axis in self.axes)

    def variant_rows(self, variant: int) -> pandas.DataFrame:
        """Return the rows of a variant."""
        return self.rows[self.rows['variant'] == self.variants[variant]]


def spaced_indices(n: int, limit: int) -> list[int]:
    """Return up to `limit` of n indices, evenly spaced."""
    return sorted({round(x) for x in np.linspace(0, n - 1, min(n, limit)).tolist()})


def compare_with_base(data: MapData, base: int) -> pandas.DataFrame:
    """
    Count failures of each law beside those of a base.

    The worst law is first. Pairs of runs have the same point and draw. Columns are the number of
    pairs (`runs`), and of those in which only the law fails (`worse`) or only the base (`better`).
    """
    rows = data.rows.assign(failed=data.rows['failure'] != '')
    is_base = rows['variant'] == data.variants[base]
    pairs = rows[~is_base].merge(
        rows[is_base], on=[*(axis.name for axis in data.axes), 'repeat'], suffixes=('', '_base'))
    pairs = pairs.assign(runs=1, worse=pairs['failed'] & ~pairs['failed_base'],
                         better=pairs['failed_base'] & ~pairs['failed'])
    counts = pairs.groupby('variant', sort=False)[['runs', 'worse', 'better']].sum()
    return counts.sort_values('worse', ascending=False, kind='stable')


def passing_values(data: MapData, along: int) -> pandas.DataFrame:
    """
    Return the values of one axis that pass.

    A column has a variant, and a row the values of the other axes, which are its label.
    """
    probability = np.moveaxis(data.probability, 1 + along, -1)
    grid = [axis for k, axis in enumerate(data.axes) if k != along]
    labels = []
    cells = []
    for point in np.ndindex(probability.shape[1:-1]):
        labels.append(', '.join(map(GridAxis.value_text, grid, point)))
        cells.append([passing_ranges(data.axes[along].values, p[point]) for p in probability])
    return pandas.DataFrame(cells, labels, data.variants)


def sobol_indices(values: Array, m: int) -> tuple[Array, Array]:
    """
    Return Sobol indices with their intervals.

    Draws are those of `sampling: saltelli`. The estimators are SciPy's (Saltelli et al., *Variance
    based sensitivity analysis of model output*, Computer Physics Communications 181, 2010).
    Intervals of 95 % are percentiles of a bootstrap.

    Parameters
    ----------
    values : array, shape ((m + 2) n,)
        Result of each draw, in their order.
    m : int
        Number of uncertain quantities.

    Returns
    -------
    indices : array, shape (m, 2)
        Index of first order and total index of each quantity.
    ends : array, shape (2, m, 2)
        Lower and upper ends of the intervals of these.

    """
    from scipy import stats  # type: ignore[import-untyped]
    blocks = np.asarray(values, float).reshape(m + 2, 1, -1)
    n, rng = blocks.shape[-1], np.random.default_rng(0)

    def estimate(draws: npt.NDArray[np.int_]) -> Array:
        A, B, *AB = blocks[..., draws]
        result = stats.sobol_indices(func={'f_A': A, 'f_B': B, 'f_AB': np.array(AB)}, n=n)
        return np.stack([result.first_order.reshape(m), result.total_order.reshape(m)], -1)

    with np.errstate(divide='ignore', invalid='ignore'):
        resampled = [estimate(rng.integers(0, n, n)) for _ in range(500)]
        return estimate(np.arange(n)), np.nanpercentile(resampled, (2.5, 97.5), axis=0)


def sobol_table(data: MapData) -> Table:
    """
    Return the table of Sobol indices.

    It has two columns a quantity, and a row for each law and result. Results are the logarithm of
    the error, if all runs have one, and whether a run fails. One that does not vary has no row.
    """
    rows = []
    for v, name in enumerate(data.variants if data.saltelli else ()):
        runs = data.variant_rows(v).sort_values('repeat')
        error = runs['error'].to_numpy()
        results = {'fails': (runs['failure'] != '').to_numpy(float)}
        if np.isfinite(error).all() and (error > 0.0).all():
            results = {'log error': np.log10(error), **results}
        for result, values in results.items():
            if np.ptp(values) == 0.0:
                continue
            indices, (low, high) = sobol_indices(values, len(data.uncertain))
            rows.append([name, result, *(
                two_lines(f'{index:.2f}', f'{start:.2f} to {end:.2f}')
                for index, start, end in zip(indices.flat, low.flat, high.flat))])
    heads = [f'{name}{suffix}' for name in data.uncertain for suffix in ('', ', total')]
    return Table('Sobol indices', ['law', 'of', *heads], rows, names=2, note=(
        'The share of the variance of a result that is due to one quantity alone, and in total '
        'with its effects together with others. Results are log₁₀ of the RMS error and whether a '
        'run fails. Below are intervals of 95 % (bootstrap). The error has no row where a run has '
        'none.'))
