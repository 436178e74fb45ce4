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

"""Subscriptions: they match what publishers offer, and decide who is obeyed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
import copy
import inspect
import time
from typing import Any, Generic, TypeVar

from ctc_chattering.errors import RejectedMessage
from ctc_chattering.numerics.time_grid import NANOSECONDS
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

#: Time between two looks at who publishes [s].
_PERIOD = 0.5


def qos(depth: int = 1000, latched: bool = False) -> QoSProfile:
    """Return a reliable profile; `latched` keeps messages for those who subscribe later."""
    return QoSProfile(depth=depth, durability=(
        DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE))


def compatible(offered: QoSProfile, requested: QoSProfile) -> bool:
    """
    Return whether a publisher and a subscription with these profiles find each other.

    `qos_check_compatible` of rclpy takes a deadline that is not set for shorter than one that a
    peer reports as infinite; deadlines are nothing that we offer or ask for.
    """
    return not ((offered.reliability == ReliabilityPolicy.BEST_EFFORT
                and requested.reliability == ReliabilityPolicy.RELIABLE)
                or (offered.durability == DurabilityPolicy.VOLATILE
                and requested.durability == DurabilityPolicy.TRANSIENT_LOCAL))


class MatchingSubscription:
    """
    A subscription that hears best-effort publishers, too.

    It asks for what `profile` says. Only where no publisher of the topic offers that does
    it subscribe again and asks for what all of them offer: a request for reliable messages does
    not match ``rclcpp::ClockQoS``, ``SensorDataQoS`` or the clock of ``ros2 bag play``. While a
    publisher matches, nothing changes, whoever else comes.

    Parameters
    ----------
    node : Node
        Who receives.
    kind : type
        Message class.
    topic : str
        Name of the topic.
    callback : callable
        As `Node.create_subscription` takes it.
    profile : QoSProfile
        What is asked for at first.
    raw : bool
        Whether the callback takes serialized messages.

    Attributes
    ----------
    current : Subscription
        The subscription of rclpy.
    destroyed : bool
        Whether it was destroyed; a callback may still be called afterwards.

    """

    def __init__(self, node: Node, kind: Any, topic: str, callback: Callable[..., None],
                 profile: QoSProfile, raw: bool = True) -> None:
        self._node = node
        self._arguments = kind, topic, callback
        self._raw = raw
        self._profile = profile
        self.destroyed = False
        self.current = self._subscribe()
        self._timer = node.create_timer(
            _PERIOD, self.match, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def match(self) -> None:
        """Ask for less if publishers are there and none of them offers what is asked for."""
        if self.destroyed or self.current.get_publisher_count():
            return
        name = self.current.topic_name
        offers = [info.qos_profile for info in self._node.get_publishers_info_by_topic(name)]
        if offers and not any(compatible(offer, self._profile) for offer in offers):
            self._node.destroy_subscription(self.current)
            self._profile = copy.copy(self._profile)
            self._profile.reliability = ReliabilityPolicy.BEST_AVAILABLE
            self._profile.durability = DurabilityPolicy.BEST_AVAILABLE
            self.current = self._subscribe()

    def destroy(self) -> None:
        """Hear nothing any more."""
        self.destroyed = True
        self._node.destroy_timer(self._timer)
        self._node.destroy_subscription(self.current)

    def _subscribe(self) -> Any:
        kind, topic, callback = self._arguments
        # Destroying a subscription that has callbacks for events can crash: rclpy#1644.
        return self._node.create_subscription(
            kind, topic, callback, self._profile, raw=self._raw,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False))


#: How long a message may be queued here at the most [ns]; a larger difference comes from a system
#: clock that was set.
_QUEUED = NANOSECONDS


class TopicOwnership:
    """
    Decides which messages of a topic are obeyed.

    They are obeyed while one publisher is matched; while there are several, none is obeyed. Who
    sent a message is not known: rclpy of Jazzy does not tell.

    Attributes
    ----------
    publishers : int
        Number of publishers matched.

    """

    def __init__(self) -> None:
        self.publishers = 0
        self._contested_until = -1

    @property
    def contested(self) -> bool:
        """Whether there are several publishers."""
        return self.publishers > 1

    def update(self, publishers: int, now: int) -> None:
        """Take the number of publishers matched at `now`, of the system's clock [ns]."""
        if self.contested:
            self._contested_until = now
        self.publishers = publishers

    def admits(self, received: int) -> bool:
        """
        Return whether a message is obeyed.

        Parameters
        ----------
        received : int
            When it was received, by the system's clock [ns]; 0 if that is unknown. A message that
            was received before the contention ended, and is taken afterwards, may be of a
            publisher that has left.

        """
        return not (self.contested or 0 <= self._contested_until - received < _QUEUED)


T = TypeVar('T')

#: By which rclpy sees that a callback wants the information.
_SIGNATURE = inspect.signature(lambda _message, _info: None)


