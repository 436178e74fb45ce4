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

"""What every node has: bounded spinning, an end by signals, reports on ``/diagnostics``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf
import signal
import time
from typing import Any, NamedTuple

from ctc_chattering.configuration.loop_setup import Values
from ctc_chattering.configuration.parameter_file import OF_ROS
from ctc_chattering.controller.loop_statistics import LoopStatistics
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.matching import qos
from ctc_chattering.ros.parameter_service import TolerantParameterService
from ctc_chattering.ros.real_time import RealTime
from ctc_chattering.ros.subscription import ValidatedSubscription
from ctc_chattering.ros.topics import DIAGNOSTICS
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.task import Future

try:
    from rclpy.experimental.events_executor import EventsExecutor as Executor
except ImportError:  # An rclpy from before it was there: slower, but the same.
    from rclpy.executors import SingleThreadedExecutor as Executor

__all__ = ['ENDED', 'ERROR', 'NAP', 'OK', 'TICK', 'WARN', 'BaseNode', 'Executor', 'Status', 'qos']

#: Levels of a `Status`, as `DiagnosticStatus` has them.
OK, WARN, ERROR = range(3)
#: Longest time between two looks at signals and at `BaseNode.idle` [s]. It must be finite: see
#: docs/design.md.
TICK = 0.05
#: Sleep between two batches [s].
NAP = 0.02
#: Key of the value of a node's last report that says why it ends.
ENDED = 'ended'
#: Time between two messages on /diagnostics [ns].
_REPORT = NANOSECONDS


class Status(NamedTuple):
    """What a node has to say of itself."""

    #: One of `OK`, `WARN` and `ERROR`.
    level: int
    #: Its state in a few words.
    message: str
    #: Whatever else, by name.
    values: Mapping[str, object]


class BaseNode(Node):
    """
    A node that `run` can drive, and that reports on ``/diagnostics`` once a second.

    Parameters
    ----------
    name : str
    values : mapping, optional
        Values of its parameters; the others have their defaults.

    Attributes
    ----------
    given : mapping
        `values`.
    statistics : LoopStatistics
        Of its samples, where it has any.
    inputs : list of ValidatedSubscription
        The topics that it obeys, for the report.
    tick : float
        Longest time between two calls of `idle` [s].
    lockstep : bool
        Whether simulated time waits for it.
    done : Future
        Complete it to end the process with status 0.
    failure : str or None
        Set it to have the process end with status 1.
    stop : sequence of int
        The signals that have asked for the end.
    scheduling : RealTime or None
        Of its process, where it has parameters for that.
    parameter_service : TolerantParameterService
        Takes requests to set parameters.

    """

    def __init__(self, name: str, values: Values | None = None) -> None:
        self.given = dict(values or {})
        super().__init__(name, start_parameter_services=False, parameter_overrides=[
            RosParameter(x, value=self.given[x]) for x in OF_ROS if x in self.given])
        self.parameter_service = TolerantParameterService(self)
        self.done = Future()
        self.failure: str | None = None
        self.stop: Sequence[int] = ()
        self.tick = TICK
        self.lockstep = False
        self.statistics = LoopStatistics()
        self.inputs: list[ValidatedSubscription[Any]] = []
        self.scheduling: RealTime | None = None
        # A spin for simulated time does not come back while there are messages: see `serve`.
        self.create_timer(TICK, self.check_signals, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._report_due = 0
        self._diagnostics = self.create_publisher(DiagnosticArray, DIAGNOSTICS, qos(10))

    def check_signals(self) -> None:
        """End the spin when a signal has come."""
        if self.stop and not self.done.done():
            self.done.set_result(None)

    def idle(self) -> None:
        """Do what need not wait for a message; called at least every `tick`."""

    def patience(self) -> float:
        """Return how long it can wait for a message before it is `overdue` [s]."""
        return inf

    def overdue(self) -> None:
        """Do what must be done where a message has not come in time."""

    @property
    def in_real_time(self) -> bool:
        """Whether the robot waits for none of its messages."""
        return False

    def schedule(self) -> None:
        """Have the process scheduled for real time while that is needed, and say so."""
        if self.scheduling and (line := self.scheduling.update(self.in_real_time)):
            if self.scheduling.lost:
                self.get_logger().warning(line)
            else:
                self.get_logger().info(line)

    def status(self) -> Status:
        """Return what is to be reported beside the loop statistics and what was refused."""
        return Status(OK, 'running', {})

    def introduction(self) -> str:
        """Return in a few words what the node runs and what it waits for."""
        return 'runs'

    def report(self, now: int) -> None:
        """Publish on ``/diagnostics`` if a second has passed; `now` [ns] on any clock."""
        if now < self._report_due:
            return
        self._report_due = max(self._report_due + _REPORT, now + _REPORT // 2)
        self.statistics.rotate(now)
        self._publish(*self._report())

    def _report(self) -> Status:
        """Return all that there is to report."""
        level, message, values = self.status()
        if self.get_parameter('use_sim_time').value and not self.get_clock().now().nanoseconds:
            level = max(level, WARN)
            message = f'{message}; use_sim_time is true, but /clock has no publisher'
            self.get_logger().warning(message, throttle_duration_sec=5.0)
        everything = dict(values)
        if self.scheduling:
            everything['scheduling'] = self.scheduling.outcome
            if self.scheduling.lost:
                level, message = max(level, WARN), f'{message}; {self.scheduling.outcome}'
        if self.statistics.samples:
            everything |= self.statistics.values()
        for subscription in self.inputs:
            names, topic = subscription.publishers(), subscription.topic
            everything[f'{topic}: publishers'] = ', '.join(names) or 'none'
            everything[f'{topic}: refused'] = sum(subscription.rejected.values())
            if subscription.newest is not None:
                everything[f'{topic}: skipped for newer ones'] = subscription.skipped
            for kind, count in sorted(subscription.rejected.items()):
                everything[f'{topic}: refused, {kind}'] = count
            contention = subscription.contention(names)
            if contention:
                level, message = max(level, ERROR), f'{message}; {contention}'
        return Status(level, message, everything)

    def report_end(self, why: str = '') -> None:
        """
        Publish on ``/diagnostics`` that the node ends, and why.

        By default that is its failure, the signal that has come, or what `done` holds.
        """
        signals = [signal.Signals(number).name for number in self.stop]
        result = self.done.result() if self.done.done() else None
        why = why or self.failure or ', '.join(signals) or str(result or 'done')
        self._publish(ERROR if self.failure else OK, f'ended: {why}',
                      {**self._report().values, ENDED: why})

    def _publish(self, level: int, message: str, values: Mapping[str, object]) -> None:
        name = self.get_fully_qualified_name()
        array = DiagnosticArray(status=[DiagnosticStatus(
            level=bytes([level]), name=name, message=message, hardware_id=name,
            values=[KeyValue(key=key, value=_shown(value)) for key, value in values.items()])])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)

    def spin(self, executor: Any) -> None:
        """
        Serve callbacks for `tick`, or until it is done.

        In real time it ends with a sample, if there is one: what is done before the next spin has
        the most time then.
        """
        if self.lockstep:
            executor.spin_until_future_complete(self.done, self.tick)
        else:
            self.serve(executor, self.tick / 2)
            self.serve(executor, self.tick / 2, self.statistics.samples)

    def serve(self, executor: Any, lasts: float, samples: int = -1) -> None:
        """
        Serve callbacks for `lasts` [s], until it is done, or there are more than `samples`.

        A tenth faster in lockstep is EventsExecutor's spin_until_future_complete, but it does not
        come back while there are messages, and loses some memory each time.
        """
        end = time.monotonic() + lasts
        while (left := end - time.monotonic()) > 0.0 and not self.done.done():
            executor.spin_once(min(left, self.patience()))
            self.overdue()
            if 0 <= samples < self.statistics.samples:
                return

    def spin_in_batches(self, executor: Any) -> None:
        """
        Serve what has come, then sleep: for nodes whose messages are not waited for.

        Woken for every message, such a node would take the processor away from the control loop;
        in batches a message costs half as much.
        """
        self.serve(executor, 0.002)
        time.sleep(NAP)

    def finish(self) -> None:
        """Do what must be done before the node goes."""


def _shown(value: object) -> str:
    return f'{value:.4g}' if isinstance(value, float) else str(value)
