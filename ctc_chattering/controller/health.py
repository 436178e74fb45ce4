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
import dataclasses
from itertools import pairwise
from math import nan, sqrt

from ctc_chattering.control.controller import ControllerConfig, Sample
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.time_grid import seconds
import numpy as np

_NANO = 1e-9
_SHARES = {'p50': 0.5, 'p99': 0.99, 'p99.9': 0.999}
#: Part of the period that leaves too little for the middleware.
_TOO_MUCH = 0.5
#: Shorter durations are in the octave of this one [ms].
_SHORTEST = 1e-3


class Durations:
    """
    Durations in windows, of which the last few count.

    Parameters
    ----------
    windows : int
        How many windows are looked back on.

    """

    def __init__(self, windows: int = 10) -> None:
        self._windows: deque[array[float]] = deque(maxlen=windows)
        self.rotate()

    def add(self, duration: float) -> None:
        """Note a duration [s]."""
        self._windows[-1].append(duration)

    def rotate(self) -> None:
        """Begin a new window, and forget the oldest."""
        self._windows.append(array('d'))

    def summary(self) -> dict[str, float | str]:
        """Return mean, quantiles, maximum and histogram by name; nothing without durations."""
        ms = 1e3 * np.concatenate(tuple(self._windows))
        if not ms.size:
            return {}
        quantiles = np.quantile(ms, list(_SHARES.values()), method='inverted_cdf').tolist()
        # The octaves end at √2 ms times powers of two: a period of 1 ms and its jitter are in one.
        octaves = np.frexp(np.maximum(ms, _SHORTEST) / sqrt(2.0))[1]
        first = int(octaves.min())
        return {'mean [ms]': float(ms.mean()),
                **{f'{share} [ms]': value for share, value in zip(_SHARES, quantiles)},
                'max [ms]': float(ms.max()),
                'histogram [ms]': ', '.join(
                    f'<{sqrt(2.0) * 2.0 ** (first + k):.2g}: {count}'
                    for k, count in enumerate(np.bincount(octaves - first).tolist()) if count)}


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
        self._durations = {name: Durations() for name in (
            'period', 'computing time', 'answer time')}
        self._periods, self._computing, self._answers = self._durations.values()
        self.samples = self.misses = 0
        self.rate = 0.0
        self._last: int | None = None
        self._seen = (0, 0)

    def sample(self, begin: int, end: int) -> None:
        """Count a sample computed from `begin` to `end` [ns]."""
        self.samples += 1
        last, self._last = self._last, begin
        if last is not None:
            self._periods.add(_NANO * (begin - last))
        self._computing.add(_NANO * (end - begin))

    def answer(self, asked: int, now: int) -> None:
        """Count an answer that came at `now` to what was sent at `asked` [ns]."""
        self._answers.add(_NANO * (now - asked))

    def pause(self) -> None:
        """Do not count the time to the next sample as a period."""
        self._last = None

    def rotate(self, now: int) -> None:
        """Begin a new window at `now` [ns]."""
        samples, before = self._seen
        if before and now > before:
            self.rate = (self.samples - samples) / (_NANO * (now - before))
        self._seen = self.samples, now
        for durations in self._durations.values():
            durations.rotate()

    def too_slow(self, period: int) -> str:
        """
        Return a line if samples take too much of the period [ns], '' if not.

        Half of the samples must take more than `_TOO_MUCH` of the period; a few slow ones make no
        loop late.
        """
        p50 = float(self._computing.summary().get('p50 [ms]', 0.0))
        if 1e6 * p50 <= _TOO_MUCH * period:
            return ''
        return (f'the step takes {p50:.2g} ms (p50) at a period of {1e-6 * period:g} ms: too slow '
                'for the sample rate')

    def values(self) -> dict[str, float | str]:
        """Return what there is to say, by name with unit."""
        result: dict[str, float | str] = {'samples': self.samples, 'rate [Hz]': self.rate}
        for name, durations in self._durations.items():
            result |= {f'{name}, {key}': value for key, value in durations.summary().items()}
        return {**result, 'deadline misses': self.misses}


