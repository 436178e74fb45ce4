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

"""A subscription that decides who is obeyed, takes the newest, and reports what it rejects."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
import inspect
import time
from typing import Any, Generic, TypeVar

from ctc_chattering.controller.topic_ownership import TopicOwnership
from ctc_chattering.errors import RejectedMessage
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.matching import MatchingSubscription
from rclpy.node import Node
from rclpy.qos import QoSProfile

T = TypeVar('T')

#: By which rclpy sees that a callback wants the information.
_SIGNATURE = inspect.signature(lambda _message, _info: None)
#: Time between two reports of rejected messages [ns].
_REPORT = NANOSECONDS


def with_info(callback: Callable[[bytes, Mapping[str, Any]], None]) -> Callable[..., None]:
    """
    Return a callback for a raw subscription that takes the message's information, too.

    The executors of rclpy 7 disagree: SingleThreadedExecutor calls it with message and
    information, EventsExecutor with one tuple of both. What is returned takes either.
    """
    def both(*arguments: Any) -> None:
        if len(arguments) == 1:
            callback(*arguments[0])
        else:
            callback(*arguments)

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
    read : callable
        Makes something useful of a serialized message; any exception says that it is none.
    take : callable
        Uses it: called with what was read and with the time of arrival on the monotonic clock
        [ns]. It raises `RejectedMessage` before it has changed anything.
    profile : QoSProfile
        As the subscription has it.
    joints : callable, optional
        For a topic that publishers share, a part of the robot each: returns our joints. Messages
        whose `names` have none of them are passed over.
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

    def __init__(self, node: Node, kind: Any, topic: str, read: Callable[[bytes], T],
                 take: Callable[[T, int], None], profile: QoSProfile,
                 joints: Callable[[], Iterable[str]] | None = None,
                 newest: bool | None = None) -> None:
        self._node = node
        self.topic = topic
        self._read, self._take, self.newest = read, take, newest
        self._joints = joints
        self._depth = profile.depth
        self.skipped = 0
        self.rejected: Counter[str] = Counter()
        self._reported = 0
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
                message = self._admitted(data, info)
            except RejectedMessage as rejected:
                self.reject(rejected, now)
            else:
                if message is not None:
                    valid.append(message)
        before = self.skipped
        while valid:
            message = valid.pop()
            self.skipped = before + len(valid)
            try:
                self._take(message, now)
            except RejectedMessage as rejected:
                self.reject(rejected, now)
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

    def _admitted(self, data: bytes, info: Mapping[str, Any]) -> T | None:
        """Return what a message says; None if it is not ours; raise `RejectedMessage`."""
        try:
            message = self._read(data)
        except Exception as error:
            raise RejectedMessage('undecodable', f'{len(data)} bytes that are no message: '
                                  f'{" ".join(str(error).split())}') from None
        if self._joints is not None:
            names = message.names  # type: ignore[attr-defined]
            ours = not set(names).isdisjoint(self._joints())
            self.ownership.note_part(names, ours, time.time_ns())
            if not ours:
                return None
        if not self.ownership.admits(info.get('received_timestamp') or 0):
            raise RejectedMessage('second_publisher')
        return message

    def reject(self, rejected: RejectedMessage, now: int) -> None:
        """Count a message that is not used, and say why, if there is a reason, once a second."""
        self.rejected[rejected.kind] += 1
        if str(rejected) and now - self._reported > _REPORT:
            self._reported = now
            self._node.get_logger().warning(
                f'{self.topic}: refused: {rejected} ({sum(self.rejected.values())} so far)')

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
