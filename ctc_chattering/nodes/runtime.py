"""The shell around every node: start, bounded spinning, signals, an end without a traceback."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import itertools
from pathlib import Path
import sys
import time
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from ctc_chattering import params, signals
from ctc_chattering.errors import CtcError
from ctc_chattering.graph import TOPICS

try:
    from rclpy.experimental.events_executor import EventsExecutor as Executor
except ImportError:  # An rclpy from before it was there: slower, but the same.
    from rclpy.executors import SingleThreadedExecutor as Executor

__all__ = ['NAP', 'TICK', 'Executor', 'Shell', 'qos', 'run']

#: Longest time between two looks at signals and at `Shell.idle` [s]. It must be finite: see
#: docs/design.md.
TICK = 0.05
#: Sleep between two batches [s].
NAP = 0.02


def qos(depth: int = 1000, latched: bool = False) -> QoSProfile:
    """Return a reliable profile; `latched` keeps messages for those who subscribe later."""
    return QoSProfile(depth=depth, durability=(
        DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE))


class Shell(Node):
    """
    A node that `run` can drive.

    Attributes
    ----------
    done : Future
        Complete it to end the process with status 0.
    failure : str or None
        Set it to have the process end with status 1.

    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.done = Future()
        self.failure: str | None = None

    def idle(self) -> None:
        """Do what need not wait for a message; called at least every `TICK`."""

    def spin(self, executor: Any) -> None:
        """Serve callbacks for at most `TICK`."""
        executor.spin_until_future_complete(self.done, TICK)

    def spin_in_batches(self, executor: Any) -> None:
        """
        Serve what has come, then sleep: for nodes that nobody waits for.

        Woken for every message, such a node would take the processor away from the control loop;
        in batches a message costs half as much.
        """
        executor.spin_until_future_complete(self.done, 0.002)
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
            infos = self.get_subscriptions_info_by_topic(publisher.topic_name)
            if publisher.get_subscription_count() < len(infos):
                return False
            names = {info.node_name for info in infos}
            for topic in TOPICS.values():
                if publisher.topic_name.endswith('/' + topic.name) and not (
                        names >= set(wait_for) & set(topic.readers)):
                    return False
        return True


def run(make_node: Callable[[], Shell], name: str,
        argv: Sequence[str] | None = None) -> int:
    """
    Run a node until it is done, or SIGINT or SIGTERM comes.

    Parameters
    ----------
    make_node : callable
        Called after ROS is up.
    name : str
        The executable, for messages and for its section of the parameter files.
    argv : sequence of str, optional
        Arguments, with the program's name first; those of the process by default.

    Returns
    -------
    int
        Exit status: 0, or 1 after an error that has been reported on one line.

    """
    arguments = list(sys.argv if argv is None else argv)
    stop = signals.collect()
    node = executor = None
    try:
        for path in _params_files(arguments):
            sections = params.read(path)
            params.node_values(sections, name, str(path))
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        node = make_node()
        executor = Executor()
        executor.add_node(node)
        while not (stop or node.done.done()) and rclpy.ok():
            node.spin(executor)
            node.idle()
    except CtcError as error:
        print(f'{name}: {error}', file=sys.stderr, flush=True)
        return 1
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
            for publisher in list(node.publishers):
                publisher.wait_for_all_acked(Duration(seconds=0.3))
            node.destroy_node()
        rclpy.try_shutdown()
    return 1 if node.failure else 0


def _params_files(arguments: Sequence[str]) -> list[Path]:
    pairs = itertools.pairwise(arguments)
    return [Path(value) for flag, value in pairs if flag == '--params-file']
