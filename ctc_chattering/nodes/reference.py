"""The reference as a node: the desired motion, published ahead of time on the control grid."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from ctc_chattering import wire
from ctc_chattering.core.blend import Blend, Motion
from ctc_chattering.core.grid import NANOSECONDS, period_ns, seconds
from ctc_chattering.core.reference import make_motion, ReferenceConfig
from ctc_chattering.core.trajectory import Point
from ctc_chattering.core.waypoints import Route, Waypoints
from ctc_chattering.errors import ParameterError
from ctc_chattering.graph import CLOCK, JOINT_STATES, JOINT_TRAJECTORY, REFERENCE
from ctc_chattering.nodes.inbox import Inbox, PATIENCE, Refused
from ctc_chattering.nodes.parameters import NodeParameters
from ctc_chattering.nodes.runtime import qos, Shell, Status
from ctc_chattering.real_time import RealTime
from ctc_chattering.settings import RealTimeSettings, ReferenceSettings
from ctc_chattering.trajectory_file import read_trajectory

#: Time over which waypoints that begin in the past are joined, without a start duration [s].
_BLEND = 0.5
#: A stamp that is further from the node's clock is from another clock, or wrong [ns].
_IN_STEP = NANOSECONDS // 4


class ReferenceNode(Shell):
    """
    Publishes pieces of the motion, each before it is needed.

    Where somebody publishes ``clock``, the motion is a function of that time; otherwise of the
    node clock's time since the first joint state seen while somebody listened, in terms of the
    stamps of the states, whatever clock they are from. Waypoints that come on
    ``~/joint_trajectory`` take the place of the motion.
    """

    def __init__(self) -> None:
        super().__init__('reference')
        self._tuning = NodeParameters(
            self, (ReferenceConfig, ReferenceSettings, RealTimeSettings), lambda: None)
        config = self._tuning.get(ReferenceConfig)
        self._settings = self._tuning.get(ReferenceSettings)
        self.scheduling = RealTime(self._tuning.get(RealTimeSettings))
        self._route = None
        if config.trajectory_file:
            self._route = read_trajectory(Path(config.trajectory_file), config.joint_names)
        self._from_state = self._route is not None or config.start_duration > 0.0
        self._config = config
        self._motion: Motion | None = None if self._from_state else make_motion(config)
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
        #: What the states' stamps are ahead of the node's clock, where that matters [ns].
        self._lead = 0
        #: The same of another clock that states seem to be from, and since when that is so [ns].
        self._other = 0, 0
        self._next = self._pieces = 0
        self._subscribers = 0
        self._clock_inbox = Inbox(
            self, Clock, CLOCK, wire.read_clock, self._on_clock, qos(), trusting=True,
            plausible=self._is_next, lapse=PATIENCE)
        self._states: Inbox[wire.State] | None = None
        self._route_inbox = Inbox(
            self, JointTrajectory, f'~/{JOINT_TRAJECTORY}', wire.TrajectoryReader().read,
            self._on_route, qos(10))
        self.inboxes = [self._clock_inbox, self._route_inbox]

    def spin(self, executor: Any) -> None:
        """Take what has come, in batches: the horizon is long enough."""
        self.spin_in_batches(executor)

    @property
    def in_real_time(self) -> bool:
        """Whether the motion follows real time."""
        return self._start is not None and not self._simulated

    def introduction(self) -> str:
        """Return the motion, and what begins it."""
        config = self._config
        motion = config.trajectory_file or 'sinusoid'
        start = (f', smooth start of {config.start_duration:g} s' if config.start_duration > 0.0
                 else '')
        return (f'motion {motion}{start}, {", ".join(config.joint_names)}; waits for '
                f'{JOINT_STATES} or {CLOCK}')

    def idle(self) -> None:
        """Publish what the node's own clock asks for, and again for a new subscriber."""
        begun = self._start is not None and self._motion is not None
        if self._states is None and not begun:
            self._states = Inbox(
                self, JointState, JOINT_STATES, wire.StateReader().read, self._on_state, qos(10),
                lambda state: not self._mine.isdisjoint(state.names))
        elif self._states is not None and begun:
            self._states.subscription.destroy()
            self._states = None
        if self._start is not None and not self._simulated:
            self._advance(self.get_clock().now().nanoseconds + self._lead - self._start)
        count = self._publisher.get_subscription_count()
        if count > self._subscribers and self._now is not None:
            self._next = self._now // self._period
        self._subscribers = count
        self._extend()

    def status(self) -> Status:
        """Return what the motion does."""
        if self._now is None or self._motion is None:
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
        if self._simulated and now == self._now:
            # Time stands still, maybe because what was published has not been taken.
            self._next = now // self._period
        self._simulated, self._start = True, 0
        self._advance(now)
        self._extend()

    def _advance(self, now: int) -> None:
        """Note the time of the motion [ns]; if it went back, begin anew from there."""
        if self._now is not None and now < self._now:
            self._next = now // self._period
            if self._from_state:
                self._motion = None
        self._now = now

    def _on_state(self, state: wire.State, _arrival: int) -> None:
        t = state.t
        if self.count_publishers(CLOCK) == 0:
            if not self._publisher.get_subscription_count() or not self.heard(
                    (self._publisher,), self._settings.wait_for):
                return
            if not self._is_in_step(t, self.get_clock().now().nanoseconds):
                return
            if self._start is None:
                self._start = t
            t -= self._start
        if self._motion is None:
            velocities = state.velocity or (0.0,) * len(state.position)
            start = {name: (q, dq) for name, q, dq in zip(
                state.names, state.position, velocities) if isfinite(q + dq)}
            self._motion = make_motion(self._config, self._route, start, t)

    def _is_in_step(self, t: int, now: int) -> bool:
        """
        Return whether a stamp goes with the node's clock at `now` [ns].

        Before the start a source may show that its stamps are from another clock, by states that
        keep the same distance from ours for a while.
        """
        lead = t - now
        if abs(lead - self._lead) < _IN_STEP:
            return True
        if self._start is None and 0 <= t <= wire.LATEST:
            other, since = self._other
            if abs(lead - other) >= _IN_STEP:
                self._other = lead, now
            elif now - since > _IN_STEP:
                self._lead = lead
                return True
        return False

    def _on_route(self, piece: wire.Piece, _arrival: int) -> None:
        """Go through waypoints, after what has been published already."""
        if self._now is None or self._motion is None:
            raise Refused('early', 'the motion has not begun')
        begin = (self._now // self._period + self._piece) * self._period
        stamped = piece.start != 0
        shift = self._lead - (self._start or 0) if stamped else begin
        try:
            route = Route(*piece[:3])._replace(times=[t + shift for t in piece.times]).ordered(
                self._config.joint_names)
            before = self._motion.at(begin)
            self._motion = _Then(self._motion, begin, _through(
                route, begin, before, self._config.start_duration))
        except ParameterError as error:
            raise Refused('waypoints', str(error)) from None
        self._next = begin // self._period

    def _extend(self) -> None:
        """Publish pieces until the motion is known far enough ahead."""
        if self._now is None or self._motion is None or not self._subscribers:
            return
        if isinstance(self._motion, _Then) and self._now > self._motion.begin:
            self._motion = self._motion.after
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
        assert self._motion is not None
        self._pieces += 1
        self._publisher.publish(self._writer.write(
            (self._start or 0) + first * self._period,
            [self._motion.at((first + k) * self._period) for k in range(self._piece)]))


class _Then:
    """One motion until an instant, and another one from there on."""

    def __init__(self, before: Motion, begin: int, after: Motion) -> None:
        self._before, self.begin, self.after = before, begin, after

    def at(self, t: int) -> Point:
        return (self._before if t < self.begin else self.after).at(t)


def _through(route: Route, begin: int, state: Point, duration: float) -> Motion:
    """Return the way from a state at `begin` [ns] through waypoints, some of them past, maybe."""
    if route.times[0] > begin:
        return Waypoints(route.times, route.points, start=(begin, state))
    q, dq, ddq = state
    return Blend(Waypoints(route.times, route.points), begin, q, dq, duration or _BLEND, ddq)


#: What the executable runs.
NODE = ReferenceNode
