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

"""The table of the held-out conditions."""

from __future__ import annotations

from typing import Any

from held_out_table import line, table, verdict


def row(telling: str, diverged: float | None, *rms: float, slips: float = 0.0) -> dict[str, Any]:
    """Return a row of one condition."""
    return {'label': 'x', 'seed': 1, 'telling': telling, 'diverged': diverged, 'rms': list(rms),
            'slips': slips, 'condition': 'trapezoid',
            'tripped': diverged and [0.5 * diverged, 1.0]}


def test_a_trip_is_told_with_the_error_by_then() -> None:
    base = row('compensation', None, 0.1, 0.2)
    text = line(row('rough', 3.0), base)
    assert text.endswith('diverged at 3.00 s, tripped at 1.50 s, 1.00 rad')
    assert line({**base, 'verdict': 'held', 'variation': [9.0]}, base).endswith('N·m/s')


def test_what_counts_as_worse() -> None:
    base = row('compensation', None, 0.1, 0.2)
    assert verdict(row('rough', 3.0), base) == 'diverged'
    assert verdict(row('rough', None, 0.01, 0.3), base) == 'worse'
    assert verdict(row('rough', None, 0.11, 0.2), base) == 'held'
    assert verdict(row('rough', None, 5.0, 5.0), row('compensation', 1.0)) == 'held'


def test_a_condition_counts_once() -> None:
    rows = [row('compensation', None, 0.1, 0.2), row('rough', 1.0), row('compensation', 2.0),
            row('rough', None, 0.01, 0.02, slips=9.0)]
    for x in rows:
        x['verdict'] = verdict(x, rows[0])
    rows[2] = dict(rows[0])
    last = table(rows).splitlines()[-1]
    assert last == '| x | rough | 1 | 1 | 0 | 0 | 0, 0, 0 | 0.1 | 1 of 1 |'
