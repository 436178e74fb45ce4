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
Faults of a running controller: restarts, refused states, saturation.

`ControllerHealth` counts the states and samples of the control loop. `controller/status.py` asks
it once a second what is wrong.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

from ctc_chattering.control.controller import ControllerConfig, Sample
from ctc_chattering.controller.term_saturation import term_saturation
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import seconds
import numpy as np

#: Number of the last samples whose chattering term is looked at.
_SATURATION_SAMPLES = 1000
#: Likely cause of messages that come too late.
BUSY = 'the computer is too busy, or processes are stopped'
#: Reports over which rates are averaged: a total says nothing about the present.
WINDOW = 3
#: Kind of rejected messages that says nothing about the states of the robot.
_UNRELATED_KIND = 'second_publisher'
#: Relative error of the mean period that is allowed, at `WINDOW` reports in a row.
PERIOD_TOLERANCE = 0.2


class Problem(NamedTuple):
    """Something to report: level (1 warning, 2 error) and text."""

    level: int
    text: str


class FaultKind(NamedTuple):
    """A kind of faults, judged by its rate."""

    #: Description, with ``{}`` in the place of the rate, or ``{1}`` for percent.
    text: str
    #: Rate above which it is a warning, and from which on it is an error.
    warning: float
    error: float


class FaultCount(NamedTuple):
    """Faults so far, and messages or time [s] so far."""

    faults: int
    total: float


class FaultRates:
    """
    Judges faults by their rates over the last reports.

    Parameters
    ----------
    *kinds : FaultKind
        The kinds of faults.

    """

    def __init__(self, *kinds: FaultKind) -> None:
        self._kinds = kinds
        self._reports: deque[tuple[FaultCount, ...]] = deque(maxlen=WINDOW + 1)

    def report(self, cause: str, *counts: FaultCount) -> list[Problem]:
        """
        Return the rates that are too large.

        Parameters
        ----------
        cause : str
            Known cause, or ''.
        *counts : FaultCount
            Of each kind.

        """
        self._reports.append(counts)
        problems = []
        for fault, now, first in zip(self._kinds, counts, self._reports[0]):
            total = max(now.total - first.total, 1e-9)
            rate = (now.faults - first.faults) / total
            if rate > fault.warning:
                text = fault.text.format(rate, 100.0 * rate)
                level = 2 if rate >= fault.error else 1
                problems.append(Problem(level, f'{text}: {cause or BUSY}'))
        return problems


class _StampCount(NamedTuple):
    """Stamp of the last state [ns], states and restarts."""

    t: int
    states: int
    restarts: int


class ControllerHealth:
    """
    Counts states and samples for the reports.

    Parameters
    ----------
    names : sequence of str
        The joints.
    period : int
        Control period [ns].

    Attributes
    ----------
    taken, restarts, saturated : int
        States taken, restarts of the law, samples with a torque at its limit.

    """

    def __init__(self, names: Sequence[str], period: int) -> None:
        self._names, self._period = names, period
        self.taken = self.restarts = self.saturated = 0
        self._rates = FaultRates(
            FaultKind('{:.2g} restarts per second', 0.0, 1.0),
            FaultKind('{1:.0f} % of the states were refused', 0.01, 0.1),
            FaultKind('{1:.0f} % of the states were skipped for newer ones', 0.2, 0.5))
        self._stamps: deque[_StampCount] = deque(maxlen=WINDOW + 1)
        #: Last terms of the law [N·m].
        self._terms: deque[Vector] = deque(maxlen=_SATURATION_SAMPLES)

    def add(self, sample: Sample) -> None:
        """Count a sample of the law."""
        self.saturated += sample.saturation_error is not None
        self._terms.append(sample.robust)

    def saturation(self, config: ControllerConfig) -> list[Problem]:
        """Return the joints with a saturated chattering term."""
        if not self._terms or not config.takes('ka'):
            return []
        recording = np.array(self._terms), config.ka, config.switching_in_force
        by_joint = term_saturation([recording])
        return [Problem(1, f'{name}: {x}') for name, x in zip(self._names, by_joint) if x.cause]

    def report(self, now: int, t: int, rejected: Mapping[str, int], skipped: int,
               simulated: bool, cause: str = '') -> list[Problem]:
        """
        Return the faults of the states.

        Parameters
        ----------
        now : int
            Time [ns].
        t : int
            Stamp of the last state [ns].
        rejected : mapping
            Messages rejected so far, by kind.
        skipped : int
            States skipped so far because newer ones had come.
        simulated : bool
            Whether time is simulated: then states are never late.
        cause : str
            Known cause of late and skipped states, or ''.

        """
        refused = sum(n for reason, n in rejected.items() if reason != _UNRELATED_KIND)
        states = self.taken + skipped
        problems = self._rates.report(
            cause,
            FaultCount(self.restarts, seconds(now)),
            FaultCount(refused, self.taken + refused),
            FaultCount(skipped, states))
        if simulated:
            problems = []
        self._stamps.append(_StampCount(t, states, self.restarts))
        periods = [(last.t - first.t) / (last.states - first.states)
                   for first, last in pairwise(self._stamps)
                   if first.states < last.states and first.restarts == last.restarts]
        if len(periods) == WINDOW and all(
                abs(x - self._period) > PERIOD_TOLERANCE * self._period for x in periods):
            problems.append(Problem(1, (
                f'states come every {1e-6 * periods[-1]:.3g} ms, but control_period is '
                f'{1e-6 * self._period:g} ms; set it to the period of the robot')))
        return problems
