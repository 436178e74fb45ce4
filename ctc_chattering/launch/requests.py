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
from contextlib import contextmanager, ExitStack
import dataclasses
from functools import partial
from itertools import zip_longest
from math import inf
import signal
import time
from typing import Any

from ctc_chattering.analysis.tables import in_field
from ctc_chattering.errors import as_ctc_error, CtcError
from ctc_chattering.launch.sole_graph import sole_graph
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.ros.messages import read_stamp
from ctc_chattering.ros.node import BaseNode
from ctc_chattering.ros.run_node import wait_for_all_acked
from ctc_chattering.ros.spinning import Executor
from ctc_chattering.ros.subscription import qos, ValidatedSubscription
from ctc_chattering.ros.topics import CLOCK, PARAMETERS
from ctc_chattering.simulation.closed_loop import Event
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.parameter import Parameter as RosParameter
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

    Attributes
    ----------
    pending : list
        Requests that have no answer yet.

    """

    def __init__(self, node: BaseNode, show: Callable[[str, bool, str], None],
                 patience: float = inf) -> None:
        self._node, self._show, self._patience = node, show, patience
        self._services: dict[str, Any] = {}
        self.pending: list[_Pending] = []

    def set(self, node: str, *values: Mapping[str, Any]) -> None:  # noqa: A003
        """Set parameters of a node; of several mappings one after the other."""
        items = [item for mapping in values for item in mapping.items()]
        request = SetParameters.Request(parameters=[
            RosParameter(name, value=list(value) if isinstance(value, tuple) else value)
            .to_parameter_msg() for name, value in items])
        name, value = items[-1]
        self._ask(f'{node}: {name} = {in_field(value)}', SetParameters, f'{node}/set_parameters',
                  request)

    def torques(self, on: bool) -> None:
        """Stop the torques, or resume them, after an error beyond the limit as well."""
        if on:
            self._ask('reset', Trigger, 'controller/reset', Trigger.Request())
        self._ask('enable' if on else 'disable', SetBool, 'controller/enable',
                  SetBool.Request(data=on))

    def _ask(self, what: str, kind: Any, service: str, request: Any) -> None:
        if service not in self._services:
            self._services[service] = self._node.create_client(kind, service)
        self.pending.append(_Pending(what, self._services[service], request, time.monotonic()))

    def poll(self) -> None:
        """Send what waits, and show the answers that have come."""
        now = time.monotonic()
        for it in list(self.pending):
            answers = [x.result() for x in it.futures if x.done()]
            if answers or now - it.asked > self._patience:
                self.pending.remove(it)
                self._show(it.what, *(_outcome(answers[0]) if answers else (
                    False, f'no answer of {it.client.srv_name}')))
            elif now - it.sent > _AGAIN and it.client.service_is_ready():
                it.sent = now
                it.futures.append(it.client.call_async(it.request))


def _outcome(response: Any) -> tuple[bool, str]:
    """Return whether what was asked was done, and the answer in words."""
    if isinstance(response, SetParameters.Response):
        reasons = [x.reason for x in response.results if not x.successful]
        return not reasons, '; '.join(reasons) or 'done'
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

    Attributes
    ----------
    time : float
        Time of the run [s]: that of ``/clock`` in lockstep, else since the first values of the
        plant's parameters.

    """

    def __init__(self, events: Sequence[Event], lockstep: bool) -> None:
        super().__init__('bringup')
        self._events = list(_with_holds(events) if lockstep else events)
        self._requests = Requests(self, self._answered)
        self._simulated = lockstep
        self._stamp: int | None = None
        self.time = 0.0
        kind, topic, profile = ((Clock, CLOCK, qos()) if lockstep else (
            ParameterEvent, f'plant/{PARAMETERS}', qos(100, latched=True)))
        self.inputs = [ValidatedSubscription(
            self, kind, topic, self._on_stamp, profile, read_stamp)]

    def _on_stamp(self, stamp: int, _arrival: int) -> None:
        if self._simulated or self._stamp is None:
            self._stamp = stamp

    def look(self, executor: Any) -> float:
        """Serve the graph for a moment; return the time of the run, or raise `CtcError`."""
        self.spin_in_batches(executor)
        if self._stamp is not None:
            self.time = seconds(self._stamp) if self._simulated else (
                self.get_clock().now().nanoseconds - self._stamp) / NANOSECONDS
        # One request at a time.
        if not self._requests.pending and self._events and self.time >= self._events[0].time:
            event = self._events.pop(0)
            self._requests.set(event.node, event.values)
        self._requests.poll()
        if self.failure:
            raise CtcError(self.failure)
        return self.time

    def _answered(self, _what: str, done: bool, answer: str) -> None:
        if not done:
            self.failure = f'an event was refused: {answer}'

    def report_end(self, why: str = '') -> None:
        """Say on ``/diagnostics`` why the graph ends, and wait until all have heard it."""
        super().report_end(why)
        wait_for_all_acked(self, [signal.SIGTERM])


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
        If ROS cannot start, or there is another graph in its domain and namespace.

    """
    with ExitStack() as leaving:
        with as_ctc_error('ROS'):
            leaving.callback(rclpy.try_shutdown)
            rclpy.init(args=['bringup', *ros_args], signal_handler_options=SignalHandlerOptions.NO)
            node = ParameterEventScheduler(events, lockstep)
            leaving.callback(node.destroy_node)
        leaving.enter_context(sole_graph(node))
        executor = Executor()
        executor.add_node(node)
        leaving.callback(executor.shutdown)
        yield partial(node.look, executor), node.report_end
