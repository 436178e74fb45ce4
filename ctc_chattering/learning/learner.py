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
from enum import Enum
from typing import NamedTuple

from ctc_chattering.errors import CtcError
from ctc_chattering.learning.correction import ConstantCorrection, CorrectedMotion, Correction
from ctc_chattering.learning.learning_filter import LearningFilter
from ctc_chattering.learning.motion import RepeatedMotion
from ctc_chattering.learning.progress import Pass, Progress
from ctc_chattering.numerics.angles import within_half_turn
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.joint_limits import describe_violations, JointLimits
from ctc_chattering.trajectory.transitions import TimedMotion, Transition
import numpy as np

#: Time from the end of a pass to the change of the correction [ns].
LEAD_NS = NANOSECONDS // 2
#: Time in which one correction passes into another [s].
FADE_S = 0.25
#: Time between two passes of a periodic motion, in which the correction changes [ns].
_CHANGE_NS = LEAD_NS + round(FADE_S * NANOSECONDS)
#: Time at the begin of waypoints in which their correction begins, and in which it ends [s].
_ENTRY_S = 0.05
#: Time from the start of a periodic motion to its first pass [ns].
_SETTLING_NS = NANOSECONDS
#: Longest interval at which errors may be reported [ns].
MAX_GAP_NS = NANOSECONDS // 10
#: Time by which waypoints are extended for the filter, which needs a periodic signal [s].
_LEAD_OUT_S = 1.0
#: Number of motions that are remembered. A planner that plans anew sends ever others.
MAX_MOTIONS = 50
#: Rounding of a reported reference [rad].
_ROUNDING = 1e-6
#: Number of points of a pass at which limits are checked.
_LIMIT_CHECKS = 500
#: Smallest share of a correction that is tried to keep limits. Below it the correction is 0.
_LEAST_SHARE = 0.1


def duration_of_passes(motion: RepeatedMotion, count: int) -> int:
    """
    Return the path time at which `count` passes have ended [ns].

    The motion is periodic. Pass k begins at that of k passes, if each changes the correction.
    """
    return motion.start + _SETTLING_NS + count * (motion.duration + _CHANGE_NS)


class LearningState(Enum):
    """State of a `Learner`, with its text as value."""

    LEARNING = 'learning'
    FROZEN = 'frozen'
    STOPPED = 'stopped, because the error grew over two passes'
    REFUSED = 'refused'
    IDLE = 'waiting for a motion that is repeated'


