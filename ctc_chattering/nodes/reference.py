"""The reference as a node: the desired motion, published ahead of time on the control grid."""

from __future__ import annotations

import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from ctc_chattering import wire
from ctc_chattering.core.grid import NANOSECONDS, period_ns, seconds
from ctc_chattering.core.reference import ReferenceConfig, Sinusoid
from ctc_chattering.graph import CLOCK, JOINT_STATES, REFERENCE
from ctc_chattering.nodes.inbox import Inbox, Refused
from ctc_chattering.nodes.parameters import NodeParameters
from ctc_chattering.nodes.runtime import qos, run, Shell, Status
from ctc_chattering.settings import ReferenceSettings


class ReferenceNode(Shell):
    """
    Publishes pieces of the motion, each before it is needed.

    Where somebody publishes ``clock``, the motion is a function of that time; otherwise of the
    node clock's time since the first joint state seen.
    """

    def __init__(self) -> None:
        super().__init__('reference')
        self._tuning = NodeParameters(
            self, (ReferenceConfig, ReferenceSettings), lambda: None)
        config = self._tuning.get(ReferenceConfig)
        self._settings = self._tuning.get(ReferenceSettings)
        self._motion = Sinusoid(config)
        self._period = period_ns(config.control_period)
        horizon = round(self._settings.horizon * NANOSECONDS)
        self._ahead = max(4, horizon // self._period)
        self._piece = self._ahead // 4
        self._writer = wire.TrajectoryWriter(config.joint_names, self._piece, self._period)
        self._publisher = self.create_publisher(JointTrajectory, REFERENCE, qos())
        self._simulated = False
        self._mine = frozenset(config.joint_names)
        self._start: int | None = None
        self._now: int | None = None
        self._next = self._pieces = 0
        self._subscribers = 0
        self._clock_inbox = Inbox(
            self, Clock, CLOCK, wire.read_clock, self._on_clock, qos(), plausible=self._is_next)
        self._states: Inbox[wire.State] | None = Inbox(
            self, JointState, JOINT_STATES, wire.StateReader().read, self._on_state, qos(10),
            lambda state: not self._mine.isdisjoint(state.names))
        self.inboxes = [self._clock_inbox]

    def spin(self, executor: Any) -> None:
        """Take what has come, in batches: the horizon is long enough."""
        self.spin_in_batches(executor)

    def idle(self) -> None:
        """Publish what the node's own clock asks for, and again for a new subscriber."""
        if self._states is not None and self._start is not None:
            self.destroy_subscription(self._states.subscription)
            self._states = None
        if self._start is not None and not self._simulated:
            self._advance(self.get_clock().now().nanoseconds - self._start)
        count = self._publisher.get_subscription_count()
        if count > self._subscribers and self._now is not None:
            self._next = self._now // self._period
        self._subscribers = count
        self._extend()

    def status(self) -> Status:
        """Return what the motion does."""
        if self._now is None:
            return Status(DiagnosticStatus.WARN, f'waiting for {JOINT_STATES} or {CLOCK}', {})
        values = {'time of the motion [s]': seconds(self._now), 'published pieces': self._pieces,
                  'time': 'simulated' if self._simulated else 'real'}
        if not self._subscribers:
            return Status(DiagnosticStatus.WARN, f'nobody listens to {REFERENCE}', values)
        return Status(DiagnosticStatus.OK, 'running', values)

    def _is_next(self, now: int) -> bool:
        """Return whether a time is within the motion that is published already."""
        return self._now is not None and self._now <= now < self._next * self._period

    def _on_clock(self, now: int, _arrival: int) -> None:
        if self._start is not None and not self._simulated:
            raise Refused('real_time', 'the motion follows real time since its start')
        if now > wire.LATEST:
            raise Refused('stamp', f'no time is as late as {seconds(now):.9f} s')
        self._simulated, self._start = True, 0
        self._advance(now)
        self._extend()

    def _advance(self, now: int) -> None:
        """Note the time of the motion [ns]; if it went back, publish from there anew."""
        if self._now is not None and now < self._now:
            self._next = now // self._period
        self._now = now

    def _on_state(self, state: wire.State, _arrival: int) -> None:
        if self.count_publishers(CLOCK) > 0:
            return
        now = self.get_clock().now().nanoseconds
        self._start = state.t if abs(state.t - now) < NANOSECONDS else now

    def _extend(self) -> None:
        """Publish pieces until the motion is known far enough ahead."""
        if self._now is None or not self._subscribers:
            return
        if self._tuning.news:
            if not self.heard((self._publisher,), self._settings.wait_for):
                return
            self._tuning.announce(self._start or 0)
        first = self._now // self._period
        self._next = max(self._next, first)
        while self._next < first + self._ahead:
            self._publish(self._next)
            self._next += self._piece

    def _publish(self, first: int) -> None:
        """Publish a piece from grid index `first` on."""
        self._pieces += 1
        self._publisher.publish(self._writer.write(
            (self._start or 0) + first * self._period,
            [self._motion.at(seconds((first + k) * self._period))
             for k in range(self._piece)]))


def main() -> int:
    """Run the node."""
    return run(ReferenceNode, 'reference')


if __name__ == '__main__':
    sys.exit(main())
