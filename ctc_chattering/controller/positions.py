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
Positions from state to state: whole turns, and jumps.

The control loop passes each state through a `PositionTracker` before the law sees it.

A driver may report a continuous joint within any turn. Its position stands for the representative
that follows the state before, (AN1) of `numerics/angles.py`, the first one for that nearest to the
reference.

No joint moves further within the time h between two states than its velocities explain::

    |q - q0| <= h (|dq0| + min(|dq - dq0|, A h)) + Q                                      (MP1)

q0 and dq0 are those of the state before. Arms accelerate less than A, so that a velocity which a
driver computes from the jump itself does not explain it. Q is for encoders.

A state that violates it is refused. Where several in a row do, and follow each other by (MP1), the
encoder was wrong about the joint's position, and the torques have to end.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isclose
from typing import NamedTuple

from ctc_chattering.numerics.angles import expected, nearest, TURN, turned, turns_to
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import seconds


class JointSample(NamedTuple):
    """A joint state: stamp [ns], position [rad], velocity [rad/s]."""

    t: int
    q: Vector
    dq: Vector


class JumpLimits(NamedTuple):
    """Bounds of (MP1), for rad and m alike."""

    #: Q: noise and rounding of encoders, and what a lagging velocity leaves [rad].
    margin: float = 0.1
    #: A: that of a wrist of 1e-3 kg·m² under 2 N·m [rad/s²].
    acceleration: float = 2000.0
    #: States in a row that agree on another position. With more, `state_timeout` would end the
    #: torques first, without the reason.
    agreeing: int = 3
    #: Largest difference between a jump and whole turns, for which it is taken for such [rad].
    like_a_turn: float = 0.1


LIMITS = JumpLimits()


class Jump(NamedTuple):
    """A position that does not follow the one before."""

    joint: int
    #: Position and velocity of the state before [rad, rad/s].
    last_position: float
    last_velocity: float
    position: float
    #: Time in between [s].
    elapsed: float

    @property
    def is_whole_turns(self) -> bool:
        """Return whether it is whole turns, as of some drivers."""
        distance = self.position - self.last_position
        turns = round(distance / TURN)
        return turns != 0 and isclose(distance, TURN * turns, abs_tol=LIMITS.like_a_turn)


def find_jump(previous: JointSample, state: JointSample) -> Jump | None:
    """Return the first joint that violates (MP1), if any."""
    margin = LIMITS.margin
    for joint, (q0, q) in enumerate(zip(previous.q, state.q)):
        step = abs(q - q0)
        if step <= margin:
            continue
        h = seconds(state.t - previous.t)
        dq0, dq = previous.dq[joint], state.dq[joint]
        if step > h * (abs(dq0) + min(abs(dq - dq0), LIMITS.acceleration * h)) + margin:
            return Jump(joint, q0, dq0, q, h)
    return None


class PositionTracker:
    """
    Follows positions from state to state.

    Attributes
    ----------
    continuous : sequence of bool, shape (n,)
        True for joints that turn endlessly, and empty for none.
    last : JointSample or None
        The last state that was taken, its positions with the turns that belong to them.
    anchored : bool
        Whether these turns are those of the reference.

    """

    def __init__(self) -> None:
        self.continuous: Sequence[bool] = ()
        self.last: JointSample | None = None
        self.anchored = False
        #: The last state, if it was refused, and the number of states in a row that agree.
        self._refused: JointSample | None = None
        self._agreeing = 0

    def forget(self) -> None:
        """Have the next state follow none, as after an outage."""
        self.last = None
        self._refused, self._agreeing = None, 0
        self.anchored = False

    def follow(self, state: JointSample) -> JointSample:
        """Return a state with whole turns added to its positions."""
        if self.last is None or not any(self.continuous):
            return state
        return self._follow(self.last, state)

    def _follow(self, previous: JointSample, state: JointSample) -> JointSample:
        if not self.continuous:
            return state
        h = seconds(state.t - previous.t)
        return state._replace(q=[
            nearest(q, expected(q0, dq0, dq, h)) if endless else q
            for q, dq, q0, dq0, endless in zip(
                state.q, state.dq, previous.q, previous.dq, self.continuous)])

    def take(self, state: JointSample) -> None:
        """Have the next states follow this one."""
        self.last = state
        self._refused, self._agreeing = None, 0

    def agrees(self, state: JointSample) -> bool:
        """Note a refused state, and return whether enough agree."""
        last, self._refused = self._refused, state
        if last is None or find_jump(last, self._follow(last, state)) is not None:
            self._agreeing = 0
        self._agreeing += 1
        return self._agreeing >= LIMITS.agreeing

    def anchor(self, state: JointSample, target: Vector) -> JointSample:
        """
        Return the state with the turns nearest to the reference.

        Parameters
        ----------
        state : JointSample
            The last one that was taken.
        target : sequence of float, shape (n,)
            Position of the reference at that time [rad].

        """
        self.anchored = True
        turns = [turns_to(q, desired) if endless else 0
                 for q, desired, endless in zip(state.q, target, self.continuous)]
        if any(turns):
            state = state._replace(q=list(map(turned, state.q, turns)))
            self.take(state)
        return state
