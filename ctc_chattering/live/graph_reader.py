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
Node that follows a graph without slowing it.

`GraphPage` polls it and shows its samples, parameters and reports. All subscriptions are best
effort: publishers do not wait, and send nothing twice.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
import dataclasses
from functools import partial
from itertools import islice
from math import inf
import os
import time
from typing import Any, NamedTuple

from ctc_chattering.analysis.signals import packed, PARTS
from ctc_chattering.configuration import topics
from ctc_chattering.configuration.topics import select
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import as_ctc_error, CtcError, RejectedMessage
from ctc_chattering.live.status_light import NodeReport, TOPIC_OF_NODE
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

#: Messages of a topic that the middleware keeps between two polls. Older ones are lost.
_DEPTH = 1000
#: Nodes whose parameters are followed.
_NODES = tuple(TOPIC_OF_NODE)
#: Delay of the controller's news after which the arm moves without them [s].
_MAX_TRACKING_DELAY_S = 0.25


class Track:
    """
    Last samples of the signals in a message.

    A time before the last one clears it, as at a new start of simulated time. Of samples at the
    same time the first is kept.

    Parameters
    ----------
    max_rows : int
        Number of samples.
    **columns : int
        Number of columns of each signal, in their order.

    """

    def __init__(self, max_rows: int = 10_000, **columns: int) -> None:
        self._columns = columns
        self.rows: deque[tuple[float, Any]] = deque(maxlen=max_rows)
        self.clear()

    def clear(self) -> None:
        """Forget all samples."""
        self.rows.clear()
        self._new_rows = 0
        #: Time 0 of the samples that `packed` has returned [s].
        self._begin = inf

    def add(self, t: float, row: Array) -> None:
        """Append a sample at time `t` [s]."""
        last = self.rows[-1][0] if self.rows else -inf
        if t == last:
            return
        if t < last:
            self.clear()
        self.rows.append((t, row))
        self._new_rows += 1

    def packed(self, begin: float, fresh: bool = False) -> bytes:
        """
        Return the new samples as a message to pages, empty without any.

        Parameters
        ----------
        begin : float
            Time 0 of the page [s].
        fresh : bool
            Return all samples, for a page that has none.

        """
        fresh = fresh or begin != self._begin
        first = 0 if fresh else max(0, len(self.rows) - self._new_rows)
        self._new_rows = 0
        if first == len(self.rows):
            return b''
        self._begin = begin
        t, rows = map(np.array, zip(*islice(self.rows, first, None)))
        ends = np.cumsum(list(self._columns.values()))
        signals = np.split(rows, ends[:-1], axis=1)
        return packed(t - begin, dict(zip(self._columns, signals)), run=0, fresh=fresh)


class ArmPose(NamedTuple):
    """
    Pose of the arm at a time.

    Attributes
    ----------
    t : float
        [s].
    q, q_d : ndarray, shape (n,), or None
        Position and desired position, where they are known.

    """

    t: float = -inf
    q: Any = None
    q_d: Any = None


