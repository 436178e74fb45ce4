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

"""An axis of a map: its scale, the cells around its values, its ticks."""

from __future__ import annotations

import dataclasses
from functools import cached_property

from ctc_chattering.analysis.number_format import short
from ctc_chattering.numerics.linear_algebra import Array
from matplotlib.ticker import MaxNLocator
import numpy as np

#: Largest ratio of two steps of values that count as evenly spaced.
_EVEN = 6.0


@dataclasses.dataclass(frozen=True)
class GridAxis:
    """
    An axis of a map.

    Attributes
    ----------
    name : str
        Column of the results.
    values : tuple of float
        The grid, ascending.
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

    def at(self, k: int) -> str:
        """Return the value with this index, in words."""
        return self.text(self.values[k])

    def text(self, value: float) -> str:
        """Return a value in words."""
        return f'{self.name} {short(value)} {self.unit}'.rstrip()

    @cached_property
    def scale(self) -> str:
        """How two values or more are spaced: ``linear``, ``log``, or ``steps`` for neither."""
        values = np.array(self.values)
        spreads = {'linear': _spread(values)}
        if values[0] > 0.0:
            spreads['log'] = _spread(np.log(values))
        best = min(spreads, key=lambda x: spreads[x])
        if len(values) == 2 and values[0] > 0.0 and values[1] > 8.0 * values[0]:
            best = 'log'
        return best if spreads[best] <= _EVEN else 'steps'

    @cached_property
    def positions(self) -> Array:
        """Where the values are drawn: the value, its decimal logarithm, or its index."""
        return self._position(np.array(self.values))

    @property
    def edges(self) -> Array:
        """Return the ends of the cells around the values, shape (n + 1,)."""
        x = self.positions
        middle = 0.5 * (x[1:] + x[:-1])
        return np.array([2.0 * x[0] - middle[0], *middle, 2.0 * x[-1] - middle[-1]])

    def ticks(self, most: int) -> tuple[Array, list[str]]:
        """Return positions and texts of about `most` ticks at most: the values if they fit."""
        values = np.array(self.values)
        texts = [short(x) for x in self.values]
        if len(values) > most or (len(values) > 4 and max(map(len, texts)) > 4):
            values = self._round(most)
            texts = [short(x) for x in values.tolist()]
        return self._position(values), texts

    def _round(self, most: int) -> Array:
        """Return round numbers within the axis; some of the values if these follow no rule."""
        if self.scale == 'steps':
            return np.array(self.values)[::-(-len(self.values) // most)]
        find = round_numbers if self.scale == 'linear' else round_decades
        return find(self.values[0], self.values[-1], most)

    def _position(self, values: Array) -> Array:
        if self.scale == 'log':
            return np.log10(values)
        return values if self.scale == 'linear' else np.searchsorted(
            self.values, values).astype(float)


def round_numbers(low: float, high: float, most: int) -> Array:
    """Return at most `most` evenly spaced round numbers from `low` to `high`."""
    found = np.asarray(MaxNLocator(max(1, most - 1)).tick_values(low, high), float)
    slack = 1e-9 * (high - low)
    return found[(found >= low - slack) & (found <= high + slack)]


def round_decades(low: float, high: float, most: int) -> Array:
    """Return at most `most` of 1, 2, 5, 10, ... from `low` to `high`; other numbers if none is."""
    powers = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1.0)
    slack = 1.0 + 1e-9
    for steps in ((1.0, 2.0, 5.0), (1.0,)):
        found = np.sort(np.outer(powers, steps).ravel())
        found = found[(found >= low / slack) & (found <= high * slack)]
        if len(found) <= most:
            break
    return found[::-(-len(found) // most)] if len(found) > 1 else round_numbers(low, high, most)


def _spread(x: Array) -> float:
    steps = np.diff(x)
    return float(steps.max() / steps.min())
