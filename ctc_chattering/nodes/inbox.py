"""A subscription that tells publishers apart, and counts and reports what it refuses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
import inspect
import time
from typing import Any, Generic, TypeVar

from rclpy.node import Node
from rclpy.qos import QoSProfile

from ctc_chattering.core.arbiter import Arbiter
from ctc_chattering.core.grid import NANOSECONDS
from ctc_chattering.nodes.matching import MatchingSubscription

T = TypeVar('T')

#: By which rclpy sees that a callback wants the information.
_SIGNATURE = inspect.signature(lambda _message, _info: None)

#: Silence of a publisher after which another one may take its place [ns]: in real time, and where
#: time can wait, however slow the machine.
LAPSE, PATIENCE = NANOSECONDS // 2, 5 * NANOSECONDS
#: Time between two reports of refused messages [ns].
_REPORT = NANOSECONDS


def with_info(callback: Callable[[bytes, Mapping[str, Any]], None]) -> Callable[..., None]:
    """
    Return a callback for a raw subscription that is told about the message, too.

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


class Refused(Exception):
    """
    A message that is not used.

    Parameters
    ----------
    kind : str
        One word, under which it is counted.
    reason : str
        For people.

    """

    def __init__(self, kind: str, reason: str) -> None:
        super().__init__(reason)
        self.kind = kind


class Inbox(Generic[T]):
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
        [ns]. It raises `Refused` before it has changed anything.
    profile : QoSProfile
        As the subscription has it.
    concerns : callable, optional
        Returns whether a message is meant for us; others are passed over without a word.
    trusting : bool
        Whether a message is taken that either of two publishers may have sent.
    plausible : callable, optional
        Returns whether what a message says is what the one in control would say next.
    lapse : int
        Silence after which another publisher may take over [ns].

    Attributes
    ----------
    refused : Counter
        Refused messages by kind.
    owned : bool
        Whether it is known which of the `publishers` is in control.

    """

    def __init__(self, node: Node, kind: Any, topic: str, read: Callable[[bytes], T],
                 take: Callable[[T, int], None], profile: QoSProfile,
                 concerns: Callable[[T], bool] | None = None,
                 trusting: bool = False, plausible: Callable[[T], bool] | None = None,
                 lapse: int = LAPSE) -> None:
        self._node = node
        self.topic = topic
        self._full_name = node.resolve_topic_name(topic)
        self._read, self._take, self._concerns = read, take, concerns
        self._plausible = plausible
        self.refused: Counter[str] = Counter()
        self._reported = 0
        self.arbiter = Arbiter(lapse, trusting)
        self._exclusive = concerns is None
        self._contested = 0
        self._owner: tuple[bytes, str] | None = None
        self.owned = False
        self.subscription = MatchingSubscription(
            node, kind, topic, with_info(self._on_message), profile)

    def _on_message(self, data: bytes, info: Mapping[str, Any]) -> None:
        now = time.monotonic_ns()
        number = info.get('publication_sequence_number')
        try:
            try:
                message = self._read(data)
            except Exception as error:
                self.arbiter.reject(number, now, self._alone)
                raise Refused('undecodable', f'{len(data)} bytes that are no message: '
                              f'{" ".join(str(error).split())}') from None
            if self._concerns is not None and not self._concerns(message):
                self.arbiter.pass_over(number, now)
                return
            like = self._plausible
            if not self.arbiter.admits(
                    number, now, self._alone, None if like is None else lambda: like(message)):
                raise Refused('second_publisher', 'another publisher has control')
            try:
                self._take(message, now)
            except Refused:
                self.arbiter.revoke(number, now)
                raise
        except Refused as refused:
            self.refuse(refused, now)

    def refuse(self, refused: Refused, now: int) -> None:
        """Count a message that is not used, and say why, if there is a reason, once a second."""
        self.refused[refused.kind] += 1
        if str(refused) and now - self._reported > _REPORT:
            self._reported = now
            self._node.get_logger().warning(
                f'{self.topic}: refused: {refused} ({sum(self.refused.values())} so far)')

    def contested(self, publishers: int) -> bool:
        """Return whether others publish beside the one in control."""
        before, self._contested = self._contested, self.refused['second_publisher']
        return self._contested > before or (self._exclusive and publishers > 1)

    def _alone(self) -> bool:
        return bool(self._node.count_publishers(self.topic) <= 1)

    def publishers(self) -> list[str]:
        """
        Return who publishes on the topic, the one in control first.

        It is the one that was there alone before the others came, or the only other one when that
        one has fallen silent; see `owned`.
        """
        found = [(bytes(x.endpoint_gid), f'{x.node_namespace.rstrip("/")}/{x.node_name}')
                 for x in self._node.get_publishers_info_by_topic(self._full_name)]
        if len(found) == 1:
            self._owner = found[0]
        elif self.arbiter.passed_on:
            others = [x for x in found if x != self._owner]
            self._owner = others[0] if len(others) == 1 else None
        self.arbiter.passed_on = False
        self.owned = self._owner in found
        found.sort(key=lambda item: item != self._owner)
        return [name for _, name in found]
