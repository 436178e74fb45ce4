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

"""Quality of service: subscriptions that match what the publishers of a topic offer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import copy
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

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


def weakened(requested: QoSProfile, offers: Sequence[QoSProfile]) -> QoSProfile:
    """Return `requested` with no more reliability and durability than every offer has."""
    result = copy.copy(requested)
    if any(x.reliability == ReliabilityPolicy.BEST_EFFORT for x in offers):
        result.reliability = ReliabilityPolicy.BEST_EFFORT
    if any(x.durability == DurabilityPolicy.VOLATILE for x in offers):
        result.durability = DurabilityPolicy.VOLATILE
    return result


class MatchingSubscription:
    """
    A subscription that hears best-effort publishers, too.

    It asks for what `profile` says. Only where no publisher of the topic offers that does
    it subscribe again and asks for less: a request for reliable messages does not match
    ``rclcpp::ClockQoS``, ``SensorDataQoS`` or the clock of ``ros2 bag play``. While a publisher
    matches, nothing changes, whoever else comes.

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
            self._profile = weakened(self._profile, offers)
            self._node.get_logger().info(
                f'{name}: subscribed as {self._profile.reliability.name}, '
                f'{self._profile.durability.name}: its publishers offer nothing better')
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
