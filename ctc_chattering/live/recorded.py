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

"""A recorded run for the page: where the arm was at any time, and the signals before it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ctc_chattering.analysis.interactive_plots import packed, PARTS, signals_of
from ctc_chattering.analysis.result import Result
from ctc_chattering.errors import CtcError
from ctc_chattering.live.samples import Instant, Samples
from ctc_chattering.live.skeleton import Skeleton, skeleton_of
import numpy as np

#: What is taken for it at most [s].
_SETTLED = 1.0
#: Signals that are sent together: those that are drawn first come first.
_TOGETHER = (('e',), ('V',), ('torque', *PARTS), ('q', 'q_d'), ('dq',), ('v',))


class RecordedRun:
    """
    The samples of a run.

    Parameters
    ----------
    result : Result
        As `read_bag` returns it.

    Attributes
    ----------
    result : Result
    name : str
        Of the bag.
    skeleton : Skeleton or None
        None for a model without a description, or with one that cannot be drawn.
    remark : str
        Why it cannot; else empty.
    signals : dict of str to ndarray
        As `signals_of` returns them.
    begin, end : float
        Times of the first and of the last sample [s].
    settled : float
        Time after which errors and torques that were large at the start are small [s].

    """

    def __init__(self, result: Result) -> None:
        run = result.run
        self.result = result
        # The name of a file may have bytes that are no text.
        self.name = (result.source or result.label).encode('utf-8', 'replace').decode()
        self.skeleton: Skeleton | None = None
        self.remark = ''
        try:
            self.skeleton = skeleton_of(result.config, result.description)
        except CtcError as error:
            self.remark = f'no picture of the arm: {error}'
        self.begin, self.end = float(run.t[0]), float(run.t[-1])
        self.settled = self.begin + min(_SETTLED, 0.2 * (self.end - self.begin))
        self._run = run
        self.signals = signals_of(result)
        self.samples = Samples(run.t, self.signals['e'], self.signals['v'], run.tau)

    def packed(self, r: int) -> Iterator[bytes]:
        """Yield all samples for the plots, as those of run number `r`, in parts."""
        for signals in _TOGETHER:
            yield packed(self._run.t, {name: self.signals[name] for name in signals}, run=r)

    def index(self, t: float) -> int:
        """Return the number of the last sample at or before a time [s], or of the first one."""
        # The slider's times are rounded to a millisecond, and a sum of steps.
        return max(0, int(np.searchsorted(self._run.t, t + 5e-7, side='right')) - 1)

    def at(self, t: float) -> Instant:
        """Return the sample at a time [s]."""
        k = self.index(t)
        return Instant(float(self._run.t[k]), self._run.q[k], self._run.q_d[k])

    def before(self, t: float, window: float) -> Samples:
        """Return the samples of the last `window` seconds before a time, itself included."""
        run = self.samples
        end = self.index(t) + 1
        begin = int(np.searchsorted(run.t, run.t[end - 1] - window))
        return run.part(slice(begin, end))

    def law(self, t: float) -> str:
        """Return law and switching in force at a time."""
        config = [c for begin, c in self.result.configs if begin <= t or begin == 0.0] or [
            self.result.configs[0][1]]
        now = config[-1]
        return now.law + (f', {now.switching}' if now.takes('switching') else '')


class Player:
    """
    The time that the page shows: it stands, or goes on at a speed.

    Parameters
    ----------
    end, begin : float
        Of the recording [s].

    Attributes
    ----------
    t : float
        [s].
    playing : bool
    speed : float
        1 for the speed of the recording.

    """

    def __init__(self, end: float, begin: float = 0.0) -> None:
        self.begin, self.end = begin, end
        self.t = begin
        self.playing = False
        self.speed = 1.0

    def play(self) -> None:
        """Go on; from the beginning if this is the end."""
        if self.t >= self.end:
            self.t = self.begin
        self.playing = True

    def seek(self, t: float) -> None:
        """Go to a time [s]."""
        self.t = min(max(self.begin, t), self.end)

    def advance(self, elapsed: float) -> None:
        """Go on by an elapsed time of the clock on the wall [s], and stop at the end."""
        if self.playing:
            self.seek(self.t + self.speed * elapsed)
            self.playing = self.t < self.end


def check_comparable(runs: Sequence[RecordedRun]) -> str:
    """Return why runs cannot be shown side by side; empty if they can."""
    names = [run.result.joint_names for run in runs]
    if len(runs) > 2:
        return f'{len(runs)} bags; one or two can be shown'
    if len(set(names)) > 1:
        return 'the bags have different joints: ' + '; '.join(', '.join(x) for x in names)
    return ''
