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
What gains do over all draws, and which of them are the best.

Of error and variation the search sees logarithms, of each limit a constraint.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

from ctc_chattering.studies.score import Score

#: What a trial can violate.
DIVERGED, TORQUE, RATE = CONSTRAINTS = ('diverged', 'torque', 'torque rate')
#: Largest ratio of a torque, or its rate, to a limit that is kept: as much as rounding does.
_WITHIN = 1.0 + 1e-9
#: Least and largest number of which a logarithm is taken.
_LEAST, _LARGEST = 1e-12, 1e9


class Limits(NamedTuple):
    """Largest torque [N·m] and torque rate [N·m/s] of each joint, shape (n,); inf for none."""

    torque: tuple[float, ...]
    rate: tuple[float, ...]


class OverDraws(NamedTuple):
    """
    What gains do over all draws.

    Attributes
    ----------
    error, variation : float
        What the given part of the runs does not exceed [rad], [N·m/s]; inf where too many
        diverge.
    torque, rate : tuple of float, shape (n,)
        Largest of all runs that do not diverge [N·m], [N·m/s].
    excess : dict of str to float
        By constraint: part of the runs that diverge; by how much the torque or its rate exceeds
        its limit, as a part of it. At most 0 where the constraint holds.
    violating : dict of str to int
        By constraint: number of runs that violate it.
    runs : tuple of Score
        Every run, in the order of the draws.

    """

    error: float
    variation: float
    torque: tuple[float, ...]
    rate: tuple[float, ...]
    excess: dict[str, float]
    violating: dict[str, int]
    runs: tuple[Score, ...]

    @property
    def objectives(self) -> tuple[float, float]:
        """Return the logarithms of error and variation."""
        return _logarithm(self.error), _logarithm(self.variation)

    @property
    def allowed(self) -> bool:
        """Whether no run violates anything."""
        return not any(self.violating.values())


class Trial(NamedTuple):
    """The numbers of a trial, as `tuning.SPACE` has them, and what they do."""

    numbers: dict[str, float]
    score: OverDraws


def over_draws(runs: Sequence[Score], limits: Limits, percentile: float) -> OverDraws:
    """
    Return what gains do over all draws.

    Parameters
    ----------
    runs : sequence of Score
        One a draw.
    limits : Limits
        Of every run.
    percentile : float
        Part of the runs that error and variation do not exceed [%]; 100 for the worst run.

    """
    good = [x for x in runs if not x.failure]
    n = len(limits.torque)
    excess = {DIVERGED: 1.0 - len(good) / len(runs)}
    violating = {DIVERGED: len(runs) - len(good)}
    largest = {}
    for name, most, values in ((TORQUE, limits.torque, [x.peak for x in good]),
                               (RATE, limits.rate, [x.peak_rate for x in good])):
        ratios = [max(x / y for x, y in zip(row, most)) for row in values]
        excess[name] = max(ratios, default=1.0) - _WITHIN
        violating[name] = sum(ratio > _WITHIN for ratio in ratios)
        largest[name] = tuple(map(max, zip(*values))) or (math.inf,) * n
    return OverDraws(percentile_of([x.error for x in runs], percentile),
                     percentile_of([x.most_variation for x in runs], percentile),
                     largest[TORQUE], largest[RATE], excess, violating, tuple(runs))


def percentile_of(values: Sequence[float], percentile: float) -> float:
    """Return the least of `values` that `percentile` % of them do not exceed."""
    return sorted(values)[max(0, math.ceil(percentile / 100.0 * len(values) - 1e-9) - 1)]


def _logarithm(value: float) -> float:
    return math.log(min(max(value, _LEAST), _LARGEST))


def front(scores: Sequence[OverDraws]) -> list[int]:
    """
    Return which scores are not dominated, in the order of their variation.

    A score that violates a constraint is not among them; one is dominated by another with no more
    error and no more variation, of which one is less, and of equal ones the first remains.
    """
    allowed = [k for k, x in enumerate(scores) if x.allowed]
    found: list[int] = []
    for k in sorted(allowed, key=lambda k: (scores[k].variation, scores[k].error)):
        if not found or scores[k].error < scores[found[-1]].error:
            found.append(k)
    return found


def knee(scores: Sequence[OverDraws]) -> int:
    """
    Return which of some scores has the smallest product of error and torque variation.

    On a front that is where one per cent less error costs one per cent more variation.
    """
    return min(range(len(scores)), key=lambda k: scores[k].error * scores[k].variation)
