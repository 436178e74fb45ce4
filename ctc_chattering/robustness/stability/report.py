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

"""What `ctc stability` says: margins as rows of a table, as JSON, and the stable region drawn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
import math
from typing import Any

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.number_format import rounded
from ctc_chattering.arguments import checked
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.robustness.stability.margins import Loops, loops_of, StableRange
from matplotlib.figure import Figure
import numpy as np

#: M̂ M⁻¹ for which lags and delays are said.
RATIOS = (1.0, 0.8, 1.25)
#: Of the figure: eigenvalues of M̂ M⁻¹, lags, and those of the guarantee.
_WIDE, _HIGH, _GUARANTEED = 80, 50, 40


@dataclasses.dataclass(frozen=True)
class Margins:
    """
    Margins of a loop.

    Attributes
    ----------
    radius : float
        Largest absolute value of a pole, for M̂ = M.
    ratios, guaranteed : StableRange or None
        Of the eigenvalues of M̂ M⁻¹, constant; varying.
    lags, delays : sequence
        For each of `RATIOS`: true lags [s], true delays in samples.
    error_gain : float or None
        Of bounded perturbations [s²]; None where the settings of the joints differ.

    """

    radius: float
    ratios: StableRange | None
    guaranteed: StableRange | None
    lags: tuple[StableRange | None, ...]
    delays: tuple[tuple[int, ...], ...]
    error_gain: float | None


@checked(setup=Setup)
def stability(setup: Setup) -> Margins:
    """
    Return which errors of model, lag and delay the sampled loop stands.

    Of the loop with constant M, without limits: the poles for errors that are constant, the
    small-gain theorem for those that vary (docs/theory.md).

    Parameters
    ----------
    setup : Setup
        The law and what it knows; lag, delay and sensor of its robot.

    Returns
    -------
    Margins
        Stable if ``radius`` is below 1; ``ratios``, ``lags`` and ``delays`` say how far it is.

    Raises
    ------
    CtcError
        If the law is not linear, or its torque not in proportion to M of the model.

    Examples
    --------
    >>> from ctc_chattering import load_parameters, stability
    >>> found = stability(load_parameters('friction', {'controller': {'law': 'compensation'}}))
    >>> found.radius < 1.0, f'{found.ratios.low:.2f} to {found.ratios.high:.0f}'
    (True, '0.01 to 40')

    """
    return margins(loops_of(setup))


def margins(loops: Loops) -> Margins:
    """Return the margins of loops."""
    return Margins(
        loops.radius(), loops.ratios(), loops.guaranteed(), tuple(map(loops.lags, RATIOS)),
        tuple(tuple(loops.delays(x)) for x in RATIOS),
        loops.error_gain() if len(loops.laws) == 1 else None)


def rows(found: Margins, period: float) -> Iterator[tuple[str, str]]:
    """Yield rows of a table, intervals rounded inwards; `period` is h [s]."""
    if found.radius < 1.0:
        slowest = -1e3 * period / math.log(found.radius)
        yield 'slowest time constant, model exact', f'{_digits(slowest, up=True)} ms'
    else:
        yield 'model exact', f'unstable: a pole at {found.radius:.3g}'
    yield 'M of the model / M of the robot, constant', _span(found.ratios)
    yield 'the same, varying (guaranteed)', _span(found.guaranteed)
    for ratio, lags, delays in zip(RATIOS, found.lags, found.delays):
        at = '' if ratio == 1.0 else f', model {ratio:g} M'
        yield f'lag of the drives{at}', _span(lags, 1e3, ' ms')
        yield f'delay{at}', f'{_counts(delays)} samples' if delays else 'none'
    if found.error_gain is not None and math.isfinite(found.error_gain):
        yield 'error for 1 rad/s^2 of bounded perturbation', (
            f'at most {_digits(found.error_gain, up=True)} rad')


def as_json(found: Margins) -> dict[str, Any]:
    """Return margins as JSON has them."""
    return {**dataclasses.asdict(found), 'of_ratios': RATIOS}


def _span(found: StableRange | None, factor: float = 1.0, unit: str = '') -> str:
    if found is None:
        return 'none'
    low, high = (_digits(factor * x, up) for x, up in zip(found, (True, False)))
    return f'{low} to {high}{unit}'


def _counts(found: Sequence[int]) -> str:
    """Return ascending numbers, as a range if none is left out."""
    if len(found) > 1 and found[-1] - found[0] == len(found) - 1:
        return f'{found[0]} to {found[-1]}'
    return ', '.join(map(str, found))


def _digits(x: float, up: bool) -> str:
    """Return a number to two digits, rounded up or down."""
    if not 0.0 < x < math.inf:
        return f'{x:g}'
    step = 10.0 ** (math.floor(math.log10(x)) - 1)
    return f'{rounded((math.ceil if up else math.floor)(x / step) * step, 2):g}'


def region(loops: Loops, found: Margins) -> Iterator[tuple[str, Figure, str]]:
    """Yield name, figure and caption: where the loop is stable, over model and lag."""
    lags = [x.high for x in found.lags if x is not None]
    most = 1.3 * max([*lags, float(loops.robots[0].lag.max()), loops.robots[0].period])
    ratio, lag = np.geomspace(0.2, 5.0, _WIDE), np.linspace(0.0, most, _HIGH)
    radius = np.array([[at.radius(x) for x in ratio.tolist()] for at in (
        loops.with_drives(lag=y) for y in lag.tolist())])
    figure, grid = drawing.sheet('Stable region', 1, (1.0,), 3.6)
    ax = drawing.panel(figure, grid[0, 0], '', 'lag of the drives [ms]')
    ax.contourf(ratio, 1e3 * lag, radius, [0.0, 1.0], colors=['#cfe3f3'])
    ax.contour(ratio, 1e3 * lag, radius, [1.0], colors=['#0072B2'], linewidths=1.6)
    some = [(1e3 * y, span) for y in np.linspace(0.0, most, _GUARANTEED).tolist()
            if (span := loops.with_drives(lag=y).guaranteed()) is not None]
    if some:
        at, spans = zip(*some)
        low, high = zip(*spans)
        ax.fill_betweenx(at, low, high, color='#7fb2da')
    ax.plot(1.0, 1e3 * loops.robots[0].lag.max(), 'o', color='#1b1b1b')
    ax.set(xscale='log', xlabel='M of the model / M of the robot')
    ax.set_xticks([0.2, 0.5, 1.0, 2.0, 5.0], ['0.2', '0.5', '1', '2', '5'])
    ax.minorticks_off()
    yield 'region', figure, (
        'Light: all poles are within the unit circle, for a constant error of the model. Dark: '
        'exponentially stable for errors that vary from sample to sample. Dot: the robot of the '
        'file.')
