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
Requests to a running graph's services, and timed events.

`ctc live` sends `Requests` of its user. `bringup` runs a `ParameterEventScheduler` in its own
process by `graph_monitor`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack
import dataclasses
from math import inf
import signal
import time
from typing import Any

from ctc_chattering.configuration.topics import CLOCK, PARAMETERS
from ctc_chattering.errors import as_ctc_error, CtcError
from ctc_chattering.launch.sole_graph import sole_graph
from ctc_chattering.number_format import format_value
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.ros.messages import read_stamp
from ctc_chattering.ros.node import BaseNode
from ctc_chattering.ros.parameters import to_parameter
from ctc_chattering.ros.run_node import wait_for_all_acked
from ctc_chattering.ros.spinning import Executor
from ctc_chattering.ros.subscription import qos, ValidatedSubscription
from ctc_chattering.simulation.closed_loop import Event
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger

#: Time after which a request is sent again [s]. The middleware drops an answer to a client that
#: the server has not met yet, and setting a value twice does no harm.
_RETRY_S = 1.0


@dataclasses.dataclass
class _Request:
    """Unanswered request, with times of the monotonic clock [s]."""

    description: str
    client: Any
    message: Any
    deadline: float
    next_try: float = 0.0
    response: Any = None

    def take_response(self, future: Future) -> None:
        """Take a response, also of an earlier try."""
        self.response = future.result()


class Requests:
    """
    Service calls that nothing waits for.

    Parameters
    ----------
    node : BaseNode
        Client of the services.
    show : callable
        Called with the description of a request, its success, and the answer.
    patience : float
        Time to wait for a service and its answer [s].

    Attributes
    ----------
    pending : list
        Requests that have no answer yet.

    """

    def __init__(self, node: BaseNode, show: Callable[[str, bool, str], None],
                 patience: float = inf) -> None:
        self._node = node
        self._show = show
        self._patience = patience
        self._clients: dict[str, Any] = {}
        self.pending: list[_Request] = []

    def set(self, node: str, *values: Mapping[str, Any]) -> None:  # noqa: A003
        """Set parameters of a node, in their order."""
        items = [item for mapping in values for item in mapping.items()]
        name, value = items[-1]
        self._send(f'{node}: {name} = {format_value(value, 12)}', SetParameters,
                   f'{node}/set_parameters',
                   parameters=[to_parameter(*item).to_parameter_msg() for item in items])

    def torques(self, on: bool) -> None:
        """Stop or resume the torques, also after a trip."""
        if on:
            self._send('reset', Trigger, 'controller/reset')
        self._send('enable' if on else 'disable', SetBool, 'controller/enable', data=on)

    def move(self, action: str) -> None:
        """Have the reference stop or go home."""
        self._send(action, Trigger, f'reference/{action}')

    def learning(self, action: str) -> None:
        """Have the reference freeze, resume or reset its learning."""
        if action == 'reset':
            self._send('reset learning', Trigger, 'reference/reset_learning')
        else:
            self._send(f'{action} learning', SetBool, 'reference/freeze_learning',
                       data=action == 'freeze')

    def guide(self, on: bool) -> None:
        """Begin or end guiding by hand."""
        self._send('guide by hand' if on else 'hold', SetBool, 'controller/guide', data=on)

    def _send(self, description: str, service_type: Any, service: str, **fields: Any) -> None:
        """Take a request, which `poll` sends."""
        if service not in self._clients:
            self._clients[service] = self._node.create_client(service_type, service)
        self.pending.append(_Request(
            description, self._clients[service], service_type.Request(**fields),
            time.monotonic() + self._patience))

    def poll(self) -> None:
        """Send the waiting requests, and show the answers."""
        now = time.monotonic()
        for request in list(self.pending):
            client = request.client
            if request.response is not None:
                self.pending.remove(request)
                self._show(request.description, *_outcome(request.response))
            elif now > request.deadline:
                self.pending.remove(request)
                self._show(request.description, False, f'{client.srv_name} did not answer')
            elif now > request.next_try and client.service_is_ready():
                request.next_try = now + _RETRY_S
                client.call_async(request.message).add_done_callback(request.take_response)


