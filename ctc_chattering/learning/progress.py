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
Progress of learning, which ends where errors grow.

A `Learner` has one `Progress` for each motion, and has it judge every pass. An error grows if it
exceeds twice the least one, or 1.1 times the first one.
"""

from __future__ import annotations

import dataclasses
from math import inf
from typing import NamedTuple

from ctc_chattering.numerics.linear_algebra import Array

#: Ratio of an error to the least one, above which it is growing.
_GROWTH = 2.0
#: Ratio of an error to that of the first pass, above which it is growing.
_GROWTH_FROM_FIRST = 1.1
#: Ratio of an error to that of the pass before, below which it recovers.
_RECOVERY = 0.7
#: Passes in a row with a growing error after which learning stops.
_MAX_GROWING_PASSES = 2


class Pass(NamedTuple):
    """A pass with its errors."""

    #: Path time of its begin and end [ns].
    begin: int
    end: int
    #: RMS of each joint's error from the desired motion, shape (n,) [rad].
    rms: tuple[float, ...]


@dataclasses.dataclass
class Progress:
    """
    Passes of a motion, and what was learned.

    Attributes
    ----------
    passes : list of Pass
        All passes so far.
    rows : array, shape (N, n), or None
        Correction in force [rad], None for none.
    best_rows : array, shape (N, n), or None
        Correction with the least error [rad].
    first_error, least_error, last_error : float
        Errors of all joints, the root of the sum of their squares [rad].
    growing_passes : int
        Passes in a row with a growing error.

    """

    passes: list[Pass] = dataclasses.field(default_factory=list)
    rows: Array | None = None
    best_rows: Array | None = None
    first_error: float = inf
    least_error: float = inf
    last_error: float = inf
    growing_passes: int = 0

    @property
    def is_stopped(self) -> bool:
        """Return whether learning has ended, since errors grew."""
        return self.growing_passes >= _MAX_GROWING_PASSES

    def judge(self, error: float) -> None:
        """
        Take the error of a pass [rad].

        After two passes with a growing error learning stops, and the best correction is taken
        again. If that has a greater error than the first pass, no correction is left.
        """
        if self.is_stopped:
            if error > _GROWTH_FROM_FIRST * self.first_error:
                self.rows = None
            return
        limit = min(_GROWTH * self.least_error, _GROWTH_FROM_FIRST * self.first_error)
        recovers = error < _RECOVERY * self.last_error
        if self.growing_passes and recovers:
            self.forget_errors()  # Something else has changed, such as the load.
        if not error > limit or recovers:
            self.growing_passes = 0
        else:
            self.growing_passes += 1
        if error < self.least_error:
            self.least_error, self.best_rows = error, self.rows
        if self.last_error == inf:
            self.first_error = error
        self.last_error = error
        if self.is_stopped:
            self.rows = self.best_rows

    def forget_errors(self) -> None:
        """Compare later passes with the next one only."""
        self.first_error = self.least_error = self.last_error = inf
