"""
The motion of a robot from a bag of any recorder: joint states and commanded torques.

`bags/reader.py` reads the runs of this package, with reference and law; here joint states are
enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
import dataclasses
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.recording import Recording
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.bags.topics import BagTopics, nanoseconds
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, near, refused_as
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import seconds
from ctc_chattering.ros.topics import COMMANDS, JOINT_STATES, ROBOT_DESCRIPTION
import numpy as np

#: Commands for each state from which on there must be two publishers.
_TOO_MANY = 1.5
#: Periods after which a command is no longer held.
_HELD = 20


@dataclasses.dataclass(frozen=True)
class RecordedMotion:
    """
    What a bag has of a robot.

    Attributes
    ----------
    recording : Recording
        Checked.
    description : str
        Text of the URDF; empty for none.
    controller : ControllerConfig or None
        Of the first sample, in bags of this package.

    """

    recording: Recording
    description: str
    controller: ControllerConfig | None


def read_motion(path: Path, joints: Sequence[str] = (), description: str = '',
                states: str = JOINT_STATES, commands: str = COMMANDS) -> RecordedMotion:
    """
    Return the motion that a bag holds.

    Parameters
    ----------
    path : Path
        Directory of the bag.
    joints : sequence of str
        Joints in the order of the model, and of the commands if these have no names; empty for
        those of the controller of this package, of the names in the commands, or all movable
        joints of the description that are in the states.
    description : str
        Text of the URDF; empty for that in the bag.
    states, commands : str
        Topics of the joint states and of the commanded torques; without a slash in front, in any
        namespace.

    Raises
    ------
    CtcError
        If there is no bag, it cannot be read, or `Recording.checked` refuses it.

    """
    with closing(open_bag(path)) as reader, refused_as(f'{path}: damaged'):
        return _MotionTopics(reader, path).motion(joints, description, (states, commands))


class _MotionTopics(BagTopics):
    """The topics of a bag with the motion of any robot."""

    def motion(self, joints: Sequence[str], description: str, topics: tuple[str, str]
               ) -> RecordedMotion:
        """Return the motion; arguments as `read_motion` has them."""
        history = self.parameters('controller', ControllerConfig)
        controller = history[0][1] if history else None
        description = (description or self.description()
                       or self.description(ROBOT_DESCRIPTION))
        states = list(self.messages(topics[0], '--states'))
        if not states:
            raise CtcError(f'{self.path}: no message on {topics[0]}')
        orders = list(self.messages(topics[1], '--commands'))
        names = tuple(joints) or self._joints(controller, states[0][1], orders, description)
        logged, recording = self._recording(names, states)
        command = self._command(names, logged, orders, topics[1])
        return RecordedMotion(dataclasses.replace(recording, command=command).checked(),
                              description, controller)

    def _joints(self, controller: ControllerConfig | None, state: Any,
                orders: Sequence[tuple[int, Any]], description: str) -> tuple[str, ...]:
        """Return the joints where none are asked for."""
        if controller is not None:
            return tuple(controller.joint_names)
        labels = [dim.label for dim in orders[0][1].layout.dim] if orders else []
        if labels and set(labels) <= set(state.name):
            return tuple(labels)
        if description:
            found = tuple(name for name in Tree(description).movable if name in state.name)
        else:
            found = tuple(state.name)
        if orders and len(orders[0][1].data) != len(found):
            raise CtcError(
                f'{self.path}: {len(orders[0][1].data)} commanded torques for '
                f'{len(found)} joints, {", ".join(found)}; name them in the order of the '
                'commands: --joints')
        return found

    def _recording(self, names: tuple[str, ...], states: Sequence[tuple[int, Any]]
                   ) -> tuple[Array, Recording]:
        """Return log times [ns], and the recording without commands."""
        rows: dict[str, list[Array]] = {'position': [], 'velocity': [], 'effort': []}
        stamps, logged = [], []
        for t, message in states:
            place = {name: k for k, name in enumerate(message.name)}
            if not set(names) <= set(place):
                if set(names) & set(place):
                    raise CtcError(
                        f'{self.path}: states have the joints {list(message.name)}; needed: '
                        f'each of {list(names)}')
                continue
            order = [place[name] for name in names]
            for key, column in rows.items():
                values = getattr(message, key)
                column.append(np.asarray(values, float)[order] if len(values) == len(place)
                              else np.full(len(names), np.nan))
            stamps.append(nanoseconds(message.header.stamp))
            logged.append(t)
        if not stamps:
            known = sorted({name for _, message in states for name in message.name})
            raise CtcError(f'{self.path}: no state has the joints {list(names)}; joints of the '
                           f'bag: {", ".join(known)}{"".join(near(x, known) for x in names)}')
        times = np.array([seconds(x - stamps[0]) for x in stamps])
        if len(times) > 1 and not np.any(np.diff(times)):
            times = np.array([seconds(x - logged[0]) for x in logged])
        q, dq, effort = (np.array(rows[key]) for key in ('position', 'velocity', 'effort'))
        return np.array(logged), Recording(
            self.path.resolve().name, names, times, q, _if_any(dq), _if_any(effort))

    def _command(self, names: tuple[str, ...], logged: Array,
                 orders: Sequence[tuple[int, Any]], topic: str) -> Array | None:
        """Return the torque commanded in answer to each state, shape (N, n), nan for unknown."""
        values, times = [], []
        for t, message in orders:
            labels = [dim.label for dim in message.layout.dim] or list(names)
            data = np.asarray(message.data, float)
            if len(labels) == len(data) and set(names) <= set(labels) and np.isfinite(data).all():
                values.append(data[[labels.index(name) for name in names]])
                times.append(t)
        if not values:
            return None
        if len(values) > _TOO_MANY * len(logged):
            raise CtcError(f'{self.path}: {len(values)} commands on {topic} for {len(logged)} '
                           'states: are there two publishers of commands?')
        if len(values) == len(logged):
            return np.array(values)
        # In force at the end of the period that a state begins, if it is not too old.
        period = float(np.median(np.diff(logged)))
        until = np.append(logged[1:], logged[-1] + period)
        last = np.searchsorted(times, until) - 1
        found = np.array(values)[np.maximum(last, 0)]
        age = logged - np.array(times, float)[np.maximum(last, 0)]
        found[(last < 0) | (age > _HELD * period)] = np.nan
        return found


def _if_any(values: Array) -> Array | None:
    """Return values, or None if they are nowhere finite, or 0 throughout."""
    known = np.isfinite(values)
    return values if known.any() and np.any(values[known]) else None
