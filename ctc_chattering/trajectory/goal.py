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
A goal of the reference: waypoints that must be followed within tolerances.

`ros/trajectory_action.py` makes a `Goal` from a message of control_msgs/FollowJointTrajectory, and
has it judge every error that the controller reports. The rules are those of
joint_trajectory_controller of ros2_controllers.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from enum import IntEnum
from math import inf
from typing import NamedTuple

from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.time_grid import seconds

#: Value of a tolerance that removes the default one.
ERASE = -1.0


class GoalCode(IntEnum):
    """Outcome of a goal, with the code of control_msgs/FollowJointTrajectory."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


class GoalEnd(NamedTuple):
    """End of a goal."""

    code: GoalCode
    text: str


class JointTolerance(NamedTuple):
    """Largest error of a joint. It is inf where any is allowed."""

    #: [rad or m].
    position: float = inf
    #: [rad/s or m/s].
    velocity: float = inf

    def replaced(self, position: float, velocity: float) -> JointTolerance:
        """
        Return the tolerance that a goal asks for.

        0 keeps the default, `ERASE` removes it.

        Raises
        ------
        ParameterError
            If a value is neither of these and not positive.

        """
        return JointTolerance(
            _resolve('position', position, self.position),
            _resolve('velocity', velocity, self.velocity))

    def violation(self, name: str, e: float, de: float) -> str:
        """Describe how far errors exceed the tolerance, if they do."""
        if not abs(e) <= self.position:
            return f'{name}: position error {e:.4g}, allowed {self.position:.4g}'
        if not abs(de) <= self.velocity:
            return f'{name}: velocity error {de:.4g}, allowed {self.velocity:.4g}'
        return ''


def _resolve(name: str, value: float, default: float) -> float:
    """Return the tolerance that a value of a goal means."""
    if value == ERASE:
        return inf
    if not value:
        return default
    if not value > 0.0:
        raise ParameterError(f'{name} tolerance', value, 'more than 0, 0 for the default or -1')
    return value


@dataclasses.dataclass(frozen=True)
class GoalTolerances:
    """
    Tolerances of a goal.

    Attributes
    ----------
    path, goal : tuple of JointTolerance, length n
        On the way, and from the end of the motion on.
    goal_time : float
        Time after the end of the motion by which the joints are within `goal` [s]. inf for any.

    """

    path: tuple[JointTolerance, ...]
    goal: tuple[JointTolerance, ...]
    goal_time: float = inf


@dataclasses.dataclass(frozen=True)
class Goal:
    """
    A goal that is followed.

    Attributes
    ----------
    joint_names : sequence of str, length n
    end : int
        Path time at which the motion is at its last waypoint [ns].
    tolerances : GoalTolerances

    """

    joint_names: Sequence[str]
    end: int
    tolerances: GoalTolerances

    def judge(self, s: int, e: Sequence[float], de: Sequence[float]) -> GoalEnd | None:
        """
        Return how the goal ends with a sample, or None while it goes on.

        Parameters
        ----------
        s : int
            Path time of the sample [ns].
        e, de : sequence of float, shape (n,)
            Errors of position [rad] and velocity [rad/s].

        """
        if s < self.end:
            text = self._violations(self.tolerances.path, e, de)
            if text:
                return GoalEnd(GoalCode.PATH_TOLERANCE_VIOLATED,
                               f'The motion left its path: {text}.')
            return None
        text = self._violations(self.tolerances.goal, e, de)
        if not text:
            return GoalEnd(GoalCode.SUCCESSFUL, 'The joints have reached the goal.')
        late = seconds(s - self.end)
        if late > self.tolerances.goal_time:
            return GoalEnd(GoalCode.GOAL_TOLERANCE_VIOLATED,
                           f'The joints missed the goal {late:.3g} s after its end: {text}.')
        return None

    def _violations(self, tolerances: Sequence[JointTolerance], e: Sequence[float],
                    de: Sequence[float]) -> str:
        """Describe which joints exceed tolerances."""
        texts = [tolerance.violation(name, *errors) for tolerance, name, *errors
                 in zip(tolerances, self.joint_names, e, de)]
        return '; '.join(filter(None, texts))