def _outcome(response: Any) -> tuple[bool, str]:
    """Return the success of a request, and its answer."""
    if isinstance(response, SetParameters.Response):
        reasons = [x.reason for x in response.results if not x.successful]
        return not reasons, '; '.join(reasons) or 'done'
    return bool(response.success), str(response.message)


class ParameterEventScheduler(BaseNode):
    """
    Bringup's node, which sets the parameters of events.

    Time of the run is that of ``/clock`` in lockstep, else since the first values of the plant's
    parameters. In lockstep the plant holds simulated time before the first sample of an event,
    until the scheduler moves the plant's parameter ``hold_at`` on.

    Parameters
    ----------
    events : sequence of Event
        In the order of time.
    lockstep : bool

    """

    def __init__(self, events: Sequence[Event], lockstep: bool) -> None:
        super().__init__('bringup')
        self._events = list(_with_holds(events) if lockstep else events)
        self._requests = Requests(self, self._on_answer)
        self._simulated = lockstep
        self._stamp: int | None = None
        message_type: Any = Clock if lockstep else ParameterEvent  # Both begin with a stamp.
        topic = CLOCK if lockstep else f'plant/{PARAMETERS}'
        self.inputs = [ValidatedSubscription(
            self, message_type, topic, self._on_stamp, qos(latched=not lockstep), read_stamp)]

    def _on_stamp(self, stamp: int, _arrival: int) -> None:
        if self._simulated or self._stamp is None:
            self._stamp = stamp

    def look(self) -> float:
        """
        Serve the graph, and return the run's time [s].

        Raises
        ------
        CtcError
            If an event was refused.

        """
        self.spin_in_batches(self.executor)
        now = self._time()
        # One request at a time.
        if not self._requests.pending and self._events and now >= self._events[0].time:
            event = self._events.pop(0)
            self._requests.set(event.node, event.values)
        self._requests.poll()
        if self.failure:
            raise CtcError(self.failure)
        return now

    def _time(self) -> float:
        """Return the time of the run [s]."""
        if self._stamp is None:
            return 0.0
        if self._simulated:
            return seconds(self._stamp)
        now: int = self.get_clock().now().nanoseconds
        return (now - self._stamp) / NANOSECONDS

    def _on_answer(self, _description: str, done: bool, answer: str) -> None:
        if not done:
            self.failure = f'an event was refused: {answer}'

    def report_end(self, why: str = '') -> None:
        """Report why the graph ends; wait for readers."""
        super().report_end(why)
        wait_for_all_acked(self, [signal.SIGTERM])


def _with_holds(events: Sequence[Event]) -> Iterator[Event]:
    """Yield the events, with the moves of ``hold_at``."""
    next_times = [*(event.time for event in events[1:]), inf]
    for event, next_time in zip(events, next_times):
        yield event
        if next_time > event.time:
            yield Event(event.time, 'plant', {'hold_at': next_time if next_time < inf else 0.0})


@contextmanager
def graph_monitor(events: Sequence[Event], lockstep: bool, ros_args: Sequence[str]
                  ) -> Iterator[ParameterEventScheduler]:
    """
    Run a `ParameterEventScheduler` in this process, between other work.

    Leave it when no other process leaves: two that leave at once can hang in Fast DDS 2.14.

    Parameters
    ----------
    events, lockstep
        As `ParameterEventScheduler` takes them.
    ros_args : sequence of str
        Arguments for ROS, such as a namespace.

    Raises
    ------
    CtcError
        If ROS cannot start, or there is another graph in its domain and namespace.

    """
    with ExitStack() as context:
        with as_ctc_error('ROS'):
            context.callback(rclpy.try_shutdown)
            rclpy.init(args=['bringup', *ros_args], signal_handler_options=SignalHandlerOptions.NO)
            node = ParameterEventScheduler(events, lockstep)
            context.callback(node.destroy_node)
        context.enter_context(sole_graph(node))
        executor = Executor()
        executor.add_node(node)
        context.callback(executor.shutdown)
        yield node
