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

from held_out_table import verdict


def row(telling: str, diverged: float | None, *rms: float, slips: float = 0.0) -> dict[str, Any]:
    """Return a row of one condition."""
    return {'label': 'x', 'seed': 1, 'telling': telling, 'diverged': diverged, 'rms': list(rms),
            'slips': slips, 'condition': 'trapezoid',
            'tripped': diverged and [0.5 * diverged, 1.0]}


def test_what_counts_as_worse() -> None:
    base = row('compensation', None, 0.1, 0.2)
    assert verdict(row('rough', 3.0), base) == 'diverged'
    assert verdict(row('rough', None, 0.01, 0.3), base) == 'worse'
    assert verdict(row('rough', None, 0.11, 0.2), base) == 'held'
    assert verdict(row('rough', None, 5.0, 5.0), row('compensation', 1.0)) == 'held'
