"""The shell around every node: start, bounded spinning, signals, an end without a traceback."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import sys
import time
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import ParameterType
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter_service import ParameterService
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from ctc_chattering import signals
from ctc_chattering.core.grid import NANOSECONDS
from ctc_chattering.core.pace import Pace
from ctc_chattering.deadline import end_after
from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.graph import DIAGNOSTICS, TOPICS
from ctc_chattering.middleware import use_profile
from ctc_chattering.nodes.inbox import Inbox
from ctc_chattering.nodes.matching import compatible
from ctc_chattering.real_time import garbage_off_the_loop, RealTime
from ctc_chattering.security import check_security

try:
    from rclpy.experimental.events_executor import EventsExecutor as Executor
except ImportError:  # An rclpy from before it was there: slower, but the same.
    from rclpy.executors import SingleThreadedExecutor as Executor

__all__ = ['NAP', 'TICK', 'Executor', 'Shell', 'Status', 'qos', 'run', 'wait_for_all_acked']

#: Longest time between two looks at signals and at `Shell.idle` [s]. It must be finite: see
#: docs/design.md.
TICK = 0.05
#: Sleep between two batches [s].
NAP = 0.02
#: Time between two messages on /diagnostics [ns].
_REPORT = NANOSECONDS
#: What `run` waits at the end for the last messages to arrive, all together [s]: after a signal,
#: and without one; and between two looks for signals.
_FAREWELL, _PATIENCE, _SLICE = 0.25, 5.0, 0.1
#: How long the middleware may take after that to leave the graph [s]: Fast DDS hangs now and then
#: where others leave at the same time.
_LEAVE = 0.3


def qos(depth: int = 1000, latched: bool = False) -> QoSProfile:
    """Return a reliable profile; `latched` keeps messages for those who subscribe later."""
    return QoSProfile(depth=depth, durability=(
        DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE))


class Status(NamedTuple):
    """What a node has to say of itself."""

    #: One of the constants of `DiagnosticStatus`.
    level: bytes
    #: Its state in a few words.
    message: str
    #: Whatever else, by name.
    values: Mapping[str, object]


class _ParameterService(ParameterService):
    """Takes a value of no known type for one that is not set; rclpy's raises, in our spin."""

    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        return super()._set_parameters_callback(_typed(request), response)

    def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        return super()._set_parameters_atomically_callback(_typed(request), response)


def _typed(request: Any) -> Any:
    for parameter in request.parameters:
        if parameter.value.type > ParameterType.PARAMETER_STRING_ARRAY:
            parameter.value.type = ParameterType.PARAMETER_NOT_SET
    return request


