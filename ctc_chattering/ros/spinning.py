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
Bounded spins of a node, and turns between them.

`run` of `ros/run_node.py` calls `spin_until_stopped`. It ends when the node is done, or a signal
has come.
"""

from __future__ import annotations

from collections.abc import Sequence
import gc
from math import inf
import time
from typing import Any

from ctc_chattering.controller.loop_statistics import LoopStatistics
import numpy as np
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future

try:
    from rclpy.experimental.events_executor import EventsExecutor as Executor
except ImportError:  # Older versions of rclpy have only a slower one.
    from rclpy.executors import SingleThreadedExecutor as Executor

__all__ = ['NAP', 'TICK', 'Executor', 'SpinningNode', 'spin_until_stopped']

#: Longest time between two looks at signals and at `SpinningNode.idle` [s].
TICK = 0.05
#: Duration of a spin in lockstep [s]: finite, as an infinite one hangs, and long, as each loses
#: some memory (docs/design.md).
_LOCKSTEP_SPIN_S = 3600.0
#: Sleep between two batches [s].
NAP = 0.02
#: New objects since the last search for reference cycles, above which there is another one.
_MAX_NEW_OBJECTS = 2000


class SpinningNode(Node):
    """
    A node that is served in bounded spins.

    Parameters
    ----------
    name : str
    **options
        As `Node` takes them.

    Attributes
    ----------
    statistics : LoopStatistics
        Of its samples, where it has any.
    tick : float
        Longest time between two calls of `idle` [s].
    lockstep : bool
        Whether simulated time waits for it.
    done : Future
        Complete it to end the process with status 0.
    stop : sequence of int
        The signals that have asked for the end.

    """

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.statistics = LoopStatistics()
        self.done = Future()
        self.stop: Sequence[int] = ()
        self.tick = TICK
        self.lockstep = False
        #: Ends the spin in which the node is in lockstep.
        self._spin_end = Future()
        self.create_timer(TICK, self._take_turn, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.done.add_done_callback(lambda _: self._leave_spin())

    def _take_turn(self) -> None:
        """Take a turn, and end the spin after a signal."""
        if self.stop and not self.done.done():
            self.done.set_result(None)
        elif self.lockstep:
            self.turn()
        else:
            self._leave_spin()

    def _leave_spin(self) -> None:
        if not self._spin_end.done():
            self._spin_end.set_result(None)

    def turn(self) -> None:
        """Do the work between messages."""
        self.idle()
        self.report(time.monotonic_ns())
        if gc.get_count()[0] > _MAX_NEW_OBJECTS:  # In no sample, as Python would.
            gc.collect()

    def idle(self) -> None:
        """Do work without a message, at least every `tick`."""

    def report(self, now: int) -> None:
        """Report at `now` [ns], if it is time."""

    def patience(self) -> float:
        """Return the longest wait before a message is `overdue` [s]."""
        return inf

    def overdue(self) -> None:
        """React to a message that has not come in time."""

    def spin(self, executor: Any) -> None:
        """
        Serve callbacks for a while.

        In lockstep that is as long as the run, otherwise `tick`, or until it is done. In real time
        it ends with a sample, if there is one. Then `turn` has the most time.
        """
        if self.lockstep:
            self._spin_end = Future()
            executor.spin_until_future_complete(self._spin_end, _LOCKSTEP_SPIN_S)
        else:
            self.serve(executor, self.tick / 2)
            self.serve(executor, self.tick / 2, self.statistics.samples)

    def serve(self, executor: Any, lasts: float, samples: int = -1) -> None:
        """
        Serve callbacks for `lasts` [s], or until a sample.

        It also ends when the node is done, or there are more than `samples`.

        EventsExecutor's spin_until_future_complete is a tenth faster, but it does not return while
        there are messages, and loses some memory each time.
        """
        end = time.monotonic() + lasts
        while (remaining := end - time.monotonic()) > 0.0 and not self.done.done():
            executor.spin_once(min(remaining, self.patience()))
            self.overdue()
            if 0 <= samples < self.statistics.samples:
                return

    def spin_in_batches(self, executor: Any) -> None:
        """
        Serve the messages that wait, then sleep.

        It is for nodes that no other waits for. Woken for every message, such a node would take
        the processor away from the control loop. In batches a message costs half as much.
        """
        self.serve(executor, 0.002)
        time.sleep(NAP)


@np.errstate(all='ignore')  # An overflow in the law shows in its torque.
def spin_until_stopped(node: SpinningNode) -> None:
    """Serve a node until it is done or stopped."""
    executor = Executor()
    executor.add_node(node)
    gc.disable()
    gc.freeze()  # All present objects stay until the end.
    try:
        while not (node.stop or node.done.done()) and rclpy.ok():
            node.spin(executor)
            node.turn()
    finally:
        executor.remove_node(node)
        gc.unfreeze()  # For the node, whose end is that of its DDS participant.
        gc.enable()
