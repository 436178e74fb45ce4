"""Numbers of a map: where a law fails, alone or with the base, and which values pass."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import numpy.typing as npt

from ctc_chattering.robustness.boundary import LEVEL, passing_ranges
from ctc_chattering.robustness.map_axis import number
from ctc_chattering.robustness.map_data import MapData, spaced

#: Most rows of a table.
_ROWS = 60


@dataclasses.dataclass(frozen=True)
class Contrast:
    """
    Failures of a law against those of the base, point by point and draw by draw.

    Attributes
    ----------
    runs : int
        Runs that both have.
    worse, better : int
        Runs in which only the law, or only the base, failed.
    points : str
        Where half of the law's runs or more fail, and less of the base's; empty for nowhere.
    loss : float
        Largest error of the law over that of the base, of the medians; 1 if never larger.
    where : str
        Point of that loss; empty without axes.

    """

    runs: int
    worse: int
    better: int
    points: str
    loss: float
    where: str


def contrast(data: MapData, variant: int, base: int) -> Contrast:
    """Return the failures of a variant against those of another."""
    mine, other = _outcomes(data, variant), _outcomes(data, base)
    both = (mine >= 0) & (other >= 0)
    p = data.probability
    alone = (p[variant] >= LEVEL) & (p[base] < LEVEL)
    median, original = data.median[variant], data.median[base]
    usable = np.isfinite(median) & np.isfinite(original) & (original > 0.0)
    ratio = np.divide(median, original, out=np.zeros(median.shape), where=usable)
    worst = np.unravel_index(int(np.argmax(ratio)), ratio.shape) if ratio.ndim else ()
    return Contrast(
        int(both.sum()), int((both & (mine > other)).sum()), int((both & (mine < other)).sum()),
        extent(data, alone) if data.axes else '', max(1.0, float(ratio.max())),
        ', '.join(axis.at(int(k)) for axis, k in zip(data.axes, worst)))


def extent(data: MapData, points: npt.NDArray[np.bool_]) -> str:
    """Return how many points these are, and between which values of each axis."""
    found = np.nonzero(points)
    if not len(found[0]):
        return ''
    spans = ', '.join(
        f'{axis.name} ' + _span(axis.values[int(k.min())], axis.values[int(k.max())])
        + f' {axis.unit}'.rstrip() for axis, k in zip(data.axes, found))
    return f'{len(found[0])} of {points.size} points, within {spans}'


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


def _ranges(values: tuple[float, ...], probability: npt.NDArray[np.float64]) -> str:
    if np.isnan(probability).all():
        return '–'
    found = passing_ranges(values, probability)
    if found == [(values[0], values[-1])]:
        return 'all'
    return ', '.join(_span(*ends) for ends in found) or 'none'


def _span(low: float, high: float) -> str:
    return number(low) if low == high else f'{number(low)} to {number(high)}'


def _outcomes(data: MapData, variant: int) -> npt.NDArray[np.int8]:
    """Return for every point and draw 1 for a failure, 0 for none, -1 without a run."""
    mine = data.variant == variant
    draws = int(data.draw.max()) + 1
    found = np.full(int(np.prod(data.shape, dtype=np.int64)) * draws, -1, np.int8)
    found[data.point[mine] * draws + data.draw[mine]] = data.failure[mine] >= 0
    return found
