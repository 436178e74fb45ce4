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
The schedule of a reference that learns.

It publishes the motion of the plan with the correction of a `Learner`. A chunk waits until its
correction is final. The plan has the desired motion only.
"""

from __future__ import annotations

from collections.abc import Callable

from ctc_chattering.errors import CtcError
from ctc_chattering.learning.learner import LEAD_NS, Learner
from ctc_chattering.learning.learning_filter import LearningFilter
from ctc_chattering.learning.motion import motion_of, RepeatedMotion, waypoint_motion
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.motion_plan import MotionPlan
from ctc_chattering.trajectory.path_clock import ScaledMotion
from ctc_chattering.trajectory.schedule import MotionSchedule
from ctc_chattering.trajectory.transitions import TimedMotion

#: Longest time by which a motion in simulated time comes late, below that after which the
#: controller takes it for lost [ns].
_MAX_DELAY_NS = NANOSECONDS // 20


class LearningSchedule(MotionSchedule):
    """
    Schedule of a motion that is learned.

    Parameters
    ----------
    plan, period, horizon
        As of `MotionSchedule`.
    filter_of : callable
        As `Learner` takes it.

    Attributes
    ----------
    learner : Learner

    """

    def __init__(self, plan: MotionPlan, period: int, horizon: int,
                 filter_of: Callable[[RepeatedMotion], LearningFilter | None]) -> None:
        super().__init__(plan, period, min(horizon, LEAD_NS))
        config = plan.config
        self.learner = Learner(
            len(config.joint_names), config.learning_bound, period, filter_of)
        #: Number of the plan's motion that the learner follows, None for none.
        self._followed: int | None = None
        #: Motion that the learner will follow once its smooth start has ended.
        self._following: RepeatedMotion | None = None

    @property
    def repeated(self) -> RepeatedMotion | None:
        """Return the motion that is learned now or next."""
        return self._following or self.learner.motion

    def correction(self, stamp: int) -> Point:
        """Return the reference's correction at a stamp [ns]."""
        motion = ScaledMotion(self.learner.applied, self._clock)
        return motion.at(stamp - (self._start or 0))

    def freeze(self, on: bool) -> None:
        """Keep what was learned, or learn from the next pass on."""
        if self.learner.is_frozen and not on:
            self.learner.interrupt(self._clock.at(self._next * self._period).instant)
        self.learner.is_frozen = on

    def reset_learning(self) -> None:
        """Forget what was learned, and publish soon without it."""
        self.learner.reset(self._path_begin)
        self._next = self._after_published(self.now or 0) // self._period

    def rest_at(self, q: Vector) -> None:
        """Rest at a position, without a correction."""
        super().rest_at(q)
        self._followed, self._following = self._plan.replacements, None
        self.learner.follow(None, self._path_begin, fade=0.0)

    def _after_published(self, now: int) -> int:
        """
        Return the first instant that may still change [ns].

        It is no later than the first one that is held back.
        """
        held_back = max(self._next, now // self._period) * self._period
        return min(super()._after_published(now), held_back)

    def _published(self) -> TimedMotion:
        return self.learner.corrected(super()._published())

    def _change_rate(self, begin: int, rate: float) -> None:
        super()._change_rate(begin, rate)
        self.learner.interrupt(self._clock.at(self._clock.end).instant)

    def _is_final(self, begin: int, end: int) -> bool:
        """
        Return whether samples between two instants [ns] are final.

        Samples after a pass wait for its errors, since they change the correction. If the samples
        are needed before the errors have come, the pass is left out.
        """
        self._follow_plan(self._clock.at(begin).instant, self._clock.at(end).instant)
        known_until = self.learner.known_until()
        if known_until is None or self._clock.at(end - self._period).instant < known_until:
            return True
        needed = self._next * self._period + (
            _MAX_DELAY_NS if self.simulated else begin - end)
        if (self.now or 0) <= needed:
            return False
        self.learner.interrupt(self._clock.at(begin).instant)
        self.learner.problem = 'the controller has reported no errors of the pass'
        return True

    def _follow_plan(self, begin: int, end: int) -> None:
        """
        Have the learner follow the motion of the plan.

        Path time `begin` to `end` is published next [ns].
        """
        learner, plan = self.learner, self._plan
        if plan.replacements != self._followed:
            self._followed = plan.replacements
            learner.follow(None, begin)
            self._following = self._repeat()
        motion = self._following
        if motion is not None and motion.start < end:
            self._following = None
            learner.follow(motion, max(begin, motion.start))

    def _repeat(self) -> RepeatedMotion | None:
        """Return the plan's motion if it is repeated, or None."""
        plan, repetition = self._plan, self._plan.repetition
        self.learner.problem = ''
        if repetition is None or plan.motion is None:
            return None
        route, begin, start = repetition
        try:
            return (motion_of(plan.config, None, plan.motion) if route is None
                    else waypoint_motion(route, plan.motion, begin, start))
        except CtcError as error:
            self.learner.problem = str(error)
            return None
