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
A node as a process: start, exit status, deadline.

The executables of `cli/node.py` call `run`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import sys
import time

from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.ros.node import BaseNode
from ctc_chattering.ros.process import check_security, end_after, use_profile
from ctc_chattering.ros.spinning import spin_until_stopped
import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

#: Longest wait for the last messages to arrive, after a signal [s].
_ACK_TIMEOUT_AFTER_SIGNAL_S = 0.2
#: Longest wait for them without one [s].
_ACK_TIMEOUT_S = 5.0
#: Time between two looks at that deadline [s].
_ACK_WAIT_S = 0.05
#: Longest time in which the middleware leaves the graph [s]: Fast DDS may hang there.
_LEAVE_TIMEOUT_S = 0.3


def run(make_node: Callable[[], BaseNode], name: str, arguments: Sequence[str],
        stop: Sequence[int]) -> int:
    """
    Run a node until it is done or stopped.

    Parameters
    ----------
    make_node : callable
        Called after ROS is up.
    name : str
        The executable, for messages.
    arguments : sequence of str
        Arguments for ROS.
    stop : sequence of int
        Fills with the signals that come.

    Returns
    -------
    int
        Exit status: 0, or 1 after an error that has been reported on one line, 2 if it was one
        of the arguments.

    """
    try:
        check_security()
        use_profile()
        rclpy.init(args=[name, *arguments], signal_handler_options=SignalHandlerOptions.NO)
        node = make_node()
    except Exception as error:  # Also of ROS, in one line.
        rclpy.try_shutdown()
        return _report_error(name, error)
    node.stop, status = stop, 1
    try:
        node.get_logger().info(node.introduction())
        spin_until_stopped(node)
        status = 0
    except CtcError as error:
        status = _report_error(name, error)
        node.failure = node.failure or str(error)
    finally:
        node.finish()
        node.report_end()
        wait_for_all_acked(node, stop)
        status = 1 if node.failure else status
        end_after(_LEAVE_TIMEOUT_S, status)
        node.destroy_node()
        rclpy.try_shutdown()
    return status


def _report_error(name: str, error: Exception) -> int:
    """Report an error, and return the exit status."""
    print(f'{name}: {" ".join(str(error).split())}', file=sys.stderr, flush=True)
    return 2 if isinstance(error, UsageError) else 1


def wait_for_all_acked(node: Node, stop: Sequence[int]) -> None:
    """
    Wait until the last messages have arrived.

    Peers that were killed are not waited for. A signal leaves little time, also one that comes
    meanwhile. At an end of its own a node has enough for lost messages to be sent again.
    """
    begin = time.monotonic()
    for publisher in list(node.publishers):
        while not publisher.wait_for_all_acked(Duration(seconds=_ACK_WAIT_S)):
            timeout = _ACK_TIMEOUT_AFTER_SIGNAL_S if stop else _ACK_TIMEOUT_S
            if time.monotonic() - begin > timeout:
                return
