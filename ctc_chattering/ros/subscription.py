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
Subscriptions that match publishers, and obey only one.

The nodes subscribe to the topics of the control loop by `ValidatedSubscription`. It reads each
serialized message, asks `ros/topic_ownership.py` whether it is obeyed, and hands it to the node.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
import copy
from functools import partial
import inspect
import time
from typing import Any, Generic, TypeVar

from ctc_chattering.errors import RejectedMessage
from ctc_chattering.ros.topic_ownership import TopicOwnership
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

#: Time between two looks at the publishers' offers [s].
_MATCH_PERIOD_S = 0.5


def qos(depth: int = 1000, latched: bool = False) -> QoSProfile:
    """Return a reliable profile, `latched` for late subscribers."""
    return QoSProfile(depth=depth, durability=(
        DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE))


def compatible(offered: QoSProfile, requested: QoSProfile) -> bool:
    """
    Return whether these profiles match.

    `qos_check_compatible` of rclpy takes a deadline that is not set for shorter than one that a
    peer reports as infinite. We neither offer nor request deadlines.
    """
    return not ((offered.reliability == ReliabilityPolicy.BEST_EFFORT
                and requested.reliability == ReliabilityPolicy.RELIABLE)
                or (offered.durability == DurabilityPolicy.VOLATILE
                and requested.durability == DurabilityPolicy.TRANSIENT_LOCAL))


class MatchingSubscription:
    """
    A subscription that also hears best-effort publishers.

    It requests what `profile` says. Where no publisher of the topic offers that, it subscribes
    again and requests what all of them offer. A request for reliable messages does not match
    ``rclcpp::ClockQoS``, ``SensorDataQoS`` or the clock of ``ros2 bag play``. While a publisher
    matches, nothing changes, whoever else comes.

    Parameters
    ----------
    node : Node
        Node that receives.
    message_class : type
        Message class.
    topic : str
        Name of the topic.
    callback : callable
        As `Node.create_subscription` takes it.
    profile : QoSProfile
        First request.
    raw : bool
        Whether the callback takes serialized messages.

    Attributes
    ----------
    current : Subscription
        The subscription of rclpy.
    handle : object
        Its handle, whose methods take less time.
    destroyed : bool
        Whether it was destroyed. A callback may still be called afterwards.

    """

    def __init__(self, node: Node, message_class: Any, topic: str,
                 callback: Callable[..., None], profile: QoSProfile, raw: bool = True) -> None:
        self._node = node
        self._arguments = message_class, topic, callback
        self._raw = raw
        self._profile = profile
        self.destroyed = False
        self._subscribe()
        self._timer = node.create_timer(
            _MATCH_PERIOD_S, self.match, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def match(self) -> None:
        """Request less if no publisher offers what is requested."""
        if self.destroyed or self.current.get_publisher_count():
            return
        name = self.current.topic_name
        offers = [info.qos_profile for info in self._node.get_publishers_info_by_topic(name)]
        if offers and not any(compatible(offer, self._profile) for offer in offers):
            self._node.destroy_subscription(self.current)
            self._profile = copy.copy(self._profile)
            self._profile.reliability = ReliabilityPolicy.BEST_AVAILABLE
            self._profile.durability = DurabilityPolicy.BEST_AVAILABLE
            self._subscribe()

    def destroy(self) -> None:
        """Receive nothing any more."""
        self.destroyed = True
        self._node.destroy_timer(self._timer)
        self._node.destroy_subscription(self.current)

    def _subscribe(self) -> None:
        message_class, topic, callback = self._arguments
        # Destroying a subscription that has callbacks for events can crash: rclpy#1644.
        self.current = self._node.create_subscription(
            message_class, topic, callback, self._profile, raw=self._raw,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False))
        self.handle: Any = self.current.handle


T = TypeVar('T')

#: Signature by which rclpy decides to pass the information.
_MESSAGE_AND_INFORMATION = inspect.signature(lambda _message, _info: None)


def with_info(callback: Callable[..., None]) -> Callable[..., None]:
    """
    Return a callback that also takes the message's information.

    The executors of rclpy 7 disagree. SingleThreadedExecutor calls it with message and
    information, EventsExecutor with one tuple of both. So `callback` must accept either.
    """
    informed = partial(callback)
    setattr(informed, '__signature__', _MESSAGE_AND_INFORMATION)  # noqa: B010
    return informed


