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
Recordings of a robot's motion.

A `Recording` has the samples as arrays. `bag_motion.py` and `table_motion.py` build it from files,
scripts from their own arrays. Its `checked` puts the states in order and refuses useless ones.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from enum import Enum
from pathlib import Path

from ctc_chattering.bags.state_order import order_states
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, shorten
from ctc_chattering.numerics.linear_algebra import Array, Indices
import numpy as np

#: Fewest states of a recording.
MIN_STATES = 200
#: Rows of velocities that are kept. They only tell noise and unit, and long series are large.
KEPT_VELOCITY_ROWS = 200_000


class RecordingFault(Enum):
    """Fault for which a recording is refused."""

    #: A topic or a column is missing, of another type, or one of several.
    TOPIC = 'topic'
    #: Joints are missing, given twice, or not those of the commands.
    JOINTS = 'joints'
    #: Positions are not finite, or there are too few states.
    STATES = 'states'
    #: No torque is known, or the commands are no torques.
    TORQUE = 'torque'
    #: Several sources publish states or commands.
    SOURCES = 'sources'
    #: Stamps run to and fro.
    CLOCK = 'clock'
    #: The torque is in another unit.
    UNIT = 'unit'
    #: The torque has the other sign.
    SIGN = 'sign'
    #: The torques have another order of joints.
    ORDER = 'order'


class RecordingError(CtcError):
    """
    A recording that is refused.

    Parameters
    ----------
    fault : RecordingFault
        Its fault.
    text : str
        The line for a user.

    """

    def __init__(self, fault: RecordingFault, text: str) -> None:
        super().__init__(text)
        self.fault = fault


@dataclasses.dataclass(frozen=True)
class Recording:
    """
    Recorded motion of a robot of n joints, N samples.

    Attributes
    ----------
    name : str
        Name of the bag, for messages.
    joints : tuple of str, length n
        Joints in the order of the columns.
    t : ndarray, shape (N,)
        Stamps of the states, in the order of their arrival [s].
    q : ndarray, shape (N, n)
        Positions [rad].
    dq : ndarray, shape (M, n), or None
        Velocities of the first M samples [rad/s]: all N, or at least `KEPT_VELOCITY_ROWS`.
    effort : ndarray, shape (N, n), or None
        Torques of the same messages [N·m].
    command : ndarray, shape (N, n), or None
        Torque commanded in answer to each state [N·m], nan where it is unknown.
    late : tuple of (float, float)
        Least and largest delay of the commands beyond their rows [samples].
    dropped : int
        Messages with states and commands that the recorder counted as lost.

    Raises
    ------
    CtcError
        If an array has another type or shape.

    """

    name: str
    joints: tuple[str, ...]
    t: Array
    q: Array
    dq: Array | None = None
    effort: Array | None = None
    command: Array | None = None
    late: tuple[float, float] = (0.0, 0.0)
    dropped: int = 0

    def __post_init__(self) -> None:
        """Check the shapes."""
        shape = (*self.t.shape, len(self.joints))
        for values in (self.q, self.dq, self.effort, self.command):
            ends_early = values is self.dq and values is not None and (
                len(values) >= KEPT_VELOCITY_ROWS and values.shape[1:] == shape[1:])
            if values is not None and values.shape != shape and not ends_early:
                raise CtcError(f'{self.name}: an array of shape {values.shape} is not allowed; '
                               f'allowed: {shape}, a row a sample, a column a joint')

    def select(self, rows: Indices) -> Recording:
        """Return some of the states."""
        dq = self.dq
        if dq is not None:
            dq = take_rows(dq, rows[rows < len(dq)])
        return dataclasses.replace(
            self,
            t=self.t[rows],
            q=take_rows(self.q, rows),
            dq=dq,
            effort=take_rows_if_any(self.effort, rows),
            command=take_rows_if_any(self.command, rows))

    def checked(self) -> Recording:
        """
        Return the states in order, each stamp once.

        Velocities and torques without a finite value of each joint are left out.

        Raises
        ------
        CtcError
            If positions are not finite, `order_states` refuses the stamps, there is no torque, or
            there are too few states.

        """
        is_bad = ~np.isfinite(self.q)
        if is_bad.any():
            row, joint = np.argwhere(is_bad)[0]
            count = int(is_bad.any(axis=1).sum())
            raise RecordingError(
                RecordingFault.STATES,
                f'{self.name}: {count} of {len(self.t)} states have a position that is not '
                f'finite, the first of {self.joints[joint]} at {self.t[row]:.3f} s')
        rows: Indices = np.unique(self.t, return_index=True)[1]
        if len(rows) >= MIN_STATES:
            contents = [self.q]
            if self.dq is not None and len(self.dq) == len(self.t):
                contents.append(self.dq)
            rows = order_states(self.name, self.t, *contents)
        if len(rows) < MIN_STATES:
            raise RecordingError(
                RecordingFault.STATES,
                f'{self.name}: {len(rows)} states are too few. At least {MIN_STATES} are needed')
        complete = dataclasses.replace(
            self,
            dq=_if_finite(self.dq),
            effort=_if_finite(self.effort),
            command=_if_finite(self.command))
        if complete.effort is None and complete.command is None:
            raise RecordingError(
                RecordingFault.TORQUE,
                f'{self.name}: there is no torque, neither as effort in the states nor as '
                'commands. Record one of them')
        return complete.select(rows)

    @property
    def period(self) -> float:
        """Median step of the stamps, without gaps [s]."""
        step = np.diff(self.t)
        median = float(np.median(step))
        is_regular = np.abs(step - median) < 0.5 * median
        return float(np.mean(step[is_regular]))


@dataclasses.dataclass(frozen=True)
class RecordedMotion:
    """
    Recording of a robot, with the robot's description.

    Attributes
    ----------
    recording : Recording
        Checked.
    description : str
        Text of the URDF, empty for none.
    controller : ControllerConfig or None
        Configuration at the first sample, in bags of this package.
    notes : sequence of str
        Remarks on what was chosen or left out.

    Raises
    ------
    ParameterError
        If an argument is of another type.

    """

    recording: Recording
    description: str = ''
    controller: ControllerConfig | None = None
    notes: Sequence[str] = ()


def find_joints(path: Path, description: str, recorded: tuple[str, ...]) -> tuple[str, ...]:
    """
    Return the movable joints of a description that were recorded.

    Raises
    ------
    CtcError
        If there is none.

    """
    movable = Tree(description).movable if description else recorded
    joints = tuple(name for name in movable if name in recorded)
    if not joints:
        described = f'the joints {shorten(movable)}' if movable else (
            'no joint that moves by itself: fixed joints, joints that mimic others, and their '
            'leaders are left out')
        raise RecordingError(
            RecordingFault.JOINTS,
            f'{path}: the description has {described}; the states have '
            f'{shorten(recorded)}')
    return joints


def take_rows(values: Array, rows: Indices) -> Array:
    """Return some rows, without a copy of contiguous ones."""
    if len(rows) and (np.diff(rows) == 1).all():
        return values[rows[0]:rows[-1] + 1]
    return values[rows]


def take_rows_if_any(values: Array | None, rows: Indices) -> Array | None:
    """Return some rows of values, or None without values."""
    return None if values is None else take_rows(values, rows)


def _if_finite(values: Array | None) -> Array | None:
    """Return values with finite ones in each column, else None."""
    if values is None or not np.isfinite(values).any(axis=0).all():
        return None
    return values
