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

"""Numbers of a map: where a law fails, alone or with the base, and which values pass."""

from __future__ import annotations

import dataclasses
import itertools

from ctc_chattering.analysis.number_format import span
from ctc_chattering.robustness.report.boundary import LEVEL, passing_ranges
from ctc_chattering.robustness.report.data import MapData, spaced
import numpy as np
import numpy.typing as npt

#: Most rows of a table.
_ROWS = 60


@dataclasses.dataclass(frozen=True)
class Contrast:
    """
    A law against the base, point by point and draw by draw.

    Attributes
    ----------
    runs : int
        Runs that both have.
    worse, better : int
        Runs in which only the law, or only the base, failed.
    points : str
        Where half of the law's runs or more fail, and less of the base's; empty for nowhere.
    larger : int
        Runs in which the law has the larger error; one that diverged has the largest.
    loss : float
        Largest error of a run over that of the base; 0 where no run of both has one.
    run, where : int, str
        Number and point of the run of that loss.

    """

    runs: int
    worse: int
    better: int
    points: str
    larger: int
    loss: float
    run: int
    where: str


def contrast(data: MapData, variant: int, base: int) -> Contrast:
    """Return a variant against another."""
    both = data.of(variant).merge(data.of(base), suffixes=('', '_base'), on=[
        *(axis.name for axis in data.axes), 'repeat'])
    failed, failed_base = both['failure'] != '', both['failure_base'] != ''
    error, original = both['error'], both['error_base']
    usable = np.isfinite(error) & np.isfinite(original) & (original > 0.0)
    ratio = (error / original).where(usable, 0.0).to_numpy()
    worst = both.iloc[int(ratio.argmax())] if len(both) else {'run': 0}
    p = data.probability
    alone = (p[variant] >= LEVEL) & (p[base] < LEVEL)
    return Contrast(
        len(both), int((failed & ~failed_base).sum()), int((failed_base & ~failed).sum()),
        extent(data, alone) if data.axes else '', int((error > original).sum()),
        float(ratio.max(initial=0.0)), int(worst['run']), ', '.join(
            axis.text(worst[axis.name]) for axis in data.axes if axis.name in worst))


def extent(data: MapData, points: npt.NDArray[np.bool_]) -> str:
    """Return how many points these are, and between which values of each axis."""
    found = np.nonzero(points)
    if not len(found[0]):
        return ''
    spans = ', '.join(
        f'{axis.name} ' + span(axis.values[int(k.min())], axis.values[int(k.max())])
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
    return ', '.join(span(*ends) for ends in found) or 'none'
