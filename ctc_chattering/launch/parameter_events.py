"""What bringup does on the graph: follow the time, and set parameters when their time comes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import zip_longest
import time
from typing import Any

from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.ros.messages import read_stamp
from ctc_chattering.ros.node import BaseNode, Executor, qos
from ctc_chattering.ros.subscription import ValidatedSubscription
from ctc_chattering.ros.topics import CLOCK, PARAMETERS
from ctc_chattering.simulation.closed_loop import Event
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.client import Client
from rclpy.parameter import Parameter as RosParameter
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rosgraph_msgs.msg import Clock

#: Time after which a request without an answer is sent again [s]: the middleware drops an answer
#: to a client that the server has not met yet, and to set a value twice does no harm.
_AGAIN = 1.0


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
        self._clients_of: dict[str, Client] = {}
        #: The requests of the event that is due, all the same, and when the last was sent [s].
        self._pending: list[Future] = []
        self._asked = 0.0
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
        answered = [future for future in self._pending if future.done()]
        if answered:
            self._pending = []
            self._events.pop(0)
            for result in answered[0].result().results:
                if not result.successful:
                    self.failure = f'an event was refused: {result.reason}'
        due = self._events and self.time >= self._events[0].time
        now = time.monotonic()
        if self.failure is None and due and not (
                self._pending and now - self._asked < _AGAIN):
            self._asked = now
            self._set(self._events[0].node, self._events[0].values)

    def _set(self, node: str, values: Any) -> None:
        client = self._clients_of.get(node)
        if client is None:
            client = self._clients_of[node] = self.create_client(
                SetParameters, f'{node}/set_parameters')
        if not client.service_is_ready():
            return
        request = SetParameters.Request(parameters=[
            RosParameter(name, value=list(value) if isinstance(value, tuple) else value)
            .to_parameter_msg() for name, value in values.items()])
        self._pending.append(client.call_async(request))


def _with_holds(events: Sequence[Event]) -> Iterator[Event]:
    """Yield the events, and after all of one time the one that moves ``hold_at`` on."""
    for event, following in zip_longest(events, events[1:]):
        yield event
        if following is None or following.time > event.time:
            yield Event(event.time, 'plant', {'hold_at': following.time if following else 0.0})


@contextmanager
def graph_monitor(events: Sequence[Event], lockstep: bool, ros_args: Sequence[str]
                  ) -> Iterator[Callable[[], float]]:
    """
    Run a `ParameterEventScheduler` in this process, between other work.

    Parameters
    ----------
    events, lockstep
        As `ParameterEventScheduler` takes them.
    ros_args : sequence of str
        Arguments for ROS, such as a namespace.

    Yields
    ------
    callable
        Serves the graph for a moment and returns the time of the run [s]; raises `CtcError` if
        an event was refused.

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

    try:
        yield look
    finally:
        executor.remove_node(node)
        node.destroy_node()
        rclpy.try_shutdown()
