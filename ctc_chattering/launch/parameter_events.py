"""What bringup does on the graph: follow the time, and set parameters when their time comes."""

from __future__ import annotations

from collections.abc import Sequence
import time
from typing import Any

from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.client import Client
from rclpy.parameter import Parameter as RosParameter
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rosgraph_msgs.msg import Clock

from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.ros.messages import nanoseconds_of, read_clock
from ctc_chattering.ros.node import BaseNode, Executor, qos
from ctc_chattering.ros.subscription import ValidatedSubscription
from ctc_chattering.ros.topics import CLOCK, PARAMETERS
from ctc_chattering.simulation.closed_loop import Event

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
        self._events = list(events)
        self._lockstep = lockstep
        self._clients_of: dict[str, Client] = {}
        #: The requests of the event that is due, all the same, and when the last was sent [s].
        self._pending: list[Future] = []
        self._asked = 0.0
        self._start: int | None = None
        self.time = 0.0
        if lockstep:
            self.inputs = [ValidatedSubscription(
                self, Clock, CLOCK, read_clock, self._on_clock, qos())]
        else:
            self.inputs = [ValidatedSubscription(
                self, ParameterEvent, f'plant/{PARAMETERS}', _read_start, self._on_start,
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
            self._finish(answered[0])
        due = self._events and self.time >= self._events[0].time
        now = time.monotonic()
        if self.failure is None and due and not (
                self._pending and now - self._asked < _AGAIN):
            self._asked = now
            self._set(self._events[0].node, self._events[0].values)

    def _finish(self, future: Future) -> None:
        """Look at the answer to the last request and go on."""
        for result in future.result().results:
            if not result.successful:
                self.failure = f'an event was refused: {result.reason}'
                return
        event = self._events.pop(0)
        if 'hold_at' in event.values or not self._lockstep:
            return
        if not self._events or self._events[0].time > self.time:
            following = self._events[0].time if self._events else 0.0
            self._events.insert(0, Event(self.time, 'plant', {'hold_at': following}))

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


def _read_start(data: bytes) -> int:
    return nanoseconds_of(deserialize_message(data, ParameterEvent).stamp)


class GraphMonitor:
    """
    A `ParameterEventScheduler` in this process, spun between other work.

    Parameters
    ----------
    events, lockstep
        As `ParameterEventScheduler` takes them.
    ros_args : sequence of str
        Arguments for ROS, such as a namespace.

    Raises
    ------
    CtcError
        If ROS cannot start.

    """

    def __init__(self, events: Sequence[Event], lockstep: bool, ros_args: Sequence[str]) -> None:
        try:
            rclpy.init(
                args=['bringup', *ros_args], signal_handler_options=SignalHandlerOptions.NO)
            self._node = ParameterEventScheduler(events, lockstep)
        except Exception as error:
            rclpy.try_shutdown()
            raise CtcError(' '.join(str(error).split())) from None
        self._executor = Executor()
        self._executor.add_node(self._node)

    def look(self) -> float:
        """
        Serve the graph for a moment and return the time of the run [s].

        Raises
        ------
        CtcError
            If an event was refused.

        """
        self._node.spin_in_batches(self._executor)
        self._node.idle()
        if self._node.failure:
            raise CtcError(self._node.failure)
        return self._node.time

    def close(self) -> None:
        """Leave the graph."""
        self._executor.remove_node(self._node)
        self._node.destroy_node()
        rclpy.try_shutdown()
