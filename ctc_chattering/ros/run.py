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

"""Running a node: prepare, spin until stopped, shut down; an end without a traceback."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import sys
import time

from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.ros import signals
from ctc_chattering.ros.exit_deadline import end_after
from ctc_chattering.ros.fastdds import use_profile
from ctc_chattering.ros.node import BaseNode, Executor
from ctc_chattering.ros.real_time import garbage_off_the_loop
from ctc_chattering.ros.security import check_security
import numpy as np
import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

#: What `run` waits at the end for the last messages to arrive, all together [s]: after a signal,
#: and without one; and between two looks for signals.
_FAREWELL, _PATIENCE, _SLICE = 0.25, 5.0, 0.1
#: How long the middleware may take after that to leave the graph [s]: Fast DDS hangs now and then
#: where others leave at the same time.
_LEAVE = 0.3


def run(make_node: Callable[[], BaseNode], name: str,
        arguments: Sequence[str] = (), stop: list[int] | None = None) -> int:
    """
    Run a node until it is done, or SIGINT or SIGTERM comes; the process then ends, too.

    Parameters
    ----------
    make_node : callable
        Called after ROS is up.
    name : str
        The executable, for messages.
    arguments : sequence of str
        Arguments for ROS.
    stop : list of int, optional
        Fills with the signals that come, where they are collected already.

    Returns
    -------
    int
        Exit status: 0, or 1 after an error that has been reported on one line, 2 if it was one
        of the arguments.

    """
    stop = signals.collect() if stop is None else stop
    try:
        node = prepare(make_node, name, arguments, stop)
    except Exception as error:  # Of ROS, too, in one line.
        status = _failed(name, error)
        rclpy.try_shutdown()
        return status
    status = 1
    try:
        spin_until_stopped(node)
        status = 0
    except CtcError as error:
        status = _failed(name, error)
        node.failure = node.failure or str(error)
    finally:
        shut_down(node, status)
    return 1 if node.failure else status


def prepare(make_node: Callable[[], BaseNode], name: str, arguments: Sequence[str],
            stop: Sequence[int]) -> BaseNode:
    """Start ROS and make the node; the arguments are those of `run`."""
    check_security()
    use_profile()
    rclpy.init(args=[name, *arguments], signal_handler_options=SignalHandlerOptions.NO)
    node = make_node()
    node.stop = stop
    node.get_logger().info(node.introduction())
    return node


@np.errstate(all='ignore')  # What overflows in the law shows in its torque.
def spin_until_stopped(node: BaseNode) -> None:
    """Serve a node until it is done or a signal comes."""
    executor = Executor()
    executor.add_node(node)
    try:
        with garbage_off_the_loop() as collect:
            while not (node.stop or node.done.done()) and rclpy.ok():
                node.spin(executor)
                node.idle()
                node.schedule()
                node.report(time.monotonic_ns())
                collect()
    finally:
        executor.remove_node(node)


def shut_down(node: BaseNode, status: int) -> None:
    """Have a node send its last messages and leave the graph; `status` if that hangs."""
    node.finish()
    node.report_end()
    if node.scheduling:  # Whatever holds the end up must not hold up others.
        node.scheduling.update(False)
    wait_for_all_acked(node, node.stop)
    end_after(_LEAVE, 1 if node.failure else status)
    node.destroy_node()
    rclpy.try_shutdown()


def _failed(name: str, error: Exception) -> int:
    """Report an error on one line and return the exit status."""
    print(f'{name}: {" ".join(str(error).split())}', file=sys.stderr, flush=True)
    return 2 if isinstance(error, UsageError) else 1


def wait_for_all_acked(node: Node, stop: Sequence[int]) -> None:
    """
    Wait until the last messages have arrived, but not for peers that were killed.

    A signal leaves little time for it; at an end of its own a node has enough, for what was lost
    on the way is sent again only now and then.
    """
    begin = time.monotonic()
    for publisher in list(node.publishers):
        while True:
            left = begin + (_FAREWELL if stop else _PATIENCE) - time.monotonic()
            if publisher.wait_for_all_acked(Duration(seconds=min(max(0.0, left), _SLICE))):
                break
            if left <= 0.0:
                return
