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
Publishing recorded messages again, each at its time.

`ctc replay` calls `replay`, which takes a bag of any recorder.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
import sys
import time
from typing import Any

from ctc_chattering.bags.bag import Bag, is_cdr, serialization
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.messages import message_type
from ctc_chattering.ros.process import stop_signals, use_profile
from ctc_chattering.ros.run_node import wait_for_all_acked
from ctc_chattering.ros.subscription import qos
import rclpy
from rclpy.signals import SignalHandlerOptions
from rosbags.interfaces import QosDurability


def replay(bag: str | Path, rate: float = 1.0, delay: float = 1.0) -> int:
    """
    Publish all messages of a bag, with their timing.

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
        Number of messages published. SIGINT and SIGTERM end it early.

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
        context = rclpy.Context()  # A script may have nodes in the default one.
        rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node('player', context=context)
        try:
            return _publish(reader, rate, delay, node, stop)
        finally:
            node.destroy_node()
            context.try_shutdown()


def _publish(reader: Bag, rate: float, delay: float, node: Any, stop: Sequence[int]) -> int:
    """Publish all messages by a node; return how many."""
    publishers = _create_publishers(reader, node)
    count = 0
    begin = time.monotonic() + delay
    for connection, t, data in reader.messages():
        since = (t - reader.start_time) / NANOSECONDS
        _sleep_until(begin + since / rate, stop)
        if stop:
            break
        publisher = publishers.get((connection.topic, connection.msgtype))
        if publisher is not None and is_cdr(connection):
            publisher.publish(bytes(data))
            count += 1
    wait_for_all_acked(node, stop)
    return count


def _create_publishers(reader: Bag, node: Any) -> dict[tuple[str, str], Any]:
    """
    Return a publisher for each topic and type.

    Topics that are left out are printed with the reason.
    """
    publishers: dict[tuple[str, str], Any] = {}
    # Each file of the bag has the topics.
    distinct = {(x.topic, x.msgtype, is_cdr(x)): x for x in reader.connections}
    for x in distinct.values():
        # Subscribers match a reliable publisher, whatever they ask for.
        latched = any(profile.durability == QosDurability.TRANSIENT_LOCAL
                      for profile in getattr(x.ext, 'offered_qos_profiles', []))
        reason = ''
        if not is_cdr(x):
            reason = f'its messages are {serialization(x)}, not of ROS 2'
        elif any(topic == x.topic for topic, _ in publishers):
            reason = 'the topic also has messages of another type'
        else:
            try:
                publishers[x.topic, x.msgtype] = node.create_publisher(
                    message_type(x.msgtype),
                    x.topic,
                    qos(latched=latched))
            except CtcError:
                reason = 'its message type is not installed'
        if reason:
            print(
                f'{x.topic} ({x.msgtype}) is not replayed, because {reason}',
                file=sys.stderr,
                flush=True)
    return publishers


def _sleep_until(instant: float, stop: Sequence[int]) -> None:
    """Wait for a monotonic time [s], or a signal."""
    while not stop and (remaining := instant - time.monotonic()) > 0.0:
        time.sleep(min(remaining, 0.05))  # A signal is noticed after 0.05 s.
