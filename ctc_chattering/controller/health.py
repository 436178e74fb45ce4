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
What goes wrong while a controller runs: its rates and durations, rates of faults, saturation.

How often the chattering term is at its bound ±Ka says why: at its bound the term cannot cancel
more of the perturbation P, and v leaves 0. How long it stays there at a stretch tells two causes
apart:

- |P| exceeds Ka: the term is held at one bound as long as P keeps its sign, hundreds of samples.
- Noise of v, times inertia / h, exceeds what Ka has left (docs/theory.md), or a lag or a delay
  makes the loop oscillate: the term meets the bound and leaves it again within a few samples.

Switching ``sign`` is always at a bound, for (Ka + |P|) / (Ka - |P|) samples at a stretch. Of it
only stretches of `SIGN_STRETCH` samples and more count: |P| is then above 0.99 Ka.
"""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

from ctc_chattering.control.controller import ControllerConfig, Sample
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.time_grid import seconds
import numpy as np

#: What is reported of durations.
_QUANTILES = {'p50': 0.5, 'p99': 0.99, 'p99.9': 0.999, 'max': 1.0}
#: Number of the last durations that are looked at: 10 s at 1 kHz.
_DURATIONS = 10_000
#: Part of the period that leaves too little for the middleware.
_TOO_MUCH = 0.5


class LoopStatistics:
    """
    Counts samples, their periods, the time they take, and the times until they are answered.

    Attributes
    ----------
    samples, misses : int
        Samples since the start, and those that came or took too long.
    rate : float
        Samples per second in the last window.

    """

    def __init__(self) -> None:
        #: In the order of the report [ns].
        self._durations = {name: array('q') for name in (
            'period', 'computing time', 'answer time')}
        self._periods, self._computing, self._answers = self._durations.values()
        self.samples = self.misses = 0
        self.rate = 0.0
        self._last: int | None = None
        self._seen = 0, 0

    def sample(self, begin: int, end: int) -> None:
        """Count a sample computed from `begin` to `end` [ns]."""
        self.samples += 1
        if self._last is not None:
            self._periods.append(begin - self._last)
        self._last = begin
        self._computing.append(end - begin)

    def answer(self, asked: int, now: int) -> None:
        """Count an answer that came at `now` to what was sent at `asked` [ns]."""
        self._answers.append(now - asked)

    def pause(self) -> None:
        """Do not count the time to the next sample as a period."""
        self._last = None

    def rotate(self, now: int) -> None:
        """Begin a new window of the rate at `now` [ns], and forget old durations."""
        (samples, before), self._seen = self._seen, (self.samples, now)
        if now > before > 0:
            self.rate = (self.samples - samples) / seconds(now - before)
        for durations in self._durations.values():
            del durations[:-_DURATIONS]

    def too_slow(self, period: int) -> str:
        """
        Return a line if samples take too much of the period [ns], '' if not.

        Half of the samples must take more than `_TOO_MUCH` of the period; a few slow ones make no
        loop late.
        """
        p50 = np.median(self._computing) if self._computing else 0.0
        return '' if p50 <= _TOO_MUCH * period else (
            f'the step takes {1e-6 * p50:.2g} ms (p50) at a period of {1e-6 * period:g} ms: too '
            'slow for the sample rate')

    def values(self) -> dict[str, float]:
        """Return what there is to say, by name with unit."""
        result = {'samples': self.samples, 'rate [Hz]': self.rate,
                  'deadline misses': self.misses}
        for name, found in self._durations.items():
            if found:
                ms = np.quantile(found, list(_QUANTILES.values()), method='inverted_cdf') / 1e6
                result |= {f'{name}, {key} [ms]': x for key, x in zip(_QUANTILES, ms.tolist())}
        return result


#: Part of the samples at the bound that is worth a word.
WORTH_A_WORD = 0.05
#: Mean length of a stretch at the bound from which on Ka is too small [samples].
LONG_STRETCH = 10.0
#: Number of the last samples that a running controller looks at.
_LATEST = 1000
#: Least length of a stretch that counts with switching ``sign`` [samples].
SIGN_STRETCH = 200
_NEAR = 1.0 - 1e-9


class Saturation(NamedTuple):
    """
    What was found on one joint.

    Attributes
    ----------
    fraction : float
        Part of the samples with the term at its bound.
    stretch : float
        Mean number of samples that it stays there.

    """

    fraction: float
    stretch: float

    @property
    def cause(self) -> str:
        """Return the reason that the numbers give; empty where the term is rarely at its bound."""
        if self.fraction <= WORTH_A_WORD:
            return ''
        return ('ka too small' if self.stretch >= LONG_STRETCH
                else 'noise, lag or delay too large')

    def __str__(self) -> str:
        """Say it on one line."""
        found = (f'chattering term at its bound for {100.0 * self.fraction:.0f} % of the samples, '
                 f'{self.stretch:.3g} at a stretch')
        return f'{found}: {self.cause}' if self.cause else found


def term_saturation(parts: Iterable[tuple[Array, Vector, str]]) -> list[Saturation]:
    """
    Return how often the chattering term of each joint is at its bound.

    Parameters
    ----------
    parts : iterable of (term, ka, switching)
        Chattering term of samples in a row, shape (N, n) [N·m], NaN where one is missing; its
        bounds, shape (n,) [N·m], 0 of a joint that has no such term; how it is evaluated.

    """
    samples, stretches = 0, list[list[int]]()
    for term, ka, switching in parts:
        least = SIGN_STRETCH if switching == 'sign' else 1
        side = np.where((np.abs(term) >= _NEAR * np.array(ka)) & (np.array(ka) > 0.0),
                        np.sign(term), 0.0)
        samples += int(np.isfinite(term[:, 0]).sum())
        stretches = stretches or [[] for _ in ka]
        for column, found in zip(side.T, stretches):
            ends = np.flatnonzero(np.diff(column, append=np.nan))
            lengths = np.diff(ends, prepend=-1)
            found += lengths[(column[ends] != 0.0) & (lengths >= least)].tolist()
    return [Saturation(sum(found) / samples, sum(found) / max(len(found), 1))
            for found in stretches] if samples else []


#: Likely cause of messages that come too late.
BUSY = 'this computer is too busy, or processes are stopped'
#: Reports that rates are the mean over: a total says nothing about the present.
WINDOW = 3
#: Rejected messages that say nothing about the states of the robot.
_UNRELATED = 'second_publisher'
#: Share by which the mean period may differ from what it should be, at `WINDOW` reports in a row.
TOLERANCE = 0.2


class FaultRates:
    """
    Judges faults by their rates over the last reports.

    Parameters
    ----------
    kinds : tuple of (str, float, float)
        What a rate is called, with ``{}`` in its place, or ``{1}`` for percent; beyond which it is
        a warning, and from which on it is an error.

    """

    def __init__(self, *kinds: tuple[str, float, float]) -> None:
        self._kinds = kinds
        self._reports: deque[tuple[tuple[int, float], ...]] = deque(maxlen=WINDOW + 1)

    def report(self, cause: str, *totals: tuple[int, float]) -> list[tuple[int, str]]:
        """
        Return level (1 warning, 2 error) and text of rates that are too large.

        Parameters
        ----------
        cause : str
            What is known to be the cause; '' where nothing is.
        totals : tuple of (int, float)
            Of each kind: number of faults so far, and what they are a part of, or the time [s].

        """
        self._reports.append(totals)
        found = []
        for (text, warning, error), now, before in zip(self._kinds, totals, self._reports[0]):
            rate = (now[0] - before[0]) / max(now[1] - before[1], 1e-9)
            if rate > warning:
                said = text.format(rate, 100.0 * rate)
                found.append((1 + (rate >= error), f'{said}: {cause or BUSY}'))
        return found


class ControllerHealth:
    """
    Counts what a controller takes and sends, for a report once a second.

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
            ('{:.2g} restarts per second', 0.0, 1.0),
            ('{1:.0f} % of the states refused', 0.01, 0.1),
            ('{1:.0f} % of the states skipped for newer ones', 0.2, 0.5))
        #: At the last reports: stamp of the last state [ns], its number, restarts so far.
        self._stamps: deque[tuple[int, int, int]] = deque(maxlen=WINDOW + 1)
        #: Last terms of the law [N·m].
        self._terms: deque[Vector] = deque(maxlen=_LATEST)

    def add(self, sample: Sample) -> None:
        """Count a sample of the law."""
        self.saturated += sample.saturation_error is not None
        self._terms.append(sample.robust)

    def saturation(self, config: ControllerConfig) -> list[tuple[int, str]]:
        """Return level and text of joints whose chattering term was often at its bound."""
        if not self._terms or not config.takes('ka'):
            return []
        found = term_saturation([(np.array(self._terms), config.ka, config.switching_in_force)])
        return [(1, f'{name}: {x}') for name, x in zip(self._names, found) if x.cause]

    def report(self, now: int, t: int, rejected: Mapping[str, int], skipped: int,
               simulated: bool, cause: str = '') -> list[tuple[int, str]]:
        """
        Return what goes wrong with the states: level (1 warning, 2 error) and text.

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
            Whether time is simulated: then it is no matter how late states come.
        cause : str
            What is known to be the cause of late and skipped states; '' where nothing is.

        """
        refused = sum(n for kind, n in rejected.items() if kind != _UNRELATED)
        count = self.taken + skipped
        found = self._rates.report(cause, (self.restarts, seconds(now)),
                                   (refused, self.taken + refused), (skipped, count))
        found = [] if simulated else found
        self._stamps.append((t, count, self.restarts))
        periods = [(t - t0) / (k - k0) for (t0, k0, restarts), (t, k, later) in pairwise(
            self._stamps) if k0 < k and restarts == later]
        if len(periods) == WINDOW and all(
                abs(x - self._period) > TOLERANCE * self._period for x in periods):
            found.append((1, f'states come every {1e-6 * periods[-1]:.3g} ms; control_period is '
                          f'{1e-6 * self._period:g} ms'))
        return found
