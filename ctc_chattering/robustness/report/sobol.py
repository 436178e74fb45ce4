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

"""Sobol indices: which part of the variance of a result is due to what is uncertain."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.legends import legend_of
from ctc_chattering.analysis.tables import Table, two_lines
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.robustness.report.data import MapData
from ctc_chattering.robustness.report.lines import names_on
from matplotlib.figure import Figure
import numpy as np
import numpy.typing as npt

#: Resamples of the intervals, and the ends of these.
_RESAMPLES, _ENDS = 500, (2.5, 97.5)


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


def sensitivities(data: MapData) -> Iterator[tuple[str, str, SobolIndices]]:
    """
    Yield law, result and indices of the results that vary.

    Of the error its logarithm, if all runs have one; of failures whether a run fails.
    """
    for v, name in enumerate(data.variants):
        rows = data.of(v).sort_values('repeat')
        error = rows['error'].to_numpy()
        results = {'fails': (rows['failure'] != '').to_numpy(float)}
        if np.isfinite(error).all() and (error > 0.0).all():
            results = {'log error': np.log10(error), **results}
        for result, values in results.items():
            if np.ptp(values) > 0.0:
                yield name, result, sobol_indices(values, len(data.uncertain))


def sobol_table(data: MapData) -> Table:
    """Return the table of a page: a row for each law and result, two columns a quantity."""
    rows = []
    for name, result, found in sensitivities(data):
        cells = []
        for k in range(len(data.uncertain)):
            for value, ends in ((found.first, found.first_ends), (found.total, found.total_ends)):
                cells.append(two_lines(f'{value[k]:.2f}', ' to '.join(
                    f'{x:.2f}' for x in ends[:, k])))
        rows.append([name, result, *cells])
    heads = [f'{name}{what}' for name in data.uncertain for what in ('', ', total')]
    return Table('Sobol indices', ['law', 'of', *heads], rows, names=2, note=(
        'Part of the variance of log₁₀ of the RMS error, and of whether a run fails, that is due '
        'to a quantity alone, and in total with all that it does together with others; below, '
        'intervals of 95 % (bootstrap). The error is left out where a run has none.'))


def sobol_figure(data: MapData) -> Figure:
    """Draw the indices of each law and result."""
    found = list(sensitivities(data))
    columns, names = min(len(found), 3), data.uncertain
    left = min(3.4, 0.4 + 0.075 * max(map(len, names)))
    figure, grid = drawing.sheet('What the result depends on', -(-len(found) // columns),
                                 (1.0,) * columns, 0.36 * len(names) + 0.4, left=left)
    place = np.arange(len(names))
    for k, (name, result, x) in enumerate(found):
        ax = drawing.panel(figure, grid[k // columns, k % columns], f'{name}: {result}', '')
        for shift, colour, label, value, ends in (
                (-0.18, '#0072B2', 'alone', x.first, x.first_ends),
                (0.18, '#9ecae1', 'total', x.total, x.total_ends)):
            ax.barh(place + shift, value, height=0.34, color=colour, label=label)
            ax.hlines(place + shift, *ends, color='#555555', linewidth=1.2)
        ax.set(xlabel='part of the variance', xlim=(0.0, 1.05))
        ax.grid(False, axis='y')
        names_on(ax, names if not k % columns else [''] * len(names))
    legend_of(figure.axes[0])
    return figure
