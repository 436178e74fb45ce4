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

"""Columns of the results of a map, one row a run."""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.studies.score import PER_JOINT

INTEGER, TEXT, NUMBER = 'int64', 'string', 'float64'
#: Which run it is; before the axes and what is uncertain.
WHICH = {'run': INTEGER, 'point': INTEGER, 'repeat': INTEGER, 'seed': INTEGER,
         'variant': TEXT, 'law': TEXT, 'switching': TEXT}
#: What came of it, and the numbers that sum it up; without a number where it failed.
RESULT = {'engine': TEXT, 'failure': TEXT, 'reason': TEXT,
          'error': NUMBER, 'variation': NUMBER, 'saturated': NUMBER,
          'slips': NUMBER}
#: Numbers of all joints together, besides; as `analysis.metrics` has them.
_OVERALL = {'max_error_norm1_rad': NUMBER, 'reaching_time_s': NUMBER, 'missing_samples': INTEGER}
#: Units of columns, and of those of each joint.
_UNITS = {'error': 'rad', 'variation': 'N*m/s', 'slips': '1/s', 'max_error_norm1_rad': 'rad',
          'reaching_time_s': 's'}
_OF_JOINTS = dict(zip(PER_JOINT.values(), ('rad', 'N*m', 'N*m/s', 'N*m', 'N*m/s')))


def unit_of(column: str) -> str:
    """Return the unit of a column of the results; empty for none."""
    return _UNITS.get(column) or _OF_JOINTS.get(column.rpartition('_')[0], '')


def of_results(n: int) -> dict[str, str]:
    """Return name and type of the columns behind the axes, for `n` joints."""
    joints = {f'{name}_{i}': NUMBER for name in PER_JOINT.values() for i in range(1, n + 1)}
    return {**RESULT, **joints, **_OVERALL}


def of_map(quantities: Sequence[str], n: int) -> dict[str, str]:
    """
    Return name and type of all columns, in order.

    Parameters
    ----------
    quantities : sequence of str
        Names of the axes, then of what is uncertain.
    n : int
        Number of joints.

    """
    return {**WHICH, **dict.fromkeys(quantities, NUMBER), **of_results(n)}
