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

"""
Runs beside each other: today's and last week's of one arm.

`ctc plot` prints and draws this table where there are several runs. It has the lag of each joint,
the friction that the law compensated, and the parameters that differ.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import nan

from ctc_chattering.analysis.metrics import within
from ctc_chattering.analysis.result import Result
from ctc_chattering.number_format import format_decimal, format_value
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Speed below which the direction of a joint is not clear [rad/s or m/s].
_MIN_SPEED = 0.05
#: Unit of each quantity of a joint, by its heading.
QUANTITIES = {
    'RMS error': 'rad',
    'torque variation': 'N·m/s',
    'friction compensated': 'N·m',
    'lag': 'ms',
}


def motion_lags(result: Result) -> Array:
    """
    Return the lag of each joint behind its reference, shape (n,) [s].

    It is the L that fits e = L dq_d best over the window, and nan for a joint that rests.
    """
    inside = within(result.t, result.window)
    e, dq_d = result.e[inside], result.dq_d[inside]
    squares = np.sum(dq_d * dq_d, axis=0)
    moved = np.sqrt(squares / max(len(dq_d), 1)) > _MIN_SPEED
    lags: Array = np.where(moved, np.sum(e * dq_d, axis=0) / np.where(moved, squares, 1.0), nan)
    return lags


def compensated_friction(result: Result) -> Array:
    """
    Return the friction that the law compensated, shape (n,) [N·m].

    It is the mean of the law's robust term in the direction of motion over the window. It is nan
    where a law has no such term, or a joint did not move.
    """
    terms = result.signals['robust']
    inside = within(terms.t, result.window)
    robust = terms.values[inside]
    columns = [np.interp(terms.t[inside], result.t, dq) for dq in result.dq.T]
    dq = np.array(columns).T
    moves = np.abs(dq) > _MIN_SPEED
    known = moves & np.isfinite(robust) & (robust != 0.0)
    counts = known.sum(axis=0)
    along = np.where(known, robust * np.sign(dq), 0.0).sum(axis=0)
    friction: Array = np.where(counts > 0, along / np.maximum(counts, 1), nan)
    return friction


def compared_numbers(results: Sequence[Result]) -> Iterator[list[str]]:
    """Yield a row for each joint and quantity: both, its unit, and the number of each run."""
    columns = []
    for result in results:
        numbers = result.metrics()
        count = len(result.joint_names)
        columns.append((
            numbers['rms_error_rad'] or [nan] * count,
            numbers['torque_variation_nm_per_s'] or [nan] * count,
            compensated_friction(result),
            1e3 * motion_lags(result),
        ))
    for i, joint in enumerate(results[0].joint_names):
        for k, (quantity, unit) in enumerate(QUANTITIES.items()):
            values = [float(column[k][i]) for column in columns]
            texts = ['-' if np.isnan(x) else format_decimal(x) for x in values]
            yield [joint, f'{quantity} [{unit}]', *texts]


def differing_parameters(results: Sequence[Result]) -> Iterator[list[str]]:
    """Yield a row for each parameter of the controller that differs: name, and values."""
    configs = [result.config.as_mapping() for result in results]
    for name, first in configs[0].items():
        if any(config[name] != first for config in configs):
            yield ['parameter', name, *(format_value(config[name]) for config in configs)]


def comparison_rows(results: Sequence[Result]) -> list[list[str]]:
    """Return the rows of the comparison, none unless runs have the same joints."""
    names = {result.joint_names for result in results}
    if len(results) < 2 or len(names) > 1:
        return []
    return [*compared_numbers(results), *differing_parameters(results)]