def with_info(callback: Callable[[bytes, Mapping[str, Any]], None]) -> Callable[..., None]:
    """
    Return a callback for a raw subscription that takes the message's information, too.

    The executors of rclpy 7 disagree: SingleThreadedExecutor calls it with message and
    information, EventsExecutor with one tuple of both. What is returned takes either.
    """
    def both(*arguments: Any) -> None:
        callback(*(arguments if len(arguments) > 1 else arguments[0]))

    setattr(both, '__signature__', _SIGNATURE)  # noqa: B010
    return both


class ValidatedSubscription(Generic[T]):
    """
    Receives a topic that only one publisher may command.

    Parameters
    ----------
    node : Node
        Who receives.
    kind : type
        Message class.
    topic : str
        Relative name.
    take : callable
        Uses it: called with what was read and with the time of arrival on the monotonic clock
        [ns]. It raises `RejectedMessage` before it has changed anything.
    profile : QoSProfile
        As the subscription has it.
    read : callable, optional
        Makes something useful of a serialized message, by default a message of `kind`; any
        exception says that it is none.
    newest : bool, optional
        Whether the newest message that waits is used and older ones are skipped, where time is
        real; it may change. None if every message is always used.

    Attributes
    ----------
    newest : bool or None
        As given, or set since.
    skipped : int
        Messages skipped so far, also for the one that `take` is called with.
    rejected : Counter
        Rejected messages by kind.
    ownership : TopicOwnership
        Who is obeyed.

    """

    def __init__(self, node: Node, kind: Any, topic: str, take: Callable[[T, int], None],
                 profile: QoSProfile, read: Callable[[bytes], T] | None = None,
                 newest: bool | None = None) -> None:
        self._node = node
        self.topic = topic
        self._read = read or (lambda data: deserialize_message(data, kind))
        self._take, self.newest = take, newest
        self._depth = profile.depth
        self.skipped = 0
        self.rejected: Counter[str] = Counter()
        self.ownership = TopicOwnership()
        self._contention = ''
        self.subscription = MatchingSubscription(
            node, kind, topic, with_info(self.receive), profile)

    def receive(self, data: bytes, info: Mapping[str, Any]) -> None:
        """Use a serialized message, or a newer one that waits; count what is rejected."""
        if self.subscription.destroyed:
            return  # The executor had taken the message before.
        messages = [(data, info), *self._waiting()]
        now = time.monotonic_ns()
        publishers = self.subscription.current.get_publisher_count()
        if publishers != self.ownership.publishers:
            self.ownership.update(publishers, time.time_ns())
        valid = []
        for data, info in messages:
            try:
                valid.append(self._admitted(data, info))
            except RejectedMessage as rejected:
                self.reject(rejected)
        before = self.skipped
        while valid:
            message = valid.pop()
            self.skipped = before + len(valid)
            try:
                self._take(message, now)
            except RejectedMessage as rejected:
                self.reject(rejected)
            else:
                break

    def _waiting(self) -> Iterator[tuple[bytes, Mapping[str, Any]]]:
        """Yield the messages that wait, where only the newest is used; no more than fit."""
        if not self.newest:
            return
        current = self.subscription.current
        for _ in range(self._depth):
            taken = current.handle.take_message(current.msg_type, True)
            if taken is None:
                return
            yield taken

    def _admitted(self, data: bytes, info: Mapping[str, Any]) -> T:
        """Return what a message says; raise `RejectedMessage`."""
        try:
            message = self._read(data)
        except Exception as error:
            raise RejectedMessage('undecodable', f'{len(data)} bytes that are no message: '
                                  f'{" ".join(str(error).split())}') from None
        if not self.ownership.admits(info.get('received_timestamp') or 0):
            raise RejectedMessage('second_publisher')
        return message

    def reject(self, rejected: RejectedMessage) -> None:
        """Count a message that is not used, and say why, if there is a reason, once a second."""
        self.rejected[rejected.kind] += 1
        if str(rejected):
            self._node.get_logger().warning(
                f'{self.topic}: refused: {rejected} ({sum(self.rejected.values())} so far)',
                throttle_duration_sec=1.0)

    def publishers(self) -> list[str]:
        """Return the full names of the nodes that publish on the topic."""
        return sorted(f'{x.node_namespace.rstrip("/")}/{x.node_name}'
                      for x in self._node.get_publishers_info_by_topic(
                          self.subscription.current.topic_name))

    def contention(self, names: list[str]) -> str:
        """
        Return what to report of several contenders among `names`, and log a change.

        The middleware may know of a publisher before it knows the name of its node.
        """
        self.ownership.update(
            self.subscription.current.get_publisher_count(), time.time_ns())
        message = ''
        if self.ownership.contested:
            message = (f'{self.topic} has several publishers, none is obeyed: '
                       f'{", ".join(names)}')
        if message != self._contention:
            self._contention = message
            if message:
                self._node.get_logger().error(message)
            else:
                self._node.get_logger().info(
                    f'{self.topic}: obeyed again: {", ".join(names) or "no publisher"}')
        return message
