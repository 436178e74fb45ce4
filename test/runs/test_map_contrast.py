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

"""A law against the base, run by run, and the values that pass."""

from __future__ import annotations

from typing import Any

from ctc_chattering.runs.map_data import against, MapData, passing
from map_tables import made_up, table_of
import numpy as np
import pyarrow as pa

LAWS = ('compensation', 'chattering sign')


def contrast(data: MapData, variant: int, base: int) -> Any:
    """Return the row of a law."""
    return against(data, base).loc[data.variants[variant]]


def grid(failures: Any, errors: Any = None, axes: Any = None) -> Any:
    """Return data of both laws over axes a and b; failures of shape (points, 2, repeats)."""
    failures = np.asarray(failures)
    axes = {'a': [1.0, 2.0], 'b': [10.0, 20.0, 40.0]} if axes is None else axes
    table = table_of(LAWS, axes, {
        'error': np.full(failures.shape, 0.01) if errors is None else errors,
        'failure': np.where(failures, 'error', '')})
    return MapData(table, {name: {'a': 'N*m'}.get(name, '') for name in axes})


def test_runs_are_compared_one_by_one() -> None:
    """Check counts against pairs of rows, some without a partner."""
    table = made_up({'friction': [2.0, 10.0], 'ka': [1.0, 12.0, 40.0]}, 6)
    table = table.take(pa.array(np.random.default_rng(0).permutation(len(table))[:150]))
    data = MapData(table, {'friction': '', 'ka': ''})
    rows = {(row['variant'], row['point'], row['repeat']): row['failure'] != ''
            for row in table.to_pylist()}
    base = {key[1:]: failed for key, failed in rows.items() if key[0] == 'compensation'}
    assert data.base is not None
    for v, name in enumerate(data.variants):
        pairs = [(failed, base[point, repeat]) for (variant, point, repeat), failed in rows.items()
                 if variant == name and (point, repeat) in base]
        if v == data.base:
            continue
        found = contrast(data, v, data.base)
        assert found.runs == len(pairs)
        assert found.worse == sum(a and not b for a, b in pairs)
        assert found.better == sum(b and not a for a, b in pairs)
    assert found.worse + found.better


def test_where_only_the_law_fails() -> None:
    failures = np.zeros((6, 2, 4), bool)
    failures[1, 1, :2] = failures[2, 1] = True  # Half of the runs is a failure.
    failures[4] = True
    failures[5, 1, :1] = True
    data = grid(failures)
    found = contrast(data, 1, 0)
    assert (found.runs, found.worse, found.better) == (24, 7, 0)
    back = contrast(data, 0, 1)
    assert (back.runs, back.worse, back.better) == (24, 0, 7)


def test_values_that_pass() -> None:
    failures = np.zeros((2, 3, 2, 2), bool)
    failures[0, 1, 0] = True
    failures[:, :, 1] = True
    failures[1, 2, 1, 0] = False  # Half of the runs fail: it does not pass.
    failures[1, 1, 1] = False
    data = grid(failures.reshape(6, 2, 2))
    assert passing(data, 1) == ([('a 1 N·m', ['10, 40', 'none']),
                                 ('a 2 N·m', ['10 to 40', '20'])], 2)
    assert passing(data, 0) == ([('b 10', ['1 to 2', 'none']), ('b 20', ['2', '2']),
                                 ('b 40', ['1 to 2', 'none'])], 3)


def test_one_axis_and_three() -> None:
    one = grid(np.zeros((3, 2, 1), bool), axes={'b': [1.0, 2.0, 3.0]})
    assert passing(one, 0) == ([('', ['1 to 3', '1 to 3'])], 1)
    axes = {'a': [1.0, 2.0], 'b': np.arange(50.0), 'c': [0.0, 1.0]}
    failures = np.zeros((2, 50, 2, 2, 1), bool)
    failures[1, 7, 1, 0] = True
    data = grid(failures.reshape(200, 2, 1), axes=axes)
    rows, count = passing(data, 0)
    assert (len(rows), count) == (60, 100)
    assert rows[0][0] == 'b 0, c 0' and rows[-1][0] == 'b 49, c 1'
    rows, count = passing(data, 1)
    assert [name for name, _ in rows] == ['a 1 N·m, c 0', 'a 1 N·m, c 1', 'a 2 N·m, c 0',
                                          'a 2 N·m, c 1']
    assert [cells[0] for _, cells in rows] == ['0 to 49'] * 3 + ['0 to 6, 8 to 49']