class ValidatedSubscription(Generic[T]):
    """
    Receives a topic that only one publisher may command.

    Parameters
    ----------
    node : Node
        Node that receives.
    message_class : type
        Message class.
    topic : str
        Relative name.
    take : callable
        Called with the content of a message and its time of arrival on the monotonic clock [ns].
        It raises `RejectedMessage` before it has changed anything.
    profile : QoSProfile
        As the subscription has it.
    read : callable, optional
        Returns the content of a serialized message, by default a message. Any exception
        says that it is malformed.
    newest : bool, optional
        Whether the newest message that waits is used and older ones are skipped, where time is
        real. It may change. None if every message is always used.

    Attributes
    ----------
    newest : bool or None
        As given, or set since.
    skipped : int
        Messages skipped so far, also for the one that `take` is called with.
    rejected : Counter
        Rejected messages by kind.
    ownership : TopicOwnership
        Whether messages are obeyed.

    """

    def __init__(self, node: Node, message_class: Any, topic: str,
                 take: Callable[[T, int], None], profile: QoSProfile,
                 read: Callable[[bytes], T] | None = None, newest: bool | None = None) -> None:
        self._node = node
        self.topic = topic
        self._read = read or (lambda data: deserialize_message(data, message_class))
        self._take, self.newest = take, newest
        self._depth = profile.depth
        self.skipped = 0
        self.rejected: Counter[str] = Counter()
        self.ownership = TopicOwnership()
        self._contention = ''
        self.subscription = MatchingSubscription(
            node, message_class, topic, with_info(self.receive), profile)

    def receive(self, data: Any, info: Mapping[str, Any] | None = None) -> None:
        """
        Use a serialized message, or a newer one that waits.

        Parameters
        ----------
        data : bytes or tuple
            Message, or tuple of message and information.
        info : mapping, optional
            Information, if it is not in `data`.

        """
        if info is None:
            data, info = data
        if self.subscription.destroyed:
            return  # The executor had taken the message before.
        newer = self._take_waiting() if self.newest else None
        now = time.monotonic_ns()
        publishers = self.subscription.handle.get_publisher_count()
        if publishers != self.ownership.publishers:
            self.ownership.update(publishers, time.time_ns())
        if newer:
            self._use_newest([(data, info), *newer], now)
            return
        try:
            self._take(self._admit(data, info), now)
        except RejectedMessage as rejected:
            self.reject(rejected)

    def _take_waiting(self) -> list[tuple[bytes, Mapping[str, Any]]]:
        """Return the waiting messages, at most `depth`."""
        handle, message_class = self.subscription.handle, self.subscription.current.msg_type
        waiting: list[tuple[bytes, Mapping[str, Any]]] = []
        while len(waiting) < self._depth and (
                taken := handle.take_message(message_class, True)) is not None:
            waiting.append(taken)
        return waiting

    def _use_newest(self, messages: list[tuple[bytes, Mapping[str, Any]]], now: int) -> None:
        """Use the newest message that is not rejected."""
        valid = []
        for data, info in messages:
            try:
                valid.append(self._admit(data, info))
            except RejectedMessage as rejected:
                self.reject(rejected)
        skipped = self.skipped
        while valid:
            message = valid.pop()
            self.skipped = skipped + len(valid)
            try:
                self._take(message, now)
            except RejectedMessage as rejected:
                self.reject(rejected)
            else:
                break

    def _admit(self, data: bytes, info: Mapping[str, Any]) -> T:
        """Return the content of a message, or raise `RejectedMessage`."""
        try:
            message = self._read(data)
        except Exception as error:
            raise RejectedMessage('undecodable', f'{len(data)} bytes are not a message: '
                                  f'{" ".join(str(error).split())}') from None
        if not self.ownership.admits(info.get('received_timestamp') or 0):
            raise RejectedMessage('second_publisher')
        return message

    def reject(self, rejected: RejectedMessage) -> None:
        """Count a rejected message, and log the reason."""
        self.rejected[rejected.kind] += 1
        if str(rejected):
            self._node.get_logger().warning(
                f'{self.topic}: refused: {rejected} ({sum(self.rejected.values())} so far)',
                throttle_duration_sec=1.0)

    def publishers(self) -> list[str]:
        """Return the full names of the topic's publishers."""
        return sorted(f'{x.node_namespace.rstrip("/")}/{x.node_name}'
                      for x in self._node.get_publishers_info_by_topic(
                          self.subscription.current.topic_name))

    def report_contention(self, names: list[str]) -> str:
        """
        Return a report on several publishers, and log a change.

        It is '' if there is at most one.
        The middleware may know a publisher before it knows the name of its node.
        """
        self.ownership.update(
            self.subscription.current.get_publisher_count(), time.time_ns())
        message = ''
        if self.ownership.contested:
            message = (f'{self.topic} has several publishers; messages from all of them are '
                       f'ignored: {", ".join(names)}')
        if message != self._contention:
            self._contention = message
            if message:
                self._node.get_logger().error(message)
            else:
                self._node.get_logger().info(
                    f'{self.topic}: messages are used again, from '
                    f'{", ".join(names) or "the next publisher"}')
        return message
