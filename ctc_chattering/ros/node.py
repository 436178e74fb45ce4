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

"""Nodes: bounded spinning, an end by signals, reports, parameters, the description of a robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import gc
from math import inf
import signal
import sys
import time
from typing import Any, cast, Generic, NamedTuple, TypeVar

from ctc_chattering.configuration.loop_setup import Values
from ctc_chattering.configuration.node_parameters import NODES
from ctc_chattering.configuration.package_share import read_description
from ctc_chattering.configuration.parameter_file import OF_ROS
from ctc_chattering.controller.loop_statistics import LoopStatistics
from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.parameters import Config
from ctc_chattering.ros.parameters import NodeParameters, TolerantParameterService
from ctc_chattering.ros.process import check_security, end_after, use_profile
from ctc_chattering.ros.subscription import (
    compatible,
    MatchingSubscription,
    qos,
    ValidatedSubscription,
)
from ctc_chattering.ros.topics import DIAGNOSTICS, ROBOT_DESCRIPTION, TOPICS
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import numpy as np
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_msgs.msg import String

try:
    from rclpy.experimental.events_executor import EventsExecutor as Executor
except ImportError:  # An rclpy from before it was there: slower, but the same.
    from rclpy.executors import SingleThreadedExecutor as Executor

__all__ = ['ENDED', 'ERROR', 'NAP', 'OK', 'TICK', 'WARN', 'BaseNode', 'Executor', 'Status', 'qos']

#: Levels of a `Status`, as `DiagnosticStatus` has them.
OK, WARN, ERROR = range(3)
#: Longest time between two looks at signals and at `BaseNode.idle` [s].
TICK = 0.05
#: Duration of a spin in lockstep [s]: finite, as an infinite one hangs, and long, as each loses
#: some memory; see docs/design.md.
_LOCKSTEP_SPIN = 3600.0
#: Sleep between two batches [s].
NAP = 0.02
#: Key of the value of a node's last report that says why it ends.
ENDED = 'ended'
#: Objects more than at the last search for reference cycles that are worth another one.
_GARBAGE = 2000
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
    urgent : list of Service
        Those whose requests are served before any for parameters.
    parameter_service : TolerantParameterService
        Takes requests to set parameters.

    """

    def __init__(self, name: str, values: Values | None = None) -> None:
        self.given = dict(values or {})
        super().__init__(name, start_parameter_services=False, parameter_overrides=[
            RosParameter(x, value=self.given[x]) for x in OF_ROS if x in self.given])
        self.urgent: list[Any] = []
        self.parameter_service = TolerantParameterService(self)
        self.done = Future()
        self.failure: str | None = None
        self.stop: Sequence[int] = ()
        self.tick = TICK
        self.lockstep = False
        self.statistics = LoopStatistics()
        self.inputs: list[ValidatedSubscription[Any]] = []
        self.create_timer(TICK, self._take_turn, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.done.add_done_callback(lambda _: self._leave_spin())
        #: Ends the spin in which the node is in lockstep.
        self._spin_end = Future()
        self._report_due = 0
        self._diagnostics = self.create_publisher(
            DiagnosticArray, DIAGNOSTICS, qos(TOPICS[DIAGNOSTICS].depth))

    def _take_turn(self) -> None:
        """Do what lies between messages; end the spin when a signal has come."""
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
        """Do what lies between messages."""
        self.idle()
        self.report(time.monotonic_ns())
        if gc.get_count()[0] > _GARBAGE:  # In no sample, as Python would.
            gc.collect()

    def idle(self) -> None:
        """Do what need not wait for a message; called at least every `tick`."""

    def on_change(self) -> None:
        """Take what has been set."""

    def check(self, config: Any) -> None:
        """Raise `CtcError` if a configuration that would be set is not allowed."""

    def completed(self, _values: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return parameters that are set with others, by name."""
        return {}

    def patience(self) -> float:
        """Return how long it can wait for a message before it is `overdue` [s]."""
        return inf

    def overdue(self) -> None:
        """Do what must be done where a message has not come in time."""

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
            contention = subscription.report_contention(names)
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
        Serve callbacks for `tick`, or until it is done; in lockstep, as long as that lasts.

        In real time it ends with a sample, if there is one: what is done before the next spin has
        the most time then.
        """
        if self.lockstep:
            self._spin_end = Future()
            executor.spin_until_future_complete(self._spin_end, _LOCKSTEP_SPIN)
        else:
            self.serve(executor, self.tick / 2)
            self.serve(executor, self.tick / 2, self.statistics.samples)

    def serve(self, executor: Any, lasts: float, samples: int = -1) -> None:
        """
        Serve callbacks for `lasts` [s], until it is done, or there are more than `samples`.

        A tenth faster is EventsExecutor's spin_until_future_complete, but it does not come back
        while there are messages, and loses some memory each time.
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


C = TypeVar('C', bound=Config)


class LoopNode(BaseNode, Generic[C]):
    """
    A node with the parameters of `C`, a `NodeConfig`.

    A subclass calls `find_description` at the end of its construction.

    Parameters
    ----------
    name : str
        Of the executable.
    values : mapping, optional
        As `BaseNode` takes them.

    Attributes
    ----------
    parameters : NodeParameters
        Of the node.
    problem : str
        What is wrong with the robot's description: that it has not come, or why it was refused;
        empty when all is well.

    """

    def __init__(self, name: str, values: Values | None) -> None:
        super().__init__(name, values)
        self.parameters = NodeParameters(self, NODES[name])
        self.problem = ''

    @property
    def config(self) -> C:
        """The configuration in force."""
        config: C = self.parameters.config
        return config

    def begin(self, description: str) -> None:
        """Begin with a robot; its description is empty where none is needed."""

    def matched(self, *publishers: Publisher) -> bool:
        """
        Return whether all who should hear the first message of `publishers` would.

        Those are the subscribers, and of the nodes that the parameter `wait_for` names all that
        read the topic, by `TOPICS`.
        """
        for publisher in publishers:
            infos = [
                info for info in self.get_subscriptions_info_by_topic(publisher.topic_name)
                if compatible(publisher.qos_profile, info.qos_profile)]
            if publisher.get_subscription_count() < len(infos):
                return False
            awaited = set(cast(Any, self.config).wait_for) - {info.node_name for info in infos}
            for topic in TOPICS.values():
                if publisher.topic_name.endswith('/' + topic.name) and awaited & set(
                        topic.readers):
                    return False
        return True

    def find_description(self) -> None:
        """
        Call `begin`, with the description at once, or when it comes on its topic.

        A text from the topic that is refused is reported, and the next one waited for.

        Raises
        ------
        CtcError
            If the file cannot be read or is refused.

        """
        config = cast(Any, self.config)
        if not config.described or config.description:
            self.begin(read_description(config.description) if config.described else '')
            return
        self.problem = f'waiting for {ROBOT_DESCRIPTION}'
        self.get_logger().info(self.problem)
        MatchingSubscription(self, String, ROBOT_DESCRIPTION, self._on_description,
                             qos(1, latched=True), raw=False)

    def _on_description(self, message: String) -> None:
        if not self.problem:
            return
        try:
            self.begin(message.data)
        except CtcError as error:
            self.problem = f'{ROBOT_DESCRIPTION}: {error}'
            self.get_logger().error(self.problem)
            return
        self.problem = ''
        self.get_logger().info(f'{ROBOT_DESCRIPTION} has come')


#: What `run` waits at the end for the last messages to arrive, all together [s]: after a signal,
#: and without one; and between two looks for signals.
_FAREWELL, _PATIENCE, _SLICE = 0.2, 5.0, 0.05
#: How long the middleware may take after that to leave the graph [s]: Fast DDS hangs now and then
#: where others leave at the same time.
_LEAVE = 0.3


def run(make_node: Callable[[], BaseNode], name: str, arguments: Sequence[str],
        stop: Sequence[int]) -> int:
    """
    Run a node until it is done, or a signal comes; the process then ends, too.

    Parameters
    ----------
    make_node : callable
        Called after ROS is up.
    name : str
        The executable, for messages.
    arguments : sequence of str
        Arguments for ROS.
    stop : sequence of int
        Fills with the signals that come.

    Returns
    -------
    int
        Exit status: 0, or 1 after an error that has been reported on one line, 2 if it was one
        of the arguments.

    """
    try:
        check_security()
        use_profile()
        rclpy.init(args=[name, *arguments], signal_handler_options=SignalHandlerOptions.NO)
        node = make_node()
    except Exception as error:  # Of ROS, too, in one line.
        rclpy.try_shutdown()
        return _failed(name, error)
    node.stop, status = stop, 1
    try:
        node.get_logger().info(node.introduction())
        spin_until_stopped(node)
        status = 0
    except CtcError as error:
        status = _failed(name, error)
        node.failure = node.failure or str(error)
    finally:
        node.finish()
        node.report_end()
        wait_for_all_acked(node, stop)
        status = 1 if node.failure else status
        end_after(_LEAVE, status)
        node.destroy_node()
        rclpy.try_shutdown()
    return status


@np.errstate(all='ignore')  # What overflows in the law shows in its torque.
def spin_until_stopped(node: BaseNode) -> None:
    """Serve a node until it is done or a signal comes."""
    executor = Executor()
    executor.add_node(node)
    gc.disable()
    gc.freeze()  # What there is already is there until the end.
    try:
        while not (node.stop or node.done.done()) and rclpy.ok():
            node.spin(executor)
            node.turn()
    finally:
        executor.remove_node(node)
        gc.unfreeze()  # For the node, whose end is that of its DDS participant.
        gc.enable()


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
        while not publisher.wait_for_all_acked(Duration(seconds=_SLICE)):
            if time.monotonic() - begin > (_FAREWELL if stop else _PATIENCE):
                return
