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

"""What is asked of a graph through its services, and what bringup asks at given times."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
import dataclasses
from functools import partial
from itertools import zip_longest
from math import inf
import signal
import time
from typing import Any

from ctc_chattering.analysis.tables import in_field
from ctc_chattering.errors import CtcError, refused_as
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.ros.messages import read_stamp
from ctc_chattering.ros.node import BaseNode, Executor, qos, wait_for_all_acked
from ctc_chattering.ros.subscription import ValidatedSubscription
from ctc_chattering.ros.topics import CLOCK, PARAMETERS
from ctc_chattering.simulation.closed_loop import Event
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import GetParameters, SetParameters
import rclpy
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger

#: Time after which a request is sent again [s]: the middleware drops an answer to a client that
#: the server has not met yet, and to set a value twice does no harm.
_AGAIN = 1.0


@dataclasses.dataclass
class _Pending:
    """A request that has no answer yet."""

    what: str
    client: Any
    request: Any
    asked: float
    outcome: Callable[[Any], tuple[bool, str]]
    sent: float = -1.0
    futures: list[Future] = dataclasses.field(default_factory=list)


class Requests:
    """
    Calls services of the graph without waiting for them.

    Parameters
    ----------
    node : BaseNode
        Who asks.
    show : callable
        Called with what was asked, whether it was done, and the answer.
    patience : float
        Time to wait for a service and its answer [s].

    """

    def __init__(self, node: BaseNode, show: Callable[[str, bool, str], None],
                 patience: float = inf) -> None:
        self._node, self._show, self._patience = node, show, patience
        self._clients_by_name: dict[str, Any] = {}
        self._pending: list[_Pending] = []

    def set(self, node: str, *values: Mapping[str, Any], done: str = 'done'  # noqa: A003
            ) -> None:
        """Set parameters of a node; of several mappings one after the other."""
        items = [item for mapping in values for item in mapping.items()]
        request = SetParameters.Request(parameters=[
            RosParameter(name, value=list(value) if isinstance(value, tuple) else value)
            .to_parameter_msg() for name, value in items])
        name, value = items[-1]
        self._ask(f'{node}: {name} = {in_field(value)}', SetParameters, f'{node}/set_parameters',
                  request, partial(_outcome, done=done))

    def get(self, node: str, names: Sequence[str], use: Callable[[dict[str, Any]], None]) -> None:
        """Ask for parameters of a node that are declared, and call `use` with them."""
        def show(response: Any) -> tuple[bool, str]:
            use({name: parameter_value_to_python(value)
                 for name, value in zip(names, response.values)})
            return True, ''  # What was not asked by a user needs no answer.
        self._ask(f'{node}: its parameters', GetParameters, f'{node}/get_parameters',
                  GetParameters.Request(names=list(names)), show)

    def enable(self, on: bool) -> None:
        """Stop or resume the torques."""
        self._ask('enable' if on else 'disable', SetBool, 'controller/enable',
                  SetBool.Request(data=on))

    def reset(self) -> None:
        """Resume the torques after an error beyond the limit."""
        self._ask('reset', Trigger, 'controller/reset', Trigger.Request())

    def _ask(self, what: str, kind: Any, service: str, request: Any,
             outcome: Callable[[Any], tuple[bool, str]] | None = None) -> None:
        client = self._clients_by_name.get(service)
        if client is None:
            client = self._clients_by_name[service] = self._node.create_client(kind, service)
        self._pending.append(_Pending(
            what, client, request, time.monotonic(), outcome or _outcome))

    def poll(self) -> None:
        """Send what waits, and show the answers that have come."""
        now = time.monotonic()
        for it in list(self._pending):
            done = next((x for x in it.futures if x.done()), None)
            if done is not None:
                self._pending.remove(it)
                try:
                    with refused_as('its answer'):
                        outcome = it.outcome(done.result())
                except CtcError as error:
                    outcome = False, str(error)
                if outcome[1] or not outcome[0]:
                    self._show(it.what, *outcome)
            elif now - it.asked > self._patience:
                self._pending.remove(it)
                self._show(it.what, False, f'no answer of {it.client.srv_name}')
            elif now - it.sent > _AGAIN and it.client.service_is_ready():
                it.sent = now
                it.futures.append(it.client.call_async(it.request))


def _outcome(response: Any, done: str = '') -> tuple[bool, str]:
    """Return whether what was asked was done, and the answer in words."""
    if isinstance(response, SetParameters.Response):
        reasons = [x.reason for x in response.results if not x.successful]
        return not reasons, '; '.join(reasons) or done
    return bool(response.success), str(response.message)


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
                self, Clock, CLOCK, self._on_clock, qos(), read_stamp)]
        else:
            self.inputs = [ValidatedSubscription(
                self, ParameterEvent, f'plant/{PARAMETERS}', self._on_start,
                qos(100, latched=True), read_stamp)]

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
