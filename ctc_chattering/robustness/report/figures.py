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

"""Figures of a map: error, failure probability and gain over the grid of its axes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.legends import legend
from ctc_chattering.analysis.number_format import short
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.robustness.report.axis import round_decades
from ctc_chattering.robustness.report.data import MapData, slices
from ctc_chattering.robustness.report.draws import correlations, distributions, shares
from ctc_chattering.robustness.report.lines import bands, lines
from ctc_chattering.robustness.report.panels import boundary, LINES, mesh, sheet, states, THIRD
from ctc_chattering.robustness.report.sobol import sensitivities, sobol_figure
import matplotlib
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
import numpy as np

#: Most figures of a kind, for combinations of values of the axes after the third.
MOST = 4
#: Where a gain has no number: the base or this law diverged.
_BETTER, _WORSE = '#08203d', '#4a0410'


def error_map(data: MapData, rest: tuple[int, ...] = ()) -> Figure:
    """Draw the median error, colours on a logarithmic scale that all panels share."""
    found = sheet(data, _title(data, 'RMS error', rest), range(len(data.variants)), rest)
    shown = [place.cells(data.median) for place in found.places]
    low, high, extend = _limits(np.concatenate([x.ravel() for x in shown]))
    for place, values in zip(found.places, shown):
        drawn = mesh(place, data, np.maximum(values, low), norm=LogNorm(low, high),
                     cmap='viridis')
    if any(np.isfinite(x).any() for x in shown):
        bar = found.colour_bar(drawn, 'median of the RMS error [rad]', extend=extend)
        ticks = round_decades(low, high, 8)
        bar.set_yticks(ticks, [short(x) for x in ticks])
        bar.set_yticks([], minor=True)
    legend(found.figure, states(found.places, data, [np.isinf(x) for x in shown],
                                'half of the runs or more diverged'))
    return found.figure


def failure_map(data: MapData, rest: tuple[int, ...] = ()) -> Figure:
    """Draw the share of failures with its boundary, and the interval of this."""
    found = sheet(data, _title(data, 'Failure probability', rest), range(len(data.variants)),
                  rest)
    handles = {}
    for place in found.places:
        drawn = mesh(place, data, place.cells(data.probability), cmap='Oranges',
                     norm=Normalize(0.0, 1.0))
        handles.update({handle.get_label(): handle for handle in boundary(place, data)})
    found.colour_bar(drawn, 'share of runs that fail', ticks=[0.0, 0.25, 0.5, 0.75, 1.0],
                     format='{x:.0%}')
    legend(found.figure, [*(handles[name] for name in LINES if name in handles),
                          *states(found.places, data, [], '')])
    return found.figure


def gain_map(data: MapData, rest: tuple[int, ...] = ()) -> Figure:
    """Draw by how many decades the median error is less than that of the base."""
    base = data.base
    assert base is not None
    found = sheet(data, _title(data, f'Gain against {data.variants[base]}', rest),
                  [v for v in range(len(data.variants)) if v != base], rest)
    with np.errstate(divide='ignore', invalid='ignore'):
        gain = np.log10(data.median[base]) - np.log10(data.median)
    shown = [place.cells(gain) for place in found.places]
    finite = np.abs(np.concatenate([x[np.isfinite(x)] for x in shown]))
    most = max(float(np.quantile(finite, 0.99, method='inverted_cdf')), 0.1) if len(
        finite) else 1.0
    cmap = matplotlib.colormaps['RdBu'].with_extremes(under=_WORSE, over=_BETTER)
    for place, values in zip(found.places, shown):
        beyond = np.where(np.isinf(values), np.sign(values) * 1e3 * most,
                          np.clip(values, -most, most))
        drawn = mesh(place, data, beyond, cmap=cmap, norm=Normalize(-most, most))
    name = data.variants[base]
    found.colour_bar(drawn, f'decades less error than {name}')
    legend(found.figure, [*_one_diverged(shown, name), *states(
        found.places, data, [np.isnan(x) for x in shown], 'both diverged')])
    return found.figure


def _one_diverged(shown: Sequence[Array], base: str) -> list[Patch]:
    return [Patch(facecolor=colour, label=text) for extreme, colour, text in (
        (np.inf, _BETTER, f'only {base} diverged'), (-np.inf, _WORSE, 'only this law diverged'))
        if any((values == extreme).any() for values in shown)]


def _title(data: MapData, what: str, rest: tuple[int, ...]) -> str:
    where = [axis.at(k) for axis, k in zip(data.axes[3:], rest)]
    return ', '.join([f'{what} over {data.axes[0].name} and {data.axes[1].name}', *where])


def _limits(values: Array) -> tuple[float, float, str]:
    """Return limits of a logarithmic scale, without rare extremes, and what they cut."""
    positive = values[np.isfinite(values) & (values > 0.0)]
    if not len(positive):
        return 1e-3, 1.0, 'neither'
    low, high = np.quantile(positive, (0.01, 0.99), method='inverted_cdf')
    below, above = positive.min() < low, positive.max() > high
    if high < 1.3 * low:
        low, high = low / 1.2, high * 1.2
    return float(low), float(high), ('both' if below and above else 'min' if below else
                                     'max' if above else 'neither')


def save_map_figures(data: MapData, directory: Path, extra: str = 'svg'
                     ) -> list[drawing.FigureFile]:
    """
    Write the figures of a map as SVG; return them in the order in which to show them.

    Equal data give equal files.

    Parameters
    ----------
    data : MapData
        Of the map.
    directory : Path
        Created if necessary.
    extra : str
        A second format: ``pdf`` or ``png``.

    Raises
    ------
    CtcError
        If a file cannot be written.

    """
    with matplotlib.rc_context({'svg.hashsalt': 'map'}):
        return drawing.save(figures(data), directory, ('svg', extra))


def figures(data: MapData) -> Iterator[tuple[str, Figure, str]]:
    """Yield file name, figure and caption."""
    if len(data.axes) > 1:
        yield from _maps(data)
    elif data.axes:
        yield 'lines', lines(data), (
            'Above: median of the error of the worst joint; × where half of the runs or more '
            'diverged. Below: share of runs that fail, with the interval of each value by itself; '
            'the marks of a value are moved aside of each other.')
        yield 'bands', bands(data), (
            'Line: median. Band: 5 % to 95 % of the runs, up to the top where more than 5 % of '
            'them diverged. Grey: medians of the others.')
    else:
        yield 'errors', distributions(data), (
            'Share of the runs with this error or less; a curve that ends below 1 lacks the runs '
            'that diverged. Further left is better.')
    yield 'failures', shares(data), (
        'Share of all runs that fail, by the first kind that applies, and the interval of 95 % of '
        'their sum' + (' for other draws, which all points share.' if data.axes else ' (Wilson).'))
    if data.saltelli and any(True for _ in sensitivities(data)):
        yield 'sobol', sobol_figure(data), (
            'Sobol indices: part of the variance that is due to a quantity alone, and with all '
            'that it does together with others. Lines: intervals of 95 %.')
    elif (len(data.columns) > 1 or data.uncertain) and data.rows['error'].nunique() > 1:
        yield 'dependence', correlations(data), _correlation_caption(data)


def _maps(data: MapData) -> Iterator[tuple[str, Figure, str]]:
    chosen, count = slices(data, MOST)
    left_out = ''
    if len(data.axes) > 2 and len(data.axes[2].values) > THIRD:
        left_out = f' Of {data.axes[2].name}, {THIRD} of {len(data.axes[2].values)} values.'
    if len(chosen) < count:
        left_out += f' Figures for {len(chosen)} of {count} combinations of the further axes.'
    for rest in chosen:
        name = ''.join(f'_{axis.name}_{k}' for axis, k in zip(data.axes[3:], rest))
        yield f'error{name}', error_map(data, rest), (
            f'Median of the RMS error of the worst joint, of {_runs(data)}; all panels have the '
            'same colours. A median hides single runs; they show among the failures.'
            f'{left_out}')
        yield f'failure{name}', failure_map(data, rest), _failure_caption(data) + left_out
        if data.base is not None and len(data.variants) > 1:
            yield f'gain{name}', gain_map(data, rest), (
                f'log₁₀ of the median error under {data.variants[data.base]} over that under the '
                'law, at the same point. Blue: the law has the smaller error; 1 is ten times '
                f'smaller.{left_out}')


def _failure_caption(data: MapData) -> str:
    text = (f'Share of failures among {_runs(data)}. Solid: a half. Beyond the dashed line the '
            'interval of 95 % (Wilson) of a point by itself is above a half, within the dotted '
            'one below; between them the runs do not decide.')
    return text + (' With so few runs no point is decided.' if data.repeats < 4 else '')


def _runs(data: MapData) -> str:
    return 'one run at each point' if data.repeats == 1 else f'{data.repeats} runs at each point'


def _correlation_caption(data: MapData) -> str:
    text = ('Rank correlation (Spearman) of the error with each parameter over all runs; a run '
            'that diverged has the largest error. Right: the error grows with the parameter.')
    return text + ('' if data.axes else (
        ' Grey: 95 % of the values that independent quantities would have.'))
