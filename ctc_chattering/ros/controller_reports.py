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
The controller as the reference node sees it: its mode, and its errors.

The mode is that on ``/diagnostics``. The errors are those on ``controller/tracking``, once someone
listens.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
import time
from typing import Any, NamedTuple

from ctc_chattering.configuration.topics import DIAGNOSTICS, select, TRACKING
from ctc_chattering.controller.state_machine import Mode
from ctc_chattering.errors import RejectedMessage
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import nanoseconds
from ctc_chattering.ros.reports import MODE
from ctc_chattering.ros.subscription import qos
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from sensor_msgs.msg import JointState

#: Time for which a report is believed: a controller sends one a second [s].
MAX_AGE_S = 3.0


class TrackingError(NamedTuple):
    """A sample of the controller, whose vectors have shape (n,)."""

    #: Stamp of its state [ns].
    t: int
    q_d: Vector
    dq_d: Vector
    e: Vector
    de: Vector


class ControllerReports:
    """
    Reads what the controller reports.

    Parameters
    ----------
    node : Node
    joint_names : sequence of str, length n
        In the order of the vectors.
    on_mode : callable
        Called with every report of a mode, and its text.
    on_error : callable
        Called with every `TrackingError`, after `listen`.

    Attributes
    ----------
    mode : Mode or None
        The mode reported last, None without a report for `MAX_AGE_S`.

    """

    def __init__(self, node: Node, joint_names: Sequence[str],
                 on_mode: Callable[[Mode, str], None],
                 on_error: Callable[[TrackingError], None]) -> None:
        self._node = node
        self._names = [f'{name}/{x}' for x in ('desired', 'error') for name in joint_names]
        self._on_mode = on_mode
        self._on_error = on_error
        self._mode: Mode | None = None
        self._reported = 0.0
        self._controller = f'{node.get_namespace().rstrip("/")}/controller'
        self._tracking: Any = None
        node.create_subscription(DiagnosticArray, DIAGNOSTICS, self._read_mode, qos(10))

    @property
    def mode(self) -> Mode | None:
        return self._mode if time.monotonic() - self._reported < MAX_AGE_S else None

    def listen(self) -> None:
        """Subscribe to the errors."""
        if self._tracking is None:
            self._tracking = self._node.create_subscription(
                JointState, f'controller/{TRACKING}', self._read_error, qos())

    def _read_mode(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {value.key: value.value for value in status.values}
            mode = Mode.__members__.get(values.get(MODE, ''))
            if status.name == self._controller and mode is not None:
                self._mode, self._reported = mode, time.monotonic()
                self._on_mode(mode, status.message)

    def _read_error(self, message: JointState) -> None:
        try:
            q, dq = select(self._names, message.name, message.position, message.velocity)
        except RejectedMessage:
            return  # Of a controller for other joints.
        if not all(map(isfinite, (*q, *dq))):
            return
        n = len(q) // 2
        self._on_error(TrackingError(
            nanoseconds(message.header.stamp), q[:n], dq[:n], q[n:], dq[n:]))
