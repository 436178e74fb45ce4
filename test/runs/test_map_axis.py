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

"""Scale, cells and ticks of an axis of a map."""

from __future__ import annotations

from ctc_chattering.runs.map_data import GridAxis, round_decades
import numpy as np
import pytest

GRIDS = {
    'linear': [(0.0, 1.0, 2.0), (1.0, 1.5, 2.0, 2.5), (0.0, 1.0, 2.0, 7.0), (-3.0, 3.0),
               (0.9, 1.0, 1.1), (2.0, 10.0)],
    'log': [(1.0, 10.0, 100.0), (2.0, 5.0, 10.0, 20.0), tuple(np.geomspace(1.0, 40.0, 12)),
            (5e-4, 1e-3, 2e-3), (1.0, 100.0)],
    'steps': [(0.0, 1.0, 10.0, 100.0), (0.0, 1e-4, 1e-3, 1e-2)]}


@pytest.mark.parametrize(('scale', 'values'), [(k, x) for k, v in GRIDS.items() for x in v])
def test_the_scale_follows_the_spacing(scale: str, values: tuple[float, ...]) -> None:
    axis = GridAxis('x', values)
    assert axis.scale == scale
    where = {'linear': np.array(values), 'steps': np.arange(len(values))}.get(scale)
    assert axis.positions == pytest.approx(np.log10(values) if where is None else where)


@pytest.mark.parametrize('values', [x for grids in GRIDS.values() for x in grids])
def test_each_cell_has_its_value_and_no_gap(values: tuple[float, ...]) -> None:
    axis = GridAxis('x', values)
    middle = 0.5 * (axis.positions[:-1] + axis.positions[1:])
    assert axis.edges[1:-1] == pytest.approx(middle)
    assert axis.edges[0] + axis.edges[1] == pytest.approx(2.0 * axis.positions[0])
    assert axis.edges[-1] + axis.edges[-2] == pytest.approx(2.0 * axis.positions[-1])


@pytest.mark.parametrize('most', [3, 6, 9])
@pytest.mark.parametrize('values', [x for grids in GRIDS.values() for x in grids]
                         + [tuple(np.linspace(0.0, 7.0, 41)), tuple(np.geomspace(1e-6, 1.0, 30)),
                            (0.0, *10.0 ** np.arange(-9.0, 9.0))])
def test_ticks_are_few_and_where_their_texts_say(values: tuple[float, ...], most: int) -> None:
    axis = GridAxis('x', values)
    places, texts = axis.ticks(most)
    assert 1 <= len(texts) <= most + 1
    assert len(set(texts)) == len(texts)
    assert axis.edges[0] < min(places) and max(places) < axis.edges[-1]
    at = np.interp([float(x) for x in texts], values, axis.positions)
    if axis.scale == 'log':
        at = np.log10([float(x) for x in texts])
    assert places == pytest.approx(at, abs=2e-3 * float(np.ptp(axis.edges)))


def test_ticks_are_the_values_where_they_fit() -> None:
    assert GridAxis('x', (2.0, 5.0, 10.0, 20.0)).ticks(4)[1] == ['2', '5', '10', '20']
    assert GridAxis('x', (5e-4, 1e-3, 2.02e-3)).ticks(5)[1] == ['5e-4', '1e-3', '0.00202']
    assert GridAxis('x', tuple(np.geomspace(1e-5, 1.0, 26))).ticks(8)[1] == [
        '1e-5', '1e-4', '1e-3', '0.01', '0.1', '1']
    assert GridAxis('x', tuple(np.geomspace(1.0, 40.0, 12))).ticks(8)[1] == [
        '1', '2', '5', '10', '20']


def test_words() -> None:
    assert GridAxis('ka', (1.0, 2.0), 'N·m').label == 'ka [N·m]'
    assert GridAxis('load', (1.0, 2.0)).label == 'load'
    assert GridAxis('ka', (1.0, 2.5), 'N·m').at(1) == 'ka 2.5 N·m'
    assert GridAxis('load', (1e-7, 2.0)).at(0) == 'load 1e-7'


@pytest.mark.parametrize(('low', 'high', 'expected'), [
    (8e-6, 0.3, [1e-5, 1e-4, 1e-3, 1e-2, 1e-1]), (4e-4, 3e-3, [5e-4, 1e-3, 2e-3]),
    (0.4, 30.0, [0.5, 1.0, 2.0, 5.0, 10.0, 20.0]), (1e-12, 1e12, 10.0 ** np.arange(-12, 13, 4))])
def test_round_decades(low: float, high: float, expected: list[float]) -> None:
    assert round_decades(low, high, 8) == pytest.approx(expected)


def test_round_numbers_where_no_decade_is() -> None:
    found = round_decades(1.1e-3, 1.4e-3, 8)
    assert len(found) > 1
    assert np.ptp(np.diff(found)) < 1e-9
    assert found[0] >= 1.1e-3 and found[-1] <= 1.4e-3 + 1e-12
