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
Learning from the passes of a repeated motion.

The reference node and the simulated loop have one `Learner`. It takes the errors that the
controller reports, and at the end of a pass it makes the correction of the next. A pass is one
whole period, or one run through waypoints, with an unchanged correction. Between two passes of a
periodic motion lie `LEAD_NS`, since the reference is published ahead, and `FADE_S`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import dataclasses
from enum import Enum
from math import inf, pi
from typing import NamedTuple

from ctc_chattering.errors import CtcError
from ctc_chattering.learning.correction import CorrectedMotion, Correction, NoCorrection
from ctc_chattering.learning.learning_filter import LearningFilter
from ctc_chattering.learning.motion import RepeatedMotion
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.trajectory.joint_limits import describe_violations, JointLimits
from ctc_chattering.trajectory.transitions import TimedMotion, Transition
import numpy as np

#: Time from the end of a pass to the change of the correction [ns].
LEAD_NS = NANOSECONDS // 2
#: Time in which one correction passes into another [s].
FADE_S = 0.25
#: Time from the start of a periodic motion to its first pass [ns].
_SETTLING_NS = NANOSECONDS
#: Longest time between two errors of a pass [ns].
_MAX_GAP_NS = NANOSECONDS // 10
#: Time by which waypoints are extended for the filter, so that their end passes into their begin
#: [s].
_LEAD_OUT_S = 1.0
#: Error over the least one, and over that of the first pass, from which on it is growing.
_GROWTH = 2.0
_GROWTH_FROM_FIRST = 1.1
#: Error over that of the pass before, below which it recovers.
_RECOVERY = 0.7
#: Passes in a row with a growing error after which learning stops.
_MAX_GROWING_PASSES = 2
#: Rounding of a reported reference [rad].
_ROUNDING = 1e-6
#: Number of points of a pass at which limits are checked.
_LIMIT_CHECKS = 500


class LearningState(Enum):
    """What a `Learner` does with its passes, in words."""

    LEARNING = 'learning'
    FROZEN = 'frozen'
    STOPPED = 'stopped, because the error grew over two passes'


class Pass(NamedTuple):
    """A pass with its errors."""

    #: Path time of its begin and end [ns].
    begin: int
    end: int
    #: RMS of each joint's error from the desired motion, shape (n,) [rad].
    rms: tuple[float, ...]


class _ReportedError(NamedTuple):
    """An error that the controller reported."""

    s: int
    #: Correction of the reference, and error from the desired motion, shape (n,) [rad].
    correction: Array
    e: Array


@dataclasses.dataclass
class _Progress:
    """What was learned of a motion."""

    passes: list[Pass] = dataclasses.field(default_factory=list)
    #: Correction in force, shape (N, n) [rad], None for none; and that with the least error.
    rows: Array | None = None
    best_rows: Array | None = None
    #: Errors of all joints, the root of the sum of their squares [rad].
    first_error: float = inf
    least_error: float = inf
    last_error: float = inf
    growing_passes: int = 0

    @property
    def is_stopped(self) -> bool:
        return self.growing_passes >= _MAX_GROWING_PASSES

    def judge(self, error: float) -> None:
        """Take the error of a pass, and return to the best correction where errors grow."""
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
        """Judge the next pass by itself."""
        self.first_error = self.least_error = self.last_error = inf


