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
Reports of a node on ``/diagnostics``.

`BaseNode` of `ros/node.py` publishes one a second, and one when it ends.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ctc_chattering.controller.loop_statistics import LoopStatistics
from ctc_chattering.number_format import format_number
from ctc_chattering.ros.subscription import ValidatedSubscription
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

#: Levels of a `Status`, as `DiagnosticStatus` has them.
OK = 0
WARN = 1
ERROR = 2
#: Key of the value of a node's last report that says why it ends.
ENDED = 'ended'


class Status(NamedTuple):
    """A node's report on itself."""

    #: One of `OK`, `WARN` and `ERROR`.
    level: int
    #: Its state in a few words.
    message: str
    #: Further values by name.
    values: Mapping[str, object]


def full_report(node: Node, status: Status, statistics: LoopStatistics,
                inputs: Sequence[ValidatedSubscription[Any]]) -> Status:
    """
    Return a status with statistics, inputs and clock.

    Parameters
    ----------
    node : Node
        Node that reports.
    status : Status
        Its own.
    statistics : LoopStatistics
        Of its samples, if there are any.
    inputs : sequence of ValidatedSubscription
        The topics that it obeys.

    """
    level, message = status.level, status.message
    values = dict(status.values)
    if node.get_parameter('use_sim_time').value and not node.get_clock().now().nanoseconds:
        level = max(level, WARN)
        message = f'{message}; use_sim_time is true, but /clock has no publisher'
        node.get_logger().warning(message, throttle_duration_sec=5.0)
    if statistics.samples:
        values |= statistics.values()
    for subscription in inputs:
        names, topic = subscription.publishers(), subscription.topic
        values[f'{topic}: publishers'] = ', '.join(names) or 'none'
        values[f'{topic}: refused'] = sum(subscription.rejected.values())
        if subscription.newest is not None:
            values[f'{topic}: skipped for newer ones'] = subscription.skipped
        for reason, count in sorted(subscription.rejected.items()):
            values[f'{topic}: refused, {reason}'] = count
        contention = subscription.report_contention(names)
        if contention:
            level, message = max(level, ERROR), f'{message}; {contention}'
    return Status(level, message, values)


def diagnostics(node: Node, status: Status) -> DiagnosticArray:
    """Return the message of a status."""
    name = node.get_fully_qualified_name()
    values = []
    for key, value in status.values.items():
        text = format_number(value, 4) if isinstance(value, float) else str(value)
        values.append(KeyValue(key=key, value=text))
    array = DiagnosticArray(status=[DiagnosticStatus(
        level=bytes([status.level]),
        name=name,
        message=status.message,
        hardware_id=name,
        values=values)])
    array.header.stamp = node.get_clock().now().to_msg()
    return array