#: Part of the samples at the bound that is worth a word.
WORTH_A_WORD = 0.05
#: Mean length of a stretch at the bound from which on Ka is too small [samples].
LONG_STRETCH = 10.0
#: Number of the last samples that a running controller looks at.
_LATEST = 1000
#: Least length of a stretch that counts with switching ``sign`` [samples].
SIGN_STRETCH = 200
_NEAR = 1.0 - 1e-9


@dataclasses.dataclass(frozen=True)
class Saturation:
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
        stretch = f'{self.stretch:.1f}' if self.stretch < LONG_STRETCH else f'{self.stretch:.0f}'
        found = (f'chattering term at its bound for {100.0 * self.fraction:.0f} % of the samples, '
                 f'{stretch} at a stretch')
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
#: Part of the states rejected, or skipped, that is a warning, and an error.
_REJECTED = 0.01, 0.1
_SKIPPED = 0.2, 0.5
#: Rejected messages that say nothing about the states of the robot.
_UNRELATED = 'second_publisher'
#: Share by which the mean period may differ from what it should be, and times in a row between two
#: reports in which it must differ by more.
TOLERANCE, PATIENCE = 0.2, 3


class HealthMonitor:
    """
    Judges two kinds of faults by their rates over the last reports.

    Parameters
    ----------
    events, part : str
        What the faults are: such that disturb each time, none if '', and such of which a part is
        normal.
    warning, error : float
        Fraction of `part` that is a warning, and an error, 0 to 1. Of the events any is a
        warning, and one per second an error.
    period : int
        Control period, for the text [ns].

    Attributes
    ----------
    cause : str
        What is known to be the cause; '' where nothing is.

    """

    def __init__(self, events: str, part: str, warning: float, error: float, period: int) -> None:
        self._events, self._part = events, part
        self._warning, self._error = warning, error
        self._period = period
        self.cause = ''
        #: Time [ns], events, faults of the other kind, and what those are a part of.
        self._reports: deque[tuple[int, int, int, int]] = deque(maxlen=WINDOW + 1)
        self._detail = ''

    def note(self, now: int, events: int, part: int, whole: int, detail: str) -> None:
        """
        Take the totals at a report.

        Parameters
        ----------
        now : int
            Time of the report [ns].
        events : int
            Number of events so far.
        part, whole : int
            Number of faults of the other kind so far, and what the fraction is of.
        detail : str
            What else is known of the latter.

        """
        self._detail = detail
        self._reports.append((now, events, part, whole))

    def _increase(self, column: int) -> int:
        """Return by how much a number has grown over the reports kept."""
        return self._reports[-1][column] - self._reports[0][column] if self._reports else 0

    @property
    def events_per_second(self) -> float:
        """Events per second over the last reports [1/s]."""
        return self._increase(1) / max(seconds(self._increase(0)), 1e-9)

    @property
    def fraction(self) -> float:
        """Fraction of the other faults over the last reports, 0 to 1."""
        return self._increase(2) / max(self._increase(3), 1)

    @property
    def level(self) -> int:
        """0 if all is well, 1 if a warning is due, 2 if an error is."""
        if self.events_per_second >= 1.0 or self.fraction > self._error:
            return 2
        return int(self.events_per_second > 0.0 or self.fraction > self._warning)

    def __str__(self) -> str:
        """Return the rates and the likely cause on one line."""
        detail = f' ({self._detail})' if self._detail else ''
        events, percent = self.events_per_second, round(100.0 * self.fraction)
        found = [f'{events:.2g} {self._events} per second'] if events else []
        if percent or not found:
            found.append(f'{percent} % {self._part}{detail}')
        cause = self.cause or f'{BUSY}; control_period is {1e3 * seconds(self._period):g} ms'
        return f'{", ".join(found)}: {cause}'


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
    taken, skipped, restarts, saturated : int
        States taken, states skipped for newer ones, restarts of the law, samples with a torque at
        its limit.
    rates : HealthMonitor
        Of restarts and rejected states.
    skips : HealthMonitor
        Of states skipped for newer ones.

    """

    def __init__(self, names: Sequence[str], period: int) -> None:
        self._names, self._period = names, period
        self.taken = self.skipped = self.restarts = self.saturated = 0
        self.rates = HealthMonitor('restarts', 'of the states refused', *_REJECTED, period)
        self.skips = HealthMonitor('', 'of the states skipped for newer ones', *_SKIPPED, period)
        #: Stamp [ns] of the last state, and its number with those skipped; the same at the last
        #: reports since a restart.
        self._latest = 0, 0
        self._stamps: deque[tuple[int, int]] = deque(maxlen=PATIENCE + 1)
        #: Under which configuration the law runs, and its last terms [N·m].
        self._config: ControllerConfig | None = None
        self._terms: deque[Vector] = deque(maxlen=_LATEST)
        self._rejected: Mapping[str, int] = {}

    def take(self, t: int, skipped: int = 0) -> None:
        """Count a state of stamp `t` [ns]; so many have been `skipped` so far."""
        self.taken += 1
        self.skipped = skipped
        self._latest = t, self.taken + skipped
        if not self._stamps:
            self._stamps.append(self._latest)

    def restart(self) -> None:
        """Count a restart: the next state does not follow the last one."""
        self.restarts += 1
        self._stamps.clear()

    @property
    def periods(self) -> list[int]:
        """Return the mean periods of the stamps between the last reports [ns]."""
        return [round((t - t0) / (k - k0)) for (t0, k0), (t, k) in pairwise(self._stamps)]

    def pause(self) -> None:
        """Note that the next torque does not follow the last one."""
        self._terms.append((nan,) * len(self._names))

    def add(self, sample: Sample, config: ControllerConfig) -> None:
        """Count a sample of the law."""
        self.saturated += sample.saturation_error is not None
        if config is not self._config:
            self._config = config
            self._terms.clear()
        self._terms.append(sample.robust)

    def report(self, now: int, rejected: Mapping[str, int], simulated: bool,
               cause: str = '') -> list[tuple[int, str]]:
        """
        Return what goes wrong at present: level (1 warning, 2 error) and text.

        Parameters
        ----------
        now : int
            Time [ns].
        rejected : mapping
            Messages rejected so far, by kind.
        simulated : bool
            Whether time is simulated: then it is no matter how late states come.
        cause : str
            What is known to be the cause of late and skipped states; '' where nothing is.

        """
        before, self._rejected = self._rejected, {
            kind: n for kind, n in rejected.items() if kind != _UNRELATED}
        total = sum(self._rejected.values())
        self.rates.note(now, self.restarts, total, self.taken + total, ', '.join(
            kind for kind, n in self._rejected.items() if n > before.get(kind, 0)))
        self.skips.note(now, 0, self.skipped, self.taken + self.skipped, '')
        if self._stamps and self._latest != self._stamps[-1]:
            self._stamps.append(self._latest)
        found = []
        for monitor in (self.rates, self.skips):
            monitor.cause = cause
            if monitor.level and not simulated:
                found.append((monitor.level, str(monitor)))
        periods = self.periods
        if len(periods) == PATIENCE and all(
                abs(x - self._period) > TOLERANCE * self._period for x in periods):
            found.append((1, f'states come every {1e3 * seconds(periods[-1]):.3g} ms; '
                          f'control_period is {1e3 * seconds(self._period):g} ms'))
        config = self._config
        if config is not None and config.takes('ka'):
            found += [(1, f'{name}: {joint}') for name, joint in zip(self._names, term_saturation([
                (np.array(self._terms), config.ka, config.switching_in_force)])) if joint.cause]
        return found
