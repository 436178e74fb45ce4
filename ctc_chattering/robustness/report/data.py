"""Rows of a map on the grid of its axes: failures, and quantiles of the error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from functools import cached_property
import itertools
from typing import Any

from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.robustness.report.axis import GridAxis
from ctc_chattering.robustness.report.boundary import share
import numpy as np
import numpy.typing as npt

Counts = npt.NDArray[np.int64]
#: Law whose error is the measure of the others'.
BASE = 'compensation'
#: Kinds of failure, the worst first.
KINDS = ('diverged', 'error', 'saturated', 'not reached', 'too long', 'refused')
#: Columns of the results that `map_data` reads, besides axes and uncertain parameters.
COLUMNS = ('run', 'repeat', 'seed', 'variant', 'law', 'engine', 'failure', 'error')
#: Of the error.
QUANTILES = (0.05, 0.5, 0.95)


@dataclasses.dataclass(frozen=True)
class MapData:
    """
    The runs of a map.

    V variants and N runs; `shape` is the number of values of each axis. The error of a run that
    has none, because it diverged or was refused, is infinite.

    Attributes
    ----------
    axes : tuple of GridAxis
        Those with two values or more.
    fixed : tuple of GridAxis
        The others, of one value.
    uncertain : tuple of str
        Names of the parameters that were drawn.
    variants, laws : tuple of str, V each
        Names in the order of the rows, and the law of each.
    columns : mapping of str to ndarray, shape (N,)
        Value of each axis and uncertain parameter in each run.
    variant, point : ndarray of int, shape (N,)
        Index of the variant, and of the point within `shape`, flat.
    error : ndarray, shape (N,)
        RMS error, the largest of the joints [rad].
    failure : ndarray of int, shape (N,)
        Index in `KINDS`; -1 for none.
    run, draw : ndarray of int, shape (N,)
        Number of the run, and the repeat.
    seeds : (int, int)
        Smallest and largest.
    engines : mapping of str to int
        Runs of each engine.

    """

    axes: tuple[GridAxis, ...]
    fixed: tuple[GridAxis, ...]
    uncertain: tuple[str, ...]
    variants: tuple[str, ...]
    laws: tuple[str, ...]
    columns: Mapping[str, Array]
    variant: Counts
    point: Counts
    error: Array
    failure: Counts
    run: Counts
    draw: Counts
    seeds: tuple[int, int]
    engines: Mapping[str, int]

    @property
    def shape(self) -> tuple[int, ...]:
        """Return the number of values of each axis."""
        return tuple(len(axis.values) for axis in self.axes)

    @property
    def base(self) -> int | None:
        """Index of the first variant under law `BASE`, if there is one."""
        return self.laws.index(BASE) if BASE in self.laws else None

    @cached_property
    def runs(self) -> Counts:
        """Return the number of runs, shape (V, *shape)."""
        return self._count(np.ones(len(self.variant), bool))

    @cached_property
    def failed(self) -> Counts:
        """Return the number of runs that failed in any way, shape (V, *shape)."""
        return self._count(self.failure >= 0)

    @cached_property
    def refused(self) -> Counts:
        """Return the number of runs that the law or the plant refused, shape (V, *shape)."""
        return self._count(self.failure == KINDS.index('refused'))

    @property
    def probability(self) -> Array:
        """Share of failures, shape (V, *shape); nan without a run."""
        return share(self.failed, self.runs)

    @cached_property
    def quantiles(self) -> Array:
        """`QUANTILES` of the error, shape (3, V, *shape); infinite, or nan without a run."""
        return _quantiles(self.error, self._cell, self.runs.ravel(), QUANTILES).reshape(
            len(QUANTILES), *self.runs.shape)

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
        return np.array([np.bincount(self.variant[self.failure == k],
                                     minlength=len(self.variants)) for k in range(len(KINDS))])

    def of_draws(self, variant: int, kind: int | None = None) -> tuple[Counts, Counts]:
        """Return failures, of one of `KINDS` or all, and runs of each draw, shape (draws,)."""
        mine = self.variant == variant
        failed = mine & (self.failure >= 0 if kind is None else self.failure == kind)
        size = int(self.draw.max()) + 1
        return (np.bincount(self.draw[failed], minlength=size),
                np.bincount(self.draw[mine], minlength=size))

    @property
    def _cell(self) -> Counts:
        points = int(np.prod(self.shape, dtype=np.int64))
        cell: Counts = self.variant * points + self.point
        return cell

    def _count(self, which: npt.NDArray[np.bool_]) -> Counts:
        size = len(self.variants) * int(np.prod(self.shape, dtype=np.int64))
        return np.bincount(self._cell[which], minlength=size).reshape(
            len(self.variants), *self.shape)


def map_data(table: Any, axes: Mapping[str, str], uncertain: Sequence[str] = ()) -> MapData:
    """
    Return the rows of a map on its grid.

    Parameters
    ----------
    table : pyarrow.Table
        A row a run, with `COLUMNS`. Runs may be missing.
    axes : mapping of str to str
        Name and unit of each axis, in the order of the map.
    uncertain : sequence of str
        Names of the parameters that were drawn.

    Raises
    ------
    CtcError
        If there is no row, or a kind of failure is unknown.

    """
    if not len(table):
        raise CtcError('no run in the results')
    columns = {name: np.asarray(table[name], float) for name in (*axes, *uncertain)}
    every = [GridAxis(name, tuple(np.unique(columns[name]).tolist()),
                      unit.replace('*', '·').replace('^2', '²')) for name, unit in axes.items()]
    wide = tuple(axis for axis in every if len(axis.values) > 1)
    point = np.zeros(len(table), np.int64)
    for axis in wide:
        point = point * len(axis.values) + np.searchsorted(axis.values, columns[axis.name])
    variants, variant = _coded(table['variant'])
    laws, law = _coded(table['law'])
    failure = _kinds(table['failure'])
    error = np.asarray(table['error'], float)
    error = np.where(np.isnan(error), np.inf, error)
    seed = np.asarray(table['seed'])
    engines, engine = _coded(table['engine'])
    _, first = np.unique(variant, return_index=True)
    return MapData(
        wide, tuple(axis for axis in every if axis not in wide), tuple(uncertain),
        tuple(variants), tuple(laws[k] for k in law[first]), columns, variant, point, error,
        failure, np.asarray(table['run']), np.asarray(table['repeat']),
        (int(seed.min()), int(seed.max())), dict(zip(engines, np.bincount(engine).tolist())))


def slices(data: MapData, most: int) -> tuple[list[tuple[int, ...]], int]:
    """Return indices of the axes after the third, at most `most`, and how many there are."""
    every = list(itertools.product(*(range(n) for n in data.shape[3:])))
    return [every[k] for k in spaced(len(every), most)], len(every)


def spaced(n: int, most: int) -> list[int]:
    """Return at most `most` of n indices, evenly spaced, the first and the last among them."""
    return sorted({round(x) for x in np.linspace(0, n - 1, min(n, most)).tolist()})


def _coded(column: Any) -> tuple[list[str], Counts]:
    """Return the texts of a column in the order in which they come, and the index of each row."""
    coded = column.combine_chunks().dictionary_encode()
    return coded.dictionary.to_pylist(), np.asarray(coded.indices, np.int64)


def _kinds(column: Any) -> Counts:
    """Return the index in `KINDS` of each row; -1 for the empty text."""
    names, code = _coded(column)
    unknown = sorted(set(names) - {*KINDS, ''})
    if unknown:
        raise CtcError(f'failure: {unknown[0]!r} is not allowed; allowed: {", ".join(KINDS)}')
    return np.array([KINDS.index(name) if name else -1 for name in names])[code]


def _quantiles(values: Array, cell: Counts, runs: Counts, wanted: Sequence[float]) -> Array:
    """
    Return quantiles of the values of each cell, interpolated, shape (len(wanted), len(runs)).

    `runs` is the number of values of each cell. Values may be infinite; an empty cell has nan.
    """
    ordered = np.append(values[np.lexsort((values, cell))], np.nan)
    start = np.cumsum(runs) - runs
    found = np.empty((len(wanted), len(runs)))
    for row, q in zip(found, wanted):
        place = q * np.maximum(runs - 1, 0)
        below = np.floor(place).astype(np.int64)
        part = place - below
        low, high = ordered[start + below], ordered[start + np.ceil(place).astype(np.int64)]
        with np.errstate(invalid='ignore'):
            row[:] = np.where(part > 0.0, (1.0 - part) * low + part * high, low)
    found[:, runs == 0] = np.nan
    return found