class Shell(Node):
    """
    A node that `run` can drive, and that reports on ``/diagnostics`` once a second.

    Attributes
    ----------
    pace : Pace
        Of its samples, where it has any.
    inboxes : list of Inbox
        Its topics, for the report.
    tick : float
        Longest time between two calls of `idle` [s].
    hurried : bool
        Whether simulated time waits for it.
    done : Future
        Complete it to end the process with status 0.
    failure : str or None
        Set it to have the process end with status 1.
    stop : sequence of int
        The signals that have asked for the end.
    scheduling : RealTime or None
        Of its process, where it has parameters for that.

    """

    def __init__(self, name: str) -> None:
        super().__init__(name, start_parameter_services=False)
        _ParameterService(self)
        self.done = Future()
        self.failure: str | None = None
        self.stop: Sequence[int] = ()
        self.tick = TICK
        self.hurried = False
        self.pace = Pace()
        self.inboxes: list[Inbox[Any]] = []
        self.scheduling: RealTime | None = None
        # A spin for simulated time does not come back while there are messages: see `serve`.
        self.create_timer(TICK, self.heed, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._report_due = 0
        self._diagnostics = self.create_publisher(DiagnosticArray, DIAGNOSTICS, qos(10))

    def heed(self) -> None:
        """End the spin when a signal has come."""
        if self.stop and not self.done.done():
            self.done.set_result(None)

    def idle(self) -> None:
        """Do what need not wait for a message; called at least every `tick`."""

    @property
    def in_real_time(self) -> bool:
        """Whether the robot waits for nobody."""
        return False

    def schedule(self) -> None:
        """Have the process scheduled for real time while that is needed, and say so."""
        line = self.scheduling.update(self.in_real_time) if self.scheduling else ''
        if line:
            self.get_logger().info(line)

    def status(self) -> Status:
        """Return what is to be reported beside the pace and what the inboxes refused."""
        return Status(DiagnosticStatus.OK, 'running', {})

    def introduction(self) -> str:
        """Return in a few words what the node runs and what it waits for."""
        return 'runs'

    def report(self, now: int) -> None:
        """Publish on ``/diagnostics`` if a second has passed; `now` [ns] on any clock."""
        if now < self._report_due:
            return
        self._report_due = max(self._report_due + _REPORT, now + _REPORT // 2)
        self.pace.rotate(now)
        level, message, values = self.status()
        if self.get_parameter('use_sim_time').value and not self.get_clock().now().nanoseconds:
            level = max(level, DiagnosticStatus.WARN)
            message = f'{message}; use_sim_time is true, but nobody publishes /clock'
            self.get_logger().warning(message, throttle_duration_sec=5.0)
        everything = dict(values)
        if self.scheduling:
            everything['scheduling'] = self.scheduling.outcome
        if self.pace.samples:
            everything |= self.pace.values()
        for inbox in self.inboxes:
            names = inbox.publishers()
            everything[f'{inbox.topic}: publishers'] = ', '.join(names) or 'none'
            everything[f'{inbox.topic}: refused'] = sum(inbox.refused.values())
            for kind, count in sorted(inbox.refused.items()):
                everything[f'{inbox.topic}: refused, {kind}'] = count
            if inbox.contested(len(names)):
                level = max(level, DiagnosticStatus.WARN)
                who = ', '.join(names)
                if inbox.owned:
                    who = f'{names[0]}: {", ".join(names[1:]) or "some that have gone"}'
                message = f'{message}; {inbox.topic} has ' + (
                    f'publishers beside {who}' if inbox.owned else f'several publishers: {who}')
        name = self.get_fully_qualified_name()
        array = DiagnosticArray(status=[DiagnosticStatus(
            level=level, name=name, message=message, hardware_id=name,
            values=[KeyValue(key=key, value=_shown(value))
                    for key, value in everything.items()])])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)

    def spin(self, executor: Any) -> None:
        """
        Serve callbacks for `tick`, or until it is done.

        In real time it ends with a sample, if there is one: what is done before the next spin has
        the most time then.
        """
        if self.hurried:
            executor.spin_until_future_complete(self.done, self.tick)
        else:
            self.serve(executor, self.tick / 2)
            self.serve(executor, self.tick / 2, self.pace.samples)

    def serve(self, executor: Any, lasts: float, samples: int = -1) -> None:
        """
        Serve callbacks for `lasts` [s], until it is done, or there are more than `samples`.

        A tenth faster in lockstep is EventsExecutor's spin_until_future_complete, but it does not
        come back while there are messages, and loses some memory each time.
        """
        end = time.monotonic() + lasts
        while (left := end - time.monotonic()) > 0.0 and not self.done.done():
            executor.spin_once(left)
            if 0 <= samples < self.pace.samples:
                return

    def spin_in_batches(self, executor: Any) -> None:
        """
        Serve what has come, then sleep: for nodes that nobody waits for.

        Woken for every message, such a node would take the processor away from the control loop;
        in batches a message costs half as much.
        """
        self.serve(executor, 0.002)
        time.sleep(NAP)

    def finish(self) -> None:
        """Do what must be done before the node goes."""

    def heard(self, publishers: Sequence[Publisher], wait_for: Sequence[str]) -> bool:
        """
        Return whether all who should hear the first message of `publishers` would.

        Parameters
        ----------
        publishers : sequence of Publisher
            Those about to send.
        wait_for : sequence of str
            Names of nodes that have been started; those of them that read a topic, by
            `graph.TOPICS`, must have matched with its publisher.

        """
        for publisher in publishers:
            infos = [
                info for info in self.get_subscriptions_info_by_topic(publisher.topic_name)
                if compatible(publisher.qos_profile, info.qos_profile)]
            if publisher.get_subscription_count() < len(infos):
                return False
            names = {info.node_name for info in infos}
            for topic in TOPICS.values():
                if publisher.topic_name.endswith('/' + topic.name) and not (
                        names >= set(wait_for) & set(topic.readers)):
                    return False
        return True


def run(make_node: Callable[[], Shell], name: str,
        arguments: Sequence[str] = (), stop: list[int] | None = None) -> int:
    """
    Run a node until it is done, or SIGINT or SIGTERM comes; the process then ends, too.

    Parameters
    ----------
    make_node : callable
        Called after ROS is up.
    name : str
        The executable, for messages.
    arguments : sequence of str
        Arguments for ROS.
    stop : list of int, optional
        Fills with the signals that come, where somebody collects them already.

    Returns
    -------
    int
        Exit status: 0, or 1 after an error that has been reported on one line, 2 if it was one
        of the arguments.

    """
    stop = signals.collect() if stop is None else stop
    node = executor = None
    status = 1
    try:
        check_security()
        use_profile()
        rclpy.init(args=[name, *arguments], signal_handler_options=SignalHandlerOptions.NO)
        node = make_node()
        node.stop = stop
        node.get_logger().info(node.introduction())
        executor = Executor()
        executor.add_node(node)
        with garbage_off_the_loop() as collect:
            while not (stop or node.done.done()) and rclpy.ok():
                node.spin(executor)
                node.idle()
                node.schedule()
                node.report(time.monotonic_ns())
                collect()
        status = 1 if node.failure else 0
    except CtcError as error:
        print(f'{name}: {error}', file=sys.stderr, flush=True)
        return 2 if isinstance(error, UsageError) else 1
    except Exception as error:
        if node is not None:
            raise
        print(f'{name}: {" ".join(str(error).split())}', file=sys.stderr, flush=True)
        return 1
    finally:
        if executor is not None:
            executor.remove_node(node)
        if node is not None:
            node.finish()
            if node.scheduling:  # Whatever holds the end up must not hold up others.
                node.scheduling.update(False)
            wait_for_all_acked(node, stop)
            end_after(_LEAVE, 1 if node.failure else status)
            node.destroy_node()
        rclpy.try_shutdown()
    return 1 if node.failure else 0


def wait_for_all_acked(node: Node, stop: Sequence[int]) -> None:
    """
    Wait until the last messages have arrived, but not for peers that were killed.

    A signal leaves little time for it; at an end of its own a node has enough, for what was lost
    on the way is sent again only now and then.
    """
    begin = time.monotonic()
    for publisher in list(node.publishers):
        while True:
            left = begin + (_FAREWELL if stop else _PATIENCE) - time.monotonic()
            if publisher.wait_for_all_acked(Duration(seconds=min(max(0.0, left), _SLICE))):
                break
            if left <= 0.0:
                return


def _shown(value: object) -> str:
    return f'{value:.4g}' if isinstance(value, float) else str(value)