class GraphReader(BaseNode):
    """
    Reader of a graph.

    `poll` takes all that has come. Between two calls no Python code of this process runs for the
    graph.

    Attributes
    ----------
    parameters : dict of str to dict
        Values in force, by node and name.
    names : tuple of str
        The controller's joints. Empty before they are known.
    config : ControllerConfig or None
        The controller's configuration, once it is known.
    description : str
        The URDF in use. Empty for none.
    clock : float
        Last time on the topic ``clock`` [s].
    start : float
        Stamp of the plant's first state [s].
    tracks : dict of str to Track
        Samples by topic.

    """

    def __init__(self) -> None:
        #: Subscriptions, and the receivers of their messages.
        self._polled: list[tuple[MatchingSubscription, Any]] = []
        super().__init__(f'ctc_live_{os.getpid()}')
        self.parameters: dict[str, dict[str, Any]] = {node: {} for node in _NODES}
        self.config: ControllerConfig | None = None
        self.description = ''
        self.clock = 0.0
        self.start = 0.0
        #: Indices of the continuous joints.
        self._continuous: list[int] = []
        #: Times of the last messages, by topic [s].
        self._heard: dict[str, float] = {}
        #: Reports by node, with the times at which they came [s].
        self._reports: dict[str, tuple[float, NodeReport]] = {}
        self._begin_with(())
        samples = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._follow(topics.JOINT_STATES, self._on_state, samples)
        self._follow(f'controller/{topics.TRACKING}', self._on_tracking, samples)
        self._follow(f'controller/{topics.FILTER}', self._on_filter, samples)
        self._follow(f'controller/{topics.TORQUES}', self._on_torques, samples)
        self._follow(topics.REFERENCE, lambda _: None, newest, bytes)
        self._follow(topics.CLOCK, self._on_clock, newest, read_stamp)
        for node in _NODES:
            self._follow(f'{node}/{topics.PARAMETERS}', partial(self._on_parameters, node),
                         qos(CHANGES, latched=True))
        self._follow(f'controller/{topics.ROBOT_DESCRIPTION}', self._on_description,
                     qos(1, latched=True))
        # Every node publishes on it, so that it has no owner.
        diagnostics = MatchingSubscription(
            self, DiagnosticArray, topics.DIAGNOSTICS, lambda _: None, qos(20))
        self._polled.append((diagnostics, self._on_diagnostics))

    def clear(self) -> None:
        """Forget the samples, as at a new start of simulated time."""
        for track in self.tracks.values():
            track.clear()
        #: Last pose that the robot reported.
        self._state = ArmPose()
        #: Last pose that the controller tracked.
        self._tracked = ArmPose()
        self._first_time = 0.0

    def _follow(self, topic: str, take: Callable[[Any], None], profile: QoSProfile,
                read: Any = None) -> None:
        """Have messages of a topic received in `poll`."""
        def on_message(message: Any, now: int) -> None:
            self._heard[topic] = seconds(now)
            try:
                with as_ctc_error('of no use'):
                    take(message)
            except RejectedMessage:
                raise
            except CtcError as error:
                raise RejectedMessage('unusable', str(error)) from None
        validated = ValidatedSubscription(
            self, message_type(topics.TOPICS[topic].kind), topic, on_message, profile, read)
        self.inputs.append(validated)
        self._polled.append((validated.subscription, validated.receive))

    @property
    def subscriptions(self) -> Iterator[Any]:
        """Subscriptions that an executor serves, without those of `poll`."""
        polled = [matching.current for matching, _ in self._polled]
        return (x for x in super().subscriptions if x not in polled)

    def poll(self) -> None:
        """Take all messages that have come."""
        for matching, receive in self._polled:
            current = matching.current
            for _ in range(_DEPTH):
                message = current.handle.take_message(current.msg_type, True)
                if message is None:
                    break
                receive(*message)

    @property
    def silence(self) -> dict[str, float]:
        """Time since the last message of each topic that was heard [s]."""
        now = time.monotonic()
        return {topic: now - t for topic, t in self._heard.items()}

    @property
    def reports(self) -> dict[str, NodeReport]:
        """Last report of each node in this namespace."""
        now = time.monotonic()
        return {name: dataclasses.replace(report, age=now - t)
                for name, (t, report) in self._reports.items()}

    @property
    def simulated(self) -> bool:
        """Return whether time is simulated."""
        return self.parameters['plant'].get('pacing') == 'lockstep'

    @property
    def pose(self) -> ArmPose:
        """
        Last pose of the arm, q and q_d of the same sample.

        Without news of the controller, the position goes on alone.
        """
        if self._state.t > self._tracked.t + _MAX_TRACKING_DELAY_S:
            return self._state._replace(q_d=self._tracked.q_d)
        return self._tracked

    @property
    def latest(self) -> float:
        """Last time that was heard [s]."""
        return max(self.clock, self._state.t, self._tracked.t)

    def desired_positions(self, count: int) -> list[Array]:
        """Return up to `count` recent desired positions, each of shape (n,)."""
        rows = self.tracks[topics.TRACKING].rows
        step = len(rows) // count + 1
        return [row[:len(self.names)] for _, row in islice(rows, 0, None, step)]

    @property
    def begin(self) -> float:
        """Time 0 of the page [s]."""
        return self.start or self._first_time

    def _select(self, names: Sequence[str], state: JointState, *rows: Sequence[float]) -> Any:
        """Return values in the order of names."""
        if not self.names:
            raise RejectedMessage('early')
        return np.array(select(names, state.name, *rows), float)

    def _on_state(self, state: JointState) -> None:
        t = _stamp(state)
        if t < self._state.t:
            self.clear()
        # Drivers may leave out velocities and efforts.
        optional = (state.velocity, state.effort)
        zeros = [0.0] * len(state.name)
        rows = self._select(self.names, state, state.position, *(x or zeros for x in optional))
        for row, values in zip(rows[1:], optional):
            if not values:
                row[:] = np.nan
        target = self._state.q if self._tracked.q_d is None else self._tracked.q_d
        if target is not None:
            for joint in self._continuous:
                rows[0, joint] = nearest(rows[0, joint], target[joint])
        self._state = ArmPose(t, rows[0])
        self._first_time = self._first_time or t
        self.tracks[topics.JOINT_STATES].add(t, rows.ravel())

    def _on_tracking(self, state: JointState) -> None:
        names = [f'{joint}/{x}' for x in ('desired', 'error') for joint in self.names]
        row = self._select(names, state, state.position)[0]
        q_d, error = np.split(row, 2)
        with np.errstate(over='raise'):
            self._tracked = ArmPose(_stamp(state), q_d - error, q_d)
        self.tracks[topics.TRACKING].add(self._tracked.t, row)

    def _on_filter(self, state: JointState) -> None:
        row = self._select(self.names, state, state.velocity)[0]
        self.tracks[topics.FILTER].add(_stamp(state), row)

    def _on_torques(self, state: JointState) -> None:
        names = [f'{joint}/{term}' for term in PARTS for joint in self.names]
        row = self._select([*names, 'V'], state, state.effort)[0]
        self.tracks[topics.TORQUES].add(_stamp(state), row)

    def _on_clock(self, now: int) -> None:
        self.clock = seconds(now)

    def _on_diagnostics(self, message: bytes, _info: Mapping[str, Any]) -> None:
        own_namespace = self.get_namespace().rstrip('/')
        with suppress(Exception):  # The bytes are arbitrary.
            for status in deserialize_message(message, DiagnosticArray).status:
                namespace, _, name = status.name.rpartition('/')
                if namespace == own_namespace and name in (*_NODES, 'recorder', 'bringup'):
                    values = {x.key: x.value for x in status.values}
                    report = NodeReport(status.level[0], status.message, 0.0, values)
                    self._reports[name] = time.monotonic(), report

    def _on_parameters(self, node: str, event: ParameterEvent) -> None:
        changes = {item.name: parameter_value_to_python(item.value)
                   for item in (*event.new_parameters, *event.changed_parameters)}
        if event.new_parameters:
            self.parameters[node] = {}
            self._reports.pop('bringup', None)  # An earlier graph's end.
            if node == 'plant':
                self.start = event.stamp.sec + event.stamp.nanosec / NANOSECONDS
        values = self.parameters[node] | changes
        if node == 'controller' and 'joint_names' in values:
            self._configure(values)
        self.parameters[node] = values

    def _configure(self, values: Mapping[str, Any]) -> None:
        """Take the controller's parameters."""
        previous = self.config
        declared = ControllerConfig.parameters()
        self.config = ControllerConfig.from_mapping(
            {name: value for name, value in values.items() if name in declared})
        if self.config.joint_names != self.names:
            self._begin_with(self.config.joint_names)
        # The description is not read anew for each gain that is set.
        if previous is None or (previous.joint_names, previous.continuous_joints) != (
                self.config.joint_names, self.config.continuous_joints):
            self._update_continuous(self.config)

    def _begin_with(self, names: tuple[str, ...]) -> None:
        """Forget the samples and begin with other joints."""
        self.names = names
        n = len(names)
        self.tracks = {
            topics.JOINT_STATES: Track(q=n, dq=n, effort=n),
            topics.TRACKING: Track(q_d=n, e=n),
            topics.FILTER: Track(v=n),
            topics.TORQUES: Track(**dict.fromkeys(PARTS, n), V=1)}
        self.clear()

    def _on_description(self, message: String) -> None:
        self.description = message.data
        if self.config is not None:
            self._update_continuous(self.config)

    def _update_continuous(self, config: ControllerConfig) -> None:
        """Find the continuous joints, without a valid URDF those of the parameters."""
        try:
            limits = read_limits(self.description, config.joint_names)
            continuous = continuous_joints(config, limits)
        except CtcError:
            continuous = config.which_are_continuous()
        self._continuous = np.flatnonzero(continuous).tolist()


def _stamp(state: JointState) -> float:
    """Return the stamp of a message [s]."""
    return seconds(nanoseconds(state.header.stamp))