class Learner:
    """
    The correction of a motion that is repeated.

    Parameters
    ----------
    n : int
        Number of joints.
    bound : float
        Largest correction [rad].
    period : int
        Control period [ns].
    filter_of : callable
        Returns the learning filter for a `RepeatedMotion` and the law in force, None while it is
        not known. It raises `CtcError` for a law under which learning need not converge.
    limits : sequence of JointLimits, length n, optional
        Limits that the corrected motion must keep.

    Attributes
    ----------
    problem : str
        Why the last pass has changed nothing, if so.
    is_frozen : bool
        Whether corrections stay as they are.

    """

    def __init__(self, n: int, bound: float, period: int,
                 filter_of: Callable[[RepeatedMotion], LearningFilter | None],
                 limits: Sequence[JointLimits] | None = None) -> None:
        self._bound = bound
        self._period = period
        self._filter_of = filter_of
        self._limits = limits
        self.problem = ''
        self.is_frozen = False
        self._none = NoCorrection(n)
        self._applied: TimedMotion = self._none
        self._progress: dict[str, _Progress] = {}
        self._motion: RepeatedMotion | None = None
        #: Path time at which the present pass begins [ns], None while none is measured.
        self._begin: int | None = None
        self._samples: list[_ReportedError] = []

    @property
    def _present(self) -> _Progress:
        return self._progress[self._motion.name] if self._motion else _Progress()

    @property
    def passes(self) -> list[Pass]:
        """Return the passes of the present motion."""
        return self._present.passes

    @property
    def rows(self) -> Array | None:
        """Return the correction of the present motion, shape (N, n) [rad], None for none."""
        return self._present.rows

    @property
    def state(self) -> LearningState:
        """Return what it does with its passes."""
        if self.is_frozen:
            return LearningState.FROZEN
        return LearningState.STOPPED if self._present.is_stopped else LearningState.LEARNING

    def corrected(self, motion: TimedMotion) -> TimedMotion:
        """Return a motion with the correction in force."""
        return CorrectedMotion(motion, self._applied)

    def known_until(self) -> int | None:
        """Return the path time before which the correction is final [ns], None for ever."""
        motion = self._motion
        is_changing = motion is not None and motion.is_periodic and self._begin is not None
        if not is_changing or self.state is not LearningState.LEARNING:
            return None
        return self._end + LEAD_NS

    @property
    def _end(self) -> int:
        """Path time at which the present pass ends [ns]."""
        assert self._begin is not None and self._motion is not None
        return self._begin + self._motion.duration

    def follow(self, motion: RepeatedMotion | None, begin: int, rows: Array | None = None) -> None:
        """
        Pass into the correction of another motion.

        Parameters
        ----------
        motion : RepeatedMotion or None
            The motion, None for one that is not repeated.
        begin : int
            Path time from which it is followed [ns].
        rows : array, shape (N, n), optional
            Its correction, if it was learned before [rad].

        """
        if self._begin is not None and begin >= self._end:
            self._finish()
        self._motion = motion
        self._samples = []
        self._begin = None
        if motion is None:
            self._fade(begin)
            return
        progress = self._progress.setdefault(motion.name, _Progress())
        if rows is not None:
            progress.rows = rows
        if motion.is_periodic:
            self._begin = begin + _SETTLING_NS
        elif begin <= motion.begin:
            self._begin = motion.begin
        self._fade(begin)

    def reset(self, begin: int) -> None:
        """Forget what was learned, and pass into no correction from path time `begin` [ns] on."""
        self._progress.clear()
        self.follow(self._motion, begin)

    def interrupt(self, until: int | None) -> None:
        """
        Leave out the present pass.

        Parameters
        ----------
        until : int or None
            Path time at which the next one begins [ns], None for that of the next error. Waypoints
            are measured from their begin only.

        """
        self._samples = []
        self._present.forget_errors()
        self._begin = until if self._motion and self._motion.is_periodic else None

    def add(self, s: int, q_d: Sequence[float], e: Sequence[float]) -> None:
        """
        Take an error that the controller reports.

        Parameters
        ----------
        s : int
            Path time of its stamp [ns].
        q_d, e : sequence of float, shape (n,)
            Position of the corrected reference, and error from it [rad].

        """
        motion = self._motion
        if motion is None or (self._begin is None and not motion.is_periodic):
            return
        if self._begin is None:
            self._begin = s
        if s >= self._end:
            self._finish()
        if self._begin is None or s < self._begin:
            return
        position, _, _ = motion.motion.at(s)
        turns = np.array(q_d) - position
        correction = turns - 2.0 * pi * np.rint(turns / (2.0 * pi))
        self._samples.append(_ReportedError(s, correction, np.array(e) - correction))

    def _finish(self) -> None:
        """End a pass, and begin the next one."""
        motion, begin, end = self._motion, self._begin, self._end
        assert motion is not None and begin is not None
        samples, self._samples = self._samples, []
        before = self._present.rows
        try:
            self._learn(motion, begin, end, samples)
            self.problem = ''
        except CtcError as error:
            self.problem = str(error)
        is_changed = self._present.rows is not before
        self._begin = None
        if motion.is_periodic:
            self._begin = end
            if is_changed:
                change = end + LEAD_NS
                self._fade(change)
                self._begin = change + round(FADE_S * NANOSECONDS)

    def _learn(self, motion: RepeatedMotion, begin: int, end: int,
               samples: Sequence[_ReportedError]) -> None:
        """Judge a pass, and make the correction of the next; raise `CtcError` if it cannot."""
        progress = self._present
        stamps = np.array([begin, *(sample.s for sample in samples), end])
        gap = int(np.diff(stamps).max())
        if gap > _MAX_GAP_NS:
            raise CtcError(f'errors of {seconds(gap):.3g} s are missing in the pass')
        correction = np.array([sample.correction for sample in samples])
        e = np.array([sample.e for sample in samples])
        if np.abs(correction).max() > self._bound + _ROUNDING:
            raise CtcError('the controller did not follow the reference in the pass')
        rms = np.sqrt((e ** 2).mean(axis=0))
        progress.passes.append(Pass(begin, end, tuple(rms.tolist())))
        if self.state is not LearningState.LEARNING:
            return
        progress.judge(float(np.linalg.norm(rms)))
        if progress.is_stopped:
            return
        learning_filter = self._filter_of(motion)
        if learning_filter is None:
            raise CtcError('the parameters of the controller are not known')
        count = motion.duration // self._period
        interval = motion.duration / count
        phases = np.array([motion.phase(sample.s) for sample in samples])
        around = motion.duration if motion.is_periodic else None
        grid = interval * np.arange(count)
        correction, e = (np.column_stack([np.interp(grid, phases, column, period=around)
                                          for column in x.T]) for x in (correction, e))
        lead_out = 0.0 if motion.is_periodic else _LEAD_OUT_S
        rows = learning_filter.update(correction, e, interval / NANOSECONDS, lead_out)
        excess = np.abs(rows).max(axis=0) / self._bound
        rows = rows / np.maximum(excess, 1.0)
        self._check_limits(motion, rows)
        progress.rows = rows

    def _check_limits(self, motion: RepeatedMotion, rows: Array) -> None:
        """Raise `CtcError` if a corrected motion exceeds limits."""
        if self._limits is None:
            return
        corrected = CorrectedMotion(motion.motion, Correction(motion, rows))
        instants = np.linspace(0, motion.duration, _LIMIT_CHECKS).astype(int).tolist()
        points = [corrected.at(motion.begin + t) for t in instants]
        if violations := describe_violations(self._limits, points):
            raise CtcError(f'the corrected motion is beyond the limits: {violations}')

    def _fade(self, begin: int) -> None:
        """Pass into the correction of the present motion from path time `begin` [ns] on."""
        while isinstance(self._applied, Transition) and begin >= self._applied.end:
            self._applied = self._applied.target
        rows = self._present.rows
        target: TimedMotion = self._none
        if self._motion is not None and rows is not None:
            target = Correction(self._motion, rows)
        self._applied = Transition(self._applied, target, begin, FADE_S)
