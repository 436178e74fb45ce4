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
The learner of a plan, for the reference node.

`MotionSchedule` tells it what it publishes next. The motions of the plan replace one another, and
some come again.
"""

from __future__ import annotations

from collections.abc import Callable

from ctc_chattering.errors import CtcError
from ctc_chattering.learning.learner import Learner
from ctc_chattering.learning.learning_filter import LearningFilter
from ctc_chattering.learning.motion import motion_of, RepeatedMotion, waypoint_motion
from ctc_chattering.trajectory.motion_plan import MotionPlan


class PlanLearner(Learner):
    """
    A learner of the motions of a plan.

    Parameters
    ----------
    plan : MotionPlan
        With its limits.
    period : int
        Control period [ns].
    filter_of : callable
        As `Learner` takes it.

    """

    def __init__(self, plan: MotionPlan, period: int,
                 filter_of: Callable[[RepeatedMotion], LearningFilter | None]) -> None:
        config = plan.config
        super().__init__(
            len(config.joint_names), config.learning_bound, period, filter_of, plan.limits)
        self._plan = plan
        #: Replacements of the plan's motion, up to the one that is followed.
        self._replacements: int | None = None
        #: Motion that is followed from its start on.
        self._next: RepeatedMotion | None = None

    @property
    def motion(self) -> RepeatedMotion | None:
        """Return the motion that is learned now or next."""
        return self._next or self._motion

    def follow_plan(self, begin: int, end: int) -> None:
        """Follow the plan's motion, of which `begin` to `end` is published next [ns]."""
        plan = self._plan
        if plan.replacements != self._replacements:
            self._replacements = plan.replacements
            self.follow(None, begin)
            self._next = self._repeated()
        motion = self._next
        if motion is not None and motion.start < end:
            self._next = None
            self.follow(motion, max(begin, motion.start))

    def drop(self, begin: int) -> None:
        """End the correction at path time `begin` [ns], without a passage."""
        self._replacements = self._plan.replacements
        self._next = None
        self.follow(None, begin, fade=0.0)

    def _repeated(self) -> RepeatedMotion | None:
        """Return the plan's motion as a repeated one, None if it is not."""
        plan, repetition = self._plan, self._plan.repetition
        self.problem = ''
        if repetition is None or plan.motion is None:
            return None
        route, begin = repetition
        if route is not None:
            return waypoint_motion(route, plan.motion, begin)
        try:
            return motion_of(plan.config, None, plan.motion)
        except CtcError as error:
            self.problem = str(error)
            return None
