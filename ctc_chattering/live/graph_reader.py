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

"""A node that follows a graph without slowing it: best effort, read at its own rate."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import islice
from math import inf
import os
import time
from typing import Any

from ctc_chattering.analysis.signals import packed, PARTS
from ctc_chattering.configuration import topics
from ctc_chattering.configuration.topics import select
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import as_ctc_error, CtcError, RejectedMessage
from ctc_chattering.live.health import NodeReport
from ctc_chattering.numerics.angles import nearest
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS, nanoseconds, seconds
from ctc_chattering.ros.messages import message_type, read_stamp
from ctc_chattering.ros.node import BaseNode
from ctc_chattering.ros.parameters import CHANGES
from ctc_chattering.ros.subscription import MatchingSubscription, qos, ValidatedSubscription
from ctc_chattering.trajectory.joint_limits import continuous_joints, read_limits
from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

#: Messages of a signal that are kept between two looks, and taken at one; older ones are lost.
_KEPT = 1000
#: Nodes whose parameters are followed.
_NODES = ('plant', 'controller', 'reference')
#: Age of what the controller tracks, against the state, from which it is old [s].
_ALONE = 0.25


class Track:
    """
    Signals that one message has: rows of numbers with their times, the last `most` of them.

    A time before the last one, as at a new start of simulated time, clears it; of rows of one time
    the first is kept.

    Parameters
    ----------
    most : int
        Number of rows.
    **signals : int
        Number of columns of each signal, in their order.

    """

    def __init__(self, most: int = 10_000, **signals: int) -> None:
        self._signals = signals
        self.rows: deque[tuple[float, Any]] = deque(maxlen=most)
        #: How many of the last rows `packed` has not returned; time 0 of the others [s].
        self._new, self._begin = 0, inf

    def clear(self) -> None:
        """Forget all rows."""
        self.rows.clear()
        self._new, self._begin = 0, inf

    def add(self, t: float, row: Array) -> None:
        """Append a row at time `t` [s]."""
        if self.rows and t <= self.rows[-1][0]:
            if t == self.rows[-1][0]:
                return
            self.clear()
        self.rows.append((t, row))
        self._new += 1

    def packed(self, begin: float, fresh: bool = False) -> bytes:
        """
        Return the rows that no message has had, as one to the pages; empty without any.

        Parameters
        ----------
        begin : float
            From where on the page counts time [s].
        fresh : bool
            Return all rows, as to a page that has none.

        """
        fresh = fresh or begin != self._begin
        count = len(self.rows)
        first = 0 if fresh else max(0, count - self._new)
        self._new = 0
        if first == count:
            return b''
        self._begin = begin
        t, rows = map(np.array, zip(*islice(self.rows, first, None)))
        ends = np.cumsum(list(self._signals.values()))
        parts = np.split(rows, ends[:-1], axis=1)
        return packed(t - begin, dict(zip(self._signals, parts)), run=0, fresh=fresh)


class GraphReader(BaseNode):
    """
    Reads what the page shows.

    `poll` takes what has come; between two calls no Python code of this process runs for the
    graph, and the middleware keeps `_KEPT` messages of each signal, best effort: publishers do
    not wait and send nothing twice.

    Attributes
    ----------
    parameters : dict of str to dict
        Values in force, by node and name.
    names : tuple of str
        The controller's joints; empty before they are known.
    config : ControllerConfig or None
        The controller's, once it is known.
    description : str
        The URDF in use; empty for none.
    clock, start : float
        Last time on the topic ``clock``, and stamp of the plant's first state [s].
    tracks : dict of str to Track
        The signals of the last seconds, by topic.

    """

    def __init__(self) -> None:
        #: Subscriptions, and who receives their messages.
        self._polled: list[tuple[MatchingSubscription, Any]] = []
        super().__init__(f'ctc_live_{os.getpid()}')
        self.parameters: dict[str, dict[str, Any]] = {node: {} for node in _NODES}
        self.config: ControllerConfig | None = None
        self.description = ''
        #: Indices of the joints that turn endlessly.
        self._endless: list[int] = []
        self.clock = self.start = 0.0
        self._heard: dict[str, float] = {}
        self._reports: dict[str, tuple[float, int, str, dict[str, str]]] = {}
        self._take_names(())
        fast = QoSProfile(depth=_KEPT, reliability=ReliabilityPolicy.BEST_EFFORT)
        once = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._follow(topics.JOINT_STATES, self._on_state, fast)
        for topic, take in ((topics.TRACKING, self._on_tracking), (topics.FILTER, self._on_filter),
                            (topics.TORQUES, self._on_torques)):
            self._follow(f'controller/{topic}', take, fast)
        self._follow(topics.REFERENCE, lambda _: None, once, bytes)
        self._follow(topics.CLOCK, self._on_clock, once, read_stamp)
        for node in _NODES:
            self._follow(f'{node}/{topics.PARAMETERS}', partial(self._on_parameters, node),
                         qos(CHANGES, latched=True))
        self._follow(f'controller/{topics.ROBOT_DESCRIPTION}', self._on_description,
                     qos(1, latched=True))
        # Every node publishes on it: no publisher owns it.
        self._polled.append((MatchingSubscription(
            self, DiagnosticArray, topics.DIAGNOSTICS, lambda _: None, qos(20)),
            self._on_diagnostics))

    def clear(self) -> None:
        """Forget the signals, as at a new start of simulated time."""
        for track in self.tracks.values():
            track.clear()
        #: The robot's last sample: time [s] and position.
        self._state: tuple[float, Any] = (-inf, None)
        self._first = 0.0
        #: The controller's last sample: time [s], position and desired position.
        self._tracked: tuple[float, Any, Any] = (-inf, None, None)

    def _follow(self, topic: str, take: Any, profile: QoSProfile, read: Any = None) -> None:
        def heard(message: Any, now: int) -> None:
            self._heard[topic] = seconds(now)
            try:
                with as_ctc_error('of no use'):
                    take(message)
            except RejectedMessage:
                raise
            except CtcError as error:
                raise RejectedMessage('unusable', str(error)) from None
        made = ValidatedSubscription(
            self, message_type(topics.TOPICS[topic].kind), topic, heard, profile, read)
        self.inputs.append(made)
        self._polled.append((made.subscription, made.receive))

    @property
    def subscriptions(self) -> Iterator[Any]:
        """Yield those that an executor serves; `poll` serves the others."""
        polled = [matching.current for matching, _ in self._polled]
        return (x for x in super().subscriptions if x not in polled)

    def poll(self) -> None:
        """Take what has come."""
        for matching, receive in self._polled:
            current = matching.current
            for _ in range(_KEPT):
                taken = current.handle.take_message(current.msg_type, True)
                if taken is None:
                    break
                receive(*taken)

    def silence(self) -> dict[str, float]:
        """Return the time since the last message of each topic that was heard [s]."""
        now = time.monotonic()
        return {topic: now - at for topic, at in self._heard.items()}

    def reports(self) -> dict[str, NodeReport]:
        """Return what the nodes of this namespace have said of themselves."""
        now = time.monotonic()
        return {name: NodeReport(level, message, now - at, values)
                for name, (at, level, message, values) in self._reports.items()}

    @property
    def simulated(self) -> bool:
        """Whether time is simulated."""
        return self.parameters['plant'].get('pacing') == 'lockstep'

    def pose(self) -> tuple[Any, Any]:
        """
        Return position and desired position of one sample, each of shape (n,) or None.

        Without news of the controller the position goes on alone.
        """
        (t, q), (tracked, *pose) = self._state, self._tracked
        return (q, pose[1]) if t > tracked + _ALONE else (pose[0], pose[1])

    @property
    def latest(self) -> float:
        """Return the last time that was heard [s]."""
        return max(self.clock, self._state[0], self._tracked[0])

    def desired(self, count: int) -> list[Array]:
        """Return at most so many desired positions of the last seconds, each of shape (n,)."""
        rows = self.tracks[topics.TRACKING].rows
        return [row[:len(self.names)] for _, row in islice(rows, 0, None, len(rows) // count + 1)]

    @property
    def begin(self) -> float:
        """Return the time from which the page counts [s]."""
        return self.start or self._first

    def _select(self, names: Sequence[str], state: JointState, *rows: Sequence[float]) -> Any:
        if not self.names:
            raise RejectedMessage('early')
        return np.array(select(names, state.name, *rows), float)

    def _on_state(self, state: JointState) -> None:
        t = _time(state)
        if t < self._state[0]:
            self.clear()  # Time has begun anew.
        # Drivers may leave out velocities and efforts.
        count = len(state.name)
        unknown = [0.0] * count
        rows = self._select(self.names, state, state.position, *(
            x if len(x) else unknown for x in (state.velocity, state.effort)))
        for row, known in zip(rows[1:], (state.velocity, state.effort)):
            if not len(known):
                row[:] = np.nan
        desired = self._tracked[2]
        self._turn_towards(self._state[1] if desired is None else desired, rows[0])
        self._state, self._first = (t, rows[0]), self._first or t
        self.tracks[topics.JOINT_STATES].add(t, rows.ravel())

    def _turn_towards(self, target: Array | None, q: Array) -> None:
        """Have endless joints of `q`, shape (n,) [rad], within half a turn of a position."""
        if target is not None:
            for joint in self._endless:
                q[joint] = nearest(q[joint], target[joint])

    def _on_tracking(self, state: JointState) -> None:
        names = [f'{joint}/{x}' for x in ('desired', 'error') for joint in self.names]
        (row,) = self._select(names, state, state.position)
        t, n = _time(state), len(self.names)
        with np.errstate(over='raise'):
            q = row[:n] - row[n:]
        self._tracked = t, q, row[:n]
        self.tracks[topics.TRACKING].add(t, row)

    def _on_filter(self, state: JointState) -> None:
        self.tracks[topics.FILTER].add(
            _time(state), self._select(self.names, state, state.velocity)[0])

    def _on_torques(self, state: JointState) -> None:
        names = [*(f'{joint}/{part}' for part in PARTS for joint in self.names), 'V']
        self.tracks[topics.TORQUES].add(
            _time(state), self._select(names, state, state.effort)[0])

    def _on_clock(self, now: int) -> None:
        self.clock = seconds(now)

    def _on_diagnostics(self, data: bytes, _info: Mapping[str, Any]) -> None:
        space = self.get_namespace().rstrip('/')
        with suppress(Exception):  # Of arbitrary bytes.
            for status in deserialize_message(data, DiagnosticArray).status:
                above, _, name = status.name.rpartition('/')
                if above == space and name in (*_NODES, 'recorder', 'bringup'):
                    self._reports[name] = (time.monotonic(), status.level[0], status.message,
                                           {x.key: x.value for x in status.values})

    def _on_parameters(self, node: str, event: ParameterEvent) -> None:
        values = {item.name: parameter_value_to_python(item.value)
                  for item in (*event.new_parameters, *event.changed_parameters)}
        if event.new_parameters:
            self.parameters[node] = {}
            self._reports.pop('bringup', None)  # How an earlier graph has ended.
            if node == 'plant':
                self.start = event.stamp.sec + event.stamp.nanosec / NANOSECONDS
        self.take_parameters(node, values)

    def take_parameters(self, node: str, values: Mapping[str, Any]) -> None:
        """Note values that are in force; the first ones of the controller name the joints."""
        values = {**self.parameters[node], **values}
        if node == 'controller' and 'joint_names' in values:
            before, known = self.config, ControllerConfig.parameters()
            self.config = ControllerConfig.from_mapping(
                {name: value for name, value in values.items() if name in known})
            if self.config.joint_names != self.names:
                self._take_names(self.config.joint_names)
            # Only then is the description read anew, and not for each gain that is set.
            if before is None or (before.joint_names, before.continuous_joints) != (
                    self.config.joint_names, self.config.continuous_joints):
                self._find_endless(self.config)
        self.parameters[node] = values

    def _take_names(self, names: tuple[str, ...]) -> None:
        """Begin again with other joints."""
        self.names, n = names, len(names)
        self.tracks = {
            topics.JOINT_STATES: Track(q=n, dq=n, effort=n), topics.TRACKING: Track(q_d=n, e=n),
            topics.FILTER: Track(v=n), topics.TORQUES: Track(**dict.fromkeys(PARTS, n), V=1)}
        self.clear()

    def _on_description(self, message: String) -> None:
        self.description = message.data
        if self.config is not None:
            self._find_endless(self.config)

    def _find_endless(self, config: ControllerConfig) -> None:
        """Know which joints turn endlessly; of a text that is no URDF, those of the parameters."""
        try:
            limits = read_limits(self.description, config.joint_names)
            endless = continuous_joints(config, limits)
        except CtcError:
            endless = config.which_are_continuous()
        self._endless = np.flatnonzero(endless).tolist()


def _time(state: JointState) -> float:
    """Return the stamp of a message [s]."""
    return seconds(nanoseconds(state.header.stamp))
