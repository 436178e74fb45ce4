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

"""What bringup does on the graph: follow the time, and set parameters when their time comes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import zip_longest
import signal

from ctc_chattering.errors import CtcError
from ctc_chattering.launch.requests import Requests
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.ros.messages import read_stamp
from ctc_chattering.ros.node import BaseNode, Executor, qos
from ctc_chattering.ros.run import wait_for_all_acked
from ctc_chattering.ros.subscription import ValidatedSubscription
from ctc_chattering.ros.topics import CLOCK, PARAMETERS
from ctc_chattering.simulation.closed_loop import Event
from rcl_interfaces.msg import ParameterEvent
import rclpy
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock


class ParameterEventScheduler(BaseNode):
    """
    Follows a run and carries out its events through the parameter services.

    In lockstep the plant holds simulated time before an event's first sample, until the
    scheduler moves its parameter ``hold_at`` on.

    Parameters
    ----------
    events : sequence of Event
        In the order of time.
    lockstep : bool

    """

    def __init__(self, events: Sequence[Event], lockstep: bool) -> None:
        super().__init__('bringup')
        self._events = list(_with_holds(events) if lockstep else events)
        self._requests = Requests(self, self._answered)
        self._waiting = False
        self._start: int | None = None
        self.time = 0.0
        if lockstep:
            self.inputs = [ValidatedSubscription(
                self, Clock, CLOCK, read_stamp, self._on_clock, qos())]
        else:
            self.inputs = [ValidatedSubscription(
                self, ParameterEvent, f'plant/{PARAMETERS}', read_stamp, self._on_start,
                qos(100, latched=True))]

    def _on_clock(self, now: int, _arrival: int) -> None:
        self.time = seconds(now)

    def _on_start(self, start: int, _arrival: int) -> None:
        if self._start is None:
            self._start = start

    def idle(self) -> None:
        """Carry out the next event if it is due, one request at a time."""
        if self._start is not None:
            self.time = (self.get_clock().now().nanoseconds - self._start) / NANOSECONDS
        if not self._waiting and self._events and self.time >= self._events[0].time:
            event = self._events.pop(0)
            self._waiting = True
            self._requests.set(event.node, event.values)
        self._requests.poll()

    def _answered(self, _what: str, done: bool, answer: str) -> None:
        self._waiting = not done  # After a refusal there is no other event.
        if not done:
            self.failure = f'an event was refused: {answer}'


def _with_holds(events: Sequence[Event]) -> Iterator[Event]:
    """Yield the events, and after all of one time the one that moves ``hold_at`` on."""
    for event, following in zip_longest(events, events[1:]):
        yield event
        if following is None or following.time > event.time:
            yield Event(event.time, 'plant', {'hold_at': following.time if following else 0.0})


@contextmanager
def graph_monitor(events: Sequence[Event], lockstep: bool, ros_args: Sequence[str]
                  ) -> Iterator[tuple[Callable[[], float], Callable[[str], None]]]:
    """
    Run a `ParameterEventScheduler` in this process, between other work.

    Leave it when no other process leaves: two that leave at once can hang in Fast DDS 2.14.

    Parameters
    ----------
    events, lockstep
        As `ParameterEventScheduler` takes them.
    ros_args : sequence of str
        Arguments for ROS, such as a namespace.

    Yields
    ------
    look : callable
        Serves the graph for a moment and returns the time of the run [s]; raises `CtcError` if
        an event was refused.
    report_end : callable
        Says on ``/diagnostics`` why the graph ends, and waits until all have heard it.

    Raises
    ------
    CtcError
        If ROS cannot start.

    """
    try:
        rclpy.init(args=['bringup', *ros_args], signal_handler_options=SignalHandlerOptions.NO)
        node = ParameterEventScheduler(events, lockstep)
    except Exception as error:
        rclpy.try_shutdown()
        raise CtcError(' '.join(str(error).split())) from None
    executor = Executor()
    executor.add_node(node)

    def look() -> float:
        node.spin_in_batches(executor)
        node.idle()
        if node.failure:
            raise CtcError(node.failure)
        return node.time

    def report_end(why: str) -> None:
        node.report_end(why)
        wait_for_all_acked(node, [signal.SIGTERM])

    try:
        yield look, report_end
    finally:
        executor.remove_node(node)
        node.destroy_node()
        rclpy.try_shutdown()
