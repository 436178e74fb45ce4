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

"""Recorded messages, published again on their topics, each at its time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
import sys
import time
from typing import Any

from ctc_chattering.bags.bag import Bag
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.messages import message_type, stamp
from ctc_chattering.ros.node import wait_for_all_acked
from ctc_chattering.ros.process import stop_signals, use_profile
from ctc_chattering.ros.topics import CLOCK
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rosbags.interfaces import Connection, QosDurability, QosReliability
from rosgraph_msgs.msg import Clock

#: Period of ``/clock`` where the bag holds none [ns].
_CLOCK_PERIOD = 10_000_000
#: Longest wait until all known subscribers have matched [s].
_MATCHING = 5.0
#: Time after that until the subscribers have matched, too [s].
_SETTLE = 0.5
#: Longest sleep between two checks for signals [s].
_SLEEP = 0.05


def replay(bag: str | Path, rate: float = 1.0, delay: float = 1.0) -> int:
    """
    Publish all messages of a bag with their timing over ROS, and the clock.

    Parameters
    ----------
    bag : str or Path
        Directory of a bag of any recorder. Topics whose message types are not installed are left
        out.
    rate : float
        Seconds of the bag per second.
    delay : float
        Time for subscribers to find the publishers [s].

    Returns
    -------
    int
        Number of messages published, without those of a clock that the bag does not contain.
        SIGINT and SIGTERM end it early.

    Raises
    ------
    CtcError
        If an argument is not allowed, there is no bag, or it cannot be read.
    ModuleNotFoundError
        Without ROS.

    """
    if not rate > 0.0:
        raise ParameterError('rate', rate, 'a number > 0')
    if not delay >= 0.0:
        raise ParameterError('delay', delay, 'a number >= 0')
    use_profile()
    with closing(open_bag(Path(bag))) as reader, stop_signals() as stop:
        context = rclpy.Context()  # Of its own: a script may have nodes.
        rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node('player', context=context)
        try:
            return _published(reader, rate, delay, node, stop)
        finally:
            node.destroy_node()
            context.try_shutdown()


def _published(reader: Bag, rate: float, delay: float, node: Any, stop: Sequence[int]) -> int:
    """Publish all messages by a node; return how many."""
    count = 0
    topics = {x.topic: x for x in reader.connections}  # Each file of the bag has them.
    types = _types(topics.values())
    publishers = {
        name: node.create_publisher(types[x.msgtype], name, _qos(x))
        for name, x in topics.items() if x.msgtype in types}
    has_clock = any(topic.endswith('/' + CLOCK) for topic in publishers)
    clock = None if has_clock else node.create_publisher(Clock, '/clock', 10)
    begin = time.monotonic() + delay
    _sleep_until(begin, stop)
    while not stop and time.monotonic() < begin + _MATCHING and not all(
            publisher.get_subscription_count() >= node.count_subscribers(topic)
            for topic, publisher in publishers.items()):
        time.sleep(_SLEEP)
    begin = time.monotonic() + _SETTLE
    for t, topic, data in _messages(reader, clock is not None):
        _sleep_until(begin + (t - reader.start_time) / NANOSECONDS / rate, stop)
        if stop:
            break
        if topic in publishers:
            publishers[topic].publish(bytes(data))
            count += 1
        elif clock is not None and not topic:
            clock.publish(data)
    wait_for_all_acked(node, stop)
    return count


def _types(connections: Iterable[Connection]) -> dict[str, Any]:
    """Return message classes by name; print a line with the topics whose types are missing."""
    types, missing = {}, []
    for connection in connections:
        try:
            types[connection.msgtype] = message_type(connection.msgtype)
        except CtcError:
            missing.append(f'{connection.topic} ({connection.msgtype})')
    if missing:
        print('not replayed, because their message types are not installed: '
              + ', '.join(missing), file=sys.stderr, flush=True)
    return types


def _sleep_until(instant: float, stop: Sequence[int]) -> None:
    """Wait until a time on the monotonic clock [s], or a signal."""
    while not stop and (left := instant - time.monotonic()) > 0.0:
        time.sleep(min(left, _SLEEP))


def _messages(reader: Bag, with_clock: bool) -> Iterator[tuple[int, str, Any]]:
    """Yield log time [ns], topic and data; the topic is empty for an added clock."""
    tick = reader.start_time
    for connection, t, data in reader.messages():
        while with_clock and tick <= t:
            yield tick, '', serialize_message(Clock(clock=stamp(tick)))
            tick += _CLOCK_PERIOD
        yield t, connection.topic, data


def _qos(connection: Connection) -> QoSProfile:
    """Return durability and reliability that the recorded publishers offered."""
    profiles = getattr(connection.ext, 'offered_qos_profiles', [])
    latched = any(x.durability == QosDurability.TRANSIENT_LOCAL for x in profiles)
    lossy = any(x.reliability == QosReliability.BEST_EFFORT for x in profiles)
    return QoSProfile(
        depth=1000,
        durability=(DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE),
        reliability=ReliabilityPolicy.BEST_EFFORT if lossy else ReliabilityPolicy.RELIABLE)
