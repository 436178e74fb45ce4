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

"""Injects faults into a running graph."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import functools
import random
import signal
import time
from typing import Any, TYPE_CHECKING

from bags import chunk, efforts, state
from ctc_chattering.configuration.topics import COMMANDS, JOINT_STATES
from faults import JOINTS, Kind, KINDS, malformed
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from soak import plan
from soak.plan import Fault
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

if TYPE_CHECKING:
    from soak.run import Graph

#: Time to wait for the answer of a service [s].
_ANSWER = 5.0
#: Time for which malformed messages go on after their topic's owner was continued [s].
_OVERLAP = 0.3
#: An error limit that trips at once [rad].
_TINY = 1e-9
#: Messages published at a time.
_BURST = 4
#: Waypoints of joints that the robot does not have, so that no change makes them valid.
_WAYPOINTS = Kind(plan.WAYPOINTS, JointTrajectory,
                  chunk(('a', 'b'), [([[0.0, 1.0], [], [], []], k, 0) for k in range(4)]),
                  lambda rng: chunk(('a', 'b'), [([[rng.random()], [], [], []], rng.randint(-1, 1),
                                                  0)]))


class FaultInjector:
    """
    Injects faults.

    Parameters
    ----------
    graph : Graph
        The graph under test.
    values : mapping
        The graph's parameters by node and name.

    """

    def __init__(self, graph: Graph, values: Mapping[str, Mapping[str, Any]]) -> None:
        self._graph, self._values = graph, values
        self._client = functools.cache(graph.probe.node.create_client)

    def inject(self, fault: Fault) -> str:
        """Inject a fault to its end; return what is wrong with the answers to it, if anything."""
        return _METHODS[fault.kind](self, fault) or ''

    def _kill(self, fault: Fault) -> None:
        self._graph.kill(fault.target)
        self._graph.wait(fault.lasts)
        self._graph.start(fault.target)

    def _stop(self, fault: Fault, name: str = '') -> None:
        victim = name or fault.target
        child = self._graph.children[victim]
        child.process.send_signal(signal.SIGSTOP)
        try:
            self._graph.wait(fault.lasts)
        finally:
            child.process.send_signal(signal.SIGCONT)
        if fault.lasts >= plan.LONGEST_STOP:
            self._graph.note_long_stop(victim)

    def _publish(self, fault: Fault, during: Callable[[], None] | None = None) -> None:
        """Publish messages on a topic; `during` takes its time meanwhile."""
        kind = _WAYPOINTS if fault.target == plan.WAYPOINTS else KINDS[fault.target]
        publisher = self._graph.probe.node.create_publisher(kind.type, fault.target, 100)
        rng = random.Random(fault.seed)

        def burst() -> None:
            if publisher.get_subscription_count():
                for data in (_plausible(fault.target, rng) if fault.kind == plan.PLAUSIBLE
                             else malformed(kind, _BURST, rng.randrange(1 << 31))):
                    publisher.publish(data)

        self._graph.at_each_step = burst
        try:
            if during is None:
                self._graph.wait(fault.lasts)
            else:
                during()
        finally:
            self._graph.at_each_step = None
            self._graph.probe.node.destroy_publisher(publisher)

    def _publish_alone(self, fault: Fault) -> None:
        """Publish while the topic's owner is stopped, and a little longer."""
        def stop() -> None:
            self._stop(fault, plan.OWNERS[fault.target])
            self._graph.wait(_OVERLAP)

        self._publish(fault, stop)

    def _call(self, kind: Any, name: str, request: Any) -> Any:
        """Return the response of a service; None if there is none."""
        client, future, end = self._client(kind, name), None, time.monotonic() + _ANSWER
        while time.monotonic() < end:
            if future is None and client.service_is_ready():
                future = client.call_async(request)
            if future is not None and future.done():
                return future.result()
            self._graph.step()
        return None

    def _succeeds(self, kind: Any, name: str, request: Any) -> str:
        response = self._call(kind, name, request)
        return '' if response is not None and response.success else f'{name}: no success'

    def _set(self, node: str, name: str, value: object, allowed: bool = True) -> str:
        """Set a parameter; return what is wrong with the response."""
        response = self._call(SetParameters, f'{node}/set_parameters', SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]))
        if response is None:
            return f'{node} does not answer'
        result = response.results[0]
        if result.successful == allowed:
            return ''
        return (f'{name} = {value!r} was refused: {result.reason}' if allowed
                else f'{name} = {value!r} was accepted')

    def _restore(self, node: str, names: Sequence[str]) -> list[str]:
        values = self._values[node]
        return [self._set(node, name, list(value) if isinstance(value, tuple) else value)
                for name in names if (value := values[name]) is not None]

    def _set_valid(self, fault: Fault) -> str:
        found = [self._set(fault.target, name, value) for name, value in fault.values]
        self._graph.wait(fault.lasts)
        return _joined(found + self._restore(fault.target, [name for name, _ in fault.values]))

    def _set_invalid(self, fault: Fault) -> str:
        return _joined([self._set(fault.target, name, value, False)
                        for name, value in fault.values])

    def _enable(self, fault: Fault) -> str:
        found = self._succeeds(SetBool, 'controller/enable', SetBool.Request(data=False))
        self._graph.wait(fault.lasts)
        return _joined([found, self._succeeds(
            SetBool, 'controller/enable', SetBool.Request(data=True))])

    def _reset(self, _fault: Fault) -> str:
        return self._succeeds(Trigger, 'controller/reset', Trigger.Request())

    def _trip(self, fault: Fault) -> str:
        found = [self._set('controller', 'error_limit', [_TINY] * len(JOINTS))]
        self._graph.wait(fault.lasts)
        found += self._restore('controller', ['error_limit'])
        return _joined([*found, self._reset(fault)])


_METHODS: Mapping[str, Callable[[FaultInjector, Fault], str | None]] = {
    plan.KILL: FaultInjector._kill, plan.STOP: FaultInjector._stop,
    plan.MALFORMED: FaultInjector._publish, plan.PLAUSIBLE: FaultInjector._publish,
    plan.ALONE: FaultInjector._publish_alone, plan.VALID: FaultInjector._set_valid,
    plan.INVALID: FaultInjector._set_invalid, plan.ENABLE: FaultInjector._enable,
    plan.RESET: FaultInjector._reset, plan.TRIP: FaultInjector._trip}


def _joined(failures: Sequence[str]) -> str:
    return '; '.join(filter(None, failures))


def _plausible(topic: str, rng: random.Random) -> list[bytes]:
    """Return messages as the topic's owner might publish them now; states name a frame."""
    row = [rng.uniform(-1.0, 1.0) for _ in JOINTS]
    if topic == COMMANDS:
        return [efforts(JOINTS, [50.0 * x for x in row])]
    assert topic == JOINT_STATES
    sec, nanosec = divmod(time.time_ns(), 10 ** 9)
    return [state(JOINTS, [row, row, row], (sec, nanosec), 'intruder')]