class _ErrorSample(NamedTuple):
    """An error that the controller reported."""

    s: int
    #: Correction of the reference, and error from the desired motion, shape (n,) [rad].
    correction: Array
    e: Array


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
        Why nothing was learned from the last pass, '' if it was.
    refusal : str
        Why nothing may be learned under the law in force, '' if it may.
    limits : sequence of JointLimits, length n, or None
        Limits that the corrected motion must keep.
    motion : RepeatedMotion or None
        The present one.
    applied : TimedMotion
        The correction in force.
    is_frozen : bool
        Whether corrections stay as they are.

    """

    def __init__(self, n: int, bound: float, period: int,
                 filter_of: Callable[[RepeatedMotion], LearningFilter | None],
                 limits: Sequence[JointLimits] | None = None) -> None:
        self._bound = bound
        self._period = period
        self._filter_of = filter_of
        self.limits = limits
        self.problem = ''
        self.refusal = ''
        self.is_frozen = False
        self._none = ConstantCorrection((0.0,) * n)
        self.applied: TimedMotion = self._none
        self._progress: dict[str, Progress] = {}
        self.motion: RepeatedMotion | None = None
        #: Path time at which the present pass begins [ns], None while none is measured.
        self._begin: int | None = None
        self._samples: list[_ErrorSample] = []
        self._is_at_bound = False

    @property
    def _present(self) -> Progress:
        return self._progress[self.motion.name] if self.motion else Progress()

    @property
    def is_measuring(self) -> bool:
        """Return whether samples of a pass have come."""
        return bool(self._samples)

    @property
    def passes(self) -> list[Pass]:
        """Return the passes of the present motion."""
        return self._present.passes

    @property
    def rows(self) -> Array | None:
        """Return the present motion's correction, shape (N, n) [rad], or None."""
        return self._present.rows

    @property
    def state(self) -> LearningState:
        """Return what it does with its passes."""
        if self.refusal:
            return LearningState.REFUSED
        if self.is_frozen:
            return LearningState.FROZEN
        if self.motion is None:
            return LearningState.IDLE
        return LearningState.STOPPED if self._present.is_stopped else LearningState.LEARNING

    @property
    def outcome(self) -> str:
        """Return the state, or why nothing was learned, in words."""
        if self.refusal:
            return self.refusal
        if self.problem:
            # The error of a pass that was left out is not the one that stands before this.
            subject = 'the latest pass was not learned from: ' if self.passes else ''
            return subject + self.problem
        at_bound = ', with a correction at learning_bound' if self._is_at_bound else ''
        return self.state.value + at_bound

    @property
    def report(self) -> str:
        """Return the last pass and its outcome in words."""
        if not self.passes:
            return f'no pass yet: {self.outcome}'
        return (f'pass {len(self.passes)}: the RMS error of the worst joint is '
                f'{max(self.passes[-1].rms):.3g} rad; {self.outcome}')

    def corrected(self, motion: TimedMotion) -> TimedMotion:
        """Return a motion with the correction in force."""
        return CorrectedMotion(motion, self.applied)

    def known_until(self) -> int | None:
        """
        Return the path time before which the correction is final [ns].

        It is None where the correction does not change.
        """
        motion, state = self.motion, self.state
        may_change = state is LearningState.LEARNING or (
            state is LearningState.STOPPED and self.rows is not None)
        if motion is None or not motion.is_periodic or self._begin is None or not may_change:
            return None
        return self._end + LEAD_NS

    @property
    def _end(self) -> int:
        """Path time at which the present pass ends [ns]."""
        assert self._begin is not None and self.motion is not None
        return self._begin + self.motion.duration

    def follow(self, motion: RepeatedMotion | None, begin: int, rows: Array | None = None,
               fade: float = FADE_S) -> None:
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
        fade : float
            Time in which its correction replaces the present one [s].

        """
        if self._begin is not None and begin >= self._end:
            self._finish()
        self.motion = motion
        self._samples = []
        self._begin = None
        if motion is None:
            self._fade(begin, fade)
            return
        progress = self._progress.pop(motion.name, Progress())
        if len(self._progress) == MAX_MOTIONS:
            del self._progress[next(iter(self._progress))]
        self._progress[motion.name] = progress
        if rows is not None:
            progress.rows = rows
        if motion.is_periodic:
            self._begin = begin + _SETTLING_NS
        elif begin <= motion.begin:
            self._begin = motion.begin
        self._fade(begin, fade)

    def remember(self, name: str, rows: Array) -> None:
        """Take the correction of a motion to come, shape (N, n) [rad]."""
        self._progress[name] = Progress(rows=rows)

    def reset(self, begin: int) -> None:
        """Forget what was learned, and fade it out from path time `begin` [ns]."""
        self._progress.clear()
        self._begin = None
        self.follow(self.motion, begin)

    def interrupt(self, until: int | None) -> None:
        """
        Leave out the present pass.

        Parameters
        ----------
        until : int or None
            Path time from which passes are judged anew, as after a change of speed [ns]. The next
            pass begins a second later. With None it begins a second after the next error, and is
            judged as before. Waypoints are measured from their begin only.

        """
        self._samples = []
        self._begin = None
        if until is not None:
            self._present.forget_errors()
            if self.motion and self.motion.is_periodic:
                self._begin = until + _SETTLING_NS

    def add(self, s: int, q_d: Sequence[float], e: Sequence[float],
            correction: Point | None = None) -> None:
        """
        Take an error that the controller reports.

        Parameters
        ----------
        s : int
            Path time of its stamp [ns].
        q_d, e : sequence of float, shape (n,)
            Position of the corrected reference, and error from it [rad].
        correction : (position, velocity, acceleration), each of shape (n,), optional
            Correction of the reference, by default that in force [rad, rad/s, rad/s²].

        """
        motion = self.motion
        if motion is None or (self._begin is None and not motion.is_periodic):
            return
        if self._begin is None:
            self._begin = s + _SETTLING_NS
        if s >= self._end:
            self._finish()
        if self._begin is None or s < self._begin:
            return
        r, dr, ddr = map(np.array, self.applied.at(s) if correction is None else correction)
        q, dq, ddq = map(np.array, motion.motion.at(s))
        distance = within_half_turn(np.array(q_d) - q - r)
        # The controller takes a state at its sample, and not at its stamp.
        h = seconds(self._period)
        allowed = h * np.abs(dq + dr) + 0.5 * h * h * np.abs(ddq + ddr) + _ROUNDING
        if not (np.abs(distance) <= allowed).all():
            self.interrupt(None)
            self.problem = 'the controller or its reference left the motion'
            return
        self._samples.append(_ErrorSample(s, r, np.array(e) - r))

    def _finish(self) -> None:
        """End a pass, and begin the next one."""
        motion, begin, end = self.motion, self._begin, self._end
        assert motion is not None and begin is not None
        samples, self._samples = self._samples, []
        rows_of_pass = self._present.rows
        try:
            self._learn(motion, begin, end, samples)
            self.problem = ''
        except CtcError as error:
            self.problem = str(error)
        is_changed = self._present.rows is not rows_of_pass
        self._begin = None
        if motion.is_periodic:
            self._begin = end
            if is_changed:
                self._fade(end + LEAD_NS)
                self._begin = end + _CHANGE_NS

    def _learn(self, motion: RepeatedMotion, begin: int, end: int, samples: Sequence[_ErrorSample]
               ) -> None:
        """
        Judge a pass, and make the correction of the next.

        A pass from which nothing can be learned raises `CtcError`.
        """
        progress = self._present
        stamps = np.array([begin, *(sample.s for sample in samples), end])
        intervals = np.diff(stamps)
        gap = int(intervals.max())
        # One of the rarest errors may be lost.
        allowed = max(MAX_GAP_NS, 2.5 * float(np.median(intervals)))
        if gap > min(allowed, (end - begin) // 2):
            raise CtcError(f'errors of {seconds(gap):.3g} s are missing in the pass')
        correction = np.array([sample.correction for sample in samples])
        e = np.array([sample.e for sample in samples])
        rms = np.sqrt((e ** 2).mean(axis=0))
        if not np.isfinite(rms).all():
            raise CtcError('the errors of the pass are too large')
        progress.passes.append(Pass(begin, end, tuple(rms.tolist())))
        if self.is_frozen or self.refusal:
            return
        progress.judge(float(np.linalg.norm(rms)))
        if progress.is_stopped:
            return
        learning_filter = self._filter_of(motion)
        if learning_filter is None:
            raise CtcError('the parameters of the controller are not known')
        count = max(motion.duration // self._period, 1)
        interval = motion.duration / count
        phases = np.array([motion.phase(sample.s) for sample in samples])
        around = motion.duration if motion.is_periodic else None
        grid = interval * np.arange(count)
        correction, e = (np.column_stack([np.interp(grid, phases, column, period=around)
                                          for column in x.T]) for x in (correction, e))
        lead_out = 0.0 if motion.is_periodic else _LEAD_OUT_S
        rows = learning_filter.update(correction, e, interval / NANOSECONDS, lead_out)
        self._is_at_bound = bool(np.abs(rows).max() > self._bound)
        progress.rows = self._within_limits(motion, _bounded(rows, self._bound))

    def _within_limits(self, motion: RepeatedMotion, rows: Array) -> Array:
        """Return a correction scaled to keep the limits, shape (N, n)."""
        instants = (motion.begin + np.linspace(0, motion.duration, _LIMIT_CHECKS)).astype(int)
        correction = Correction(motion, rows)
        desired, added = (np.array([x.at(t) for t in instants.tolist()])
                          for x in (motion.motion, correction))
        shares = np.ones(rows.shape[1])
        for i, limits in enumerate(self.limits or ()):
            while shares[i] and describe_violations(
                    [limits], (desired + shares * added)[:, :, [i]].tolist()):
                shares[i] = 0.5 * shares[i] if shares[i] > _LEAST_SHARE else 0.0
        return rows * shares

    def _fade(self, begin: int, duration: float = FADE_S) -> None:
        """Pass into the present motion's correction from path time `begin` [ns] on."""
        while isinstance(self.applied, Transition) and begin >= self.applied.end:
            self.applied = self.applied.target
        rows = self._present.rows
        target: TimedMotion = self._none
        if self.motion is not None and rows is not None:
            target = Correction(self.motion, rows)
            if not self.motion.is_periodic:
                last = ConstantCorrection(rows[-1].tolist())
                end = self.motion.begin + self.motion.duration
                target = Transition(target, last, end - round(_ENTRY_S * NANOSECONDS), _ENTRY_S)
            present, _, _ = self.applied.at(begin)
            offset = np.array(present) - rows[0]
            is_within = (np.abs(rows).max(axis=0) + np.abs(offset) <= self._bound).all()
            if begin <= self.motion.begin and not self.motion.is_periodic and is_within:
                # Most errors are those of the start. So it soon is complete but for an offset.
                shifted = CorrectedMotion(target, ConstantCorrection(offset.tolist()))
                self.applied = Transition(self.applied, shifted, begin, _ENTRY_S)
        self.applied = Transition(self.applied, target, begin, duration)


def _bounded(rows: Array, bound: float) -> Array:
    """Scale joints of a correction to be within ±bound."""
    # A spline exceeds its samples by less than their second difference.
    bend = np.abs(np.diff(rows, 2, axis=0)).max(axis=0, initial=0.0)
    bounded: Array = rows / np.maximum((np.abs(rows).max(axis=0) + bend) / bound, 1.0)
    return bounded
