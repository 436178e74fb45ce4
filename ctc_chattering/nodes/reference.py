"""The reference as a node: the desired motion, published ahead of time on the control grid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf, isfinite
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from ctc_chattering.core.grid import NANOSECONDS, period_ns, seconds
from ctc_chattering.core.limits import check_limits, Limits
from ctc_chattering.core.parameters import Config
from ctc_chattering.core.reference import make_motion, ReferenceConfig, shortest
from ctc_chattering.core.smooth_start import Motion, smooth_start, Transition
from ctc_chattering.core.trajectory import Point
from ctc_chattering.core.waypoints import Route, Waypoints
from ctc_chattering.errors import CtcError
from ctc_chattering.graph import CLOCK, JOINT_STATES, JOINT_TRAJECTORY, REFERENCE
from ctc_chattering.nodes.description import Description
from ctc_chattering.nodes.inbox import Inbox, PATIENCE, Refused
from ctc_chattering.nodes.parameters import NodeParameters
from ctc_chattering.nodes.runtime import qos, Shell, Status
from ctc_chattering.real_time import RealTime
from ctc_chattering.ros.messages import LATEST, read_clock
from ctc_chattering.ros.serialization import (
    State,
    StateReader,
    TrajectoryChunk,
    TrajectoryReader,
    TrajectoryWriter,
)
from ctc_chattering.settings import RealTimeSettings, ReferenceSettings
from ctc_chattering.trajectory_file import read_trajectory

#: Without a start duration: time over which waypoints that begin in the past are joined, and over
#: which the motion passes into one with changed parameters [s].
_JOIN, _CHANGE = 0.5, 2.0
#: Time between two attempts to begin, where the start is refused [ns].
_RETRY = 5 * NANOSECONDS
#: A stamp that is further from the node's clock is from another clock, or wrong [ns].
_IN_STEP = NANOSECONDS // 4


class ReferenceNode(Shell):
    """
    Publishes pieces of the motion, each before it is needed.

    Where somebody publishes ``clock``, the motion is a function of that time; otherwise of the
    node clock's time since the first joint state seen while somebody listened, in terms of the
    stamps of the states, whatever clock they are from. Waypoints that come on
    ``~/joint_trajectory`` take the place of the motion, and a sinusoid whose parameters are set
    takes theirs: it passes from one into the other without a jump.
    """

    def __init__(self) -> None:
        super().__init__('reference')
        self._tuning = NodeParameters(
            self, (ReferenceConfig, ReferenceSettings, RealTimeSettings), self._on_change,
            self._check)
        config = self._tuning.get(ReferenceConfig)
        self._settings = self._tuning.get(ReferenceSettings)
        self.scheduling = RealTime(self._tuning.get(RealTimeSettings))
        self._route = None
        if config.trajectory_file:
            self._route = read_trajectory(Path(config.trajectory_file), config.joint_names)
        self._limits: Limits | None = None
        #: Why the motion does not begin, and when to try again [ns].
        self._refusal, self._retry = '', 0
        #: Parameters of the sinusoid that the motion has, or passes into, and since when [ns].
        self._shape, self._in_force = _shape(config), 0
        self._motion: Motion | None = None
        self._period = period_ns(config.control_period)
        horizon = round(self._settings.horizon * NANOSECONDS)
        self._ahead = max(4, horizon // self._period)
        self._piece = self._ahead // 4
        self._writer = TrajectoryWriter(config.joint_names, self._piece, self._period)
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
            self, Clock, CLOCK, read_clock, self._on_clock, qos(), trusting=True,
            plausible=self._is_next, lapse=PATIENCE)
        self._states: Inbox[State] | None = None
        self._route_inbox = Inbox(
            self, JointTrajectory, f'~/{JOINT_TRAJECTORY}', TrajectoryReader().read,
            self._on_route, qos(10))
        self.inboxes = [self._clock_inbox, self._route_inbox]
        self._description = Description(
            self, config.described, config.description, self._begin)

    @property
    def _config(self) -> ReferenceConfig:
        return self._tuning.get(ReferenceConfig)

    def _begin(self, description: str) -> None:
        """Know the limits, and make the motion if the robot's state is not needed for it."""
        config = self._config
        if description:
            self._limits = Limits(description, config.joint_names)
        self._prepare()

    def _prepare(self) -> None:
        """Make the motion, if it does not depend on the robot's state."""
        if self._motion is None and not self._from_state:
            self._motion = make_motion(self._config, limits=self._limits)
            self._shape = _shape(self._config)

    @property
    def _from_state(self) -> bool:
        """Whether the motion begins where the robot is."""
        return self._route is not None or self._config.start_duration > 0.0

    def _check(self, configs: Sequence[Config]) -> None:
        """Raise `CtcError` if a set would lead beyond the limits."""
        for config in configs:
            if isinstance(config, ReferenceConfig) and not config.trajectory_file:
                make_motion(config.changed({'start_duration': 0.0}), limits=self._limits)

    def _on_change(self) -> None:
        """Try again to begin, where that was refused; `_extend` sees what else has changed."""
        self._settings = self._tuning.get(ReferenceSettings)
        self._retry = 0
        if self._limits is not None or not self._config.described:
            self._prepare()
            self._description.problem = self._refusal = ''

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
                self, JointState, JOINT_STATES, StateReader().read, self._on_state, qos(10),
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
        if self._description.problem:
            return Status(DiagnosticStatus.ERROR, self._description.problem, {})
        if self._refusal:
            return Status(DiagnosticStatus.ERROR, self._refusal, {})
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
        if now > LATEST:
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

    def _on_state(self, state: State, _arrival: int) -> None:
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
        if self._motion is None and not self._description.problem:
            self._begin_at(state, t)

    def _begin_at(self, state: State, t: int) -> None:
        """Begin the motion where the robot is, unless that is beyond the limits."""
        now = time.monotonic_ns()
        if now < self._retry:
            return
        velocities = state.velocity or (0.0,) * len(state.position)
        start = {name: (q, dq) for name, q, dq in zip(
            state.names, state.position, velocities) if isfinite(q + dq)}
        try:
            self._motion = make_motion(self._config, self._route, start, t, self._limits)
            self._shape, self._refusal = _shape(self._config), ''
        except CtcError as error:
            self._refusal, self._retry = str(error), now + _RETRY
            self.get_logger().error(self._refusal)

    def _is_in_step(self, t: int, now: int) -> bool:
        """
        Return whether a stamp goes with the node's clock at `now` [ns].

        Before the start a source may show that its stamps are from another clock, by states that
        keep the same distance from ours for a while.
        """
        lead = t - now
        if abs(lead - self._lead) < _IN_STEP:
            return True
        if self._start is None and 0 <= t <= LATEST:
            other, since = self._other
            if abs(lead - other) >= _IN_STEP:
                self._other = lead, now
            elif now - since > _IN_STEP:
                self._lead = lead
                return True
        return False

    def _on_route(self, piece: TrajectoryChunk, _arrival: int) -> None:
        """Go through waypoints, after what has been published already."""
        if self._now is None or self._motion is None:
            raise Refused('early', 'the motion has not begun')
        begin = self._after_published()
        stamped = piece.start != 0
        shift = self._lead - (self._start or 0) if stamped else begin
        try:
            route = Route(*piece[:3])._replace(times=[t + shift for t in piece.times]).ordered(
                self._config.joint_names)
            before = self._motion
            if isinstance(before, _Then) and before.begin == begin:
                before = before.before  # What was to come at that instant never does.
            self._motion = _Then(before, begin, self._through(route, begin, before.at(begin)))
        except CtcError as error:
            raise Refused('waypoints', str(error)) from None
        self._next = begin // self._period

    def _through(self, route: Route, begin: int, state: Point) -> Motion:
        """Return the way from a state at `begin` [ns] through waypoints, some past, maybe."""
        way = Waypoints(route.times, route.points, (begin, state))
        if self._limits is not None:
            check_limits('the motion', self._limits, way.extremes())
        if route.times[0] > begin:
            return way
        return self._fitting(
            lambda duration: smooth_start(way, begin, state, duration), begin, _JOIN)

    def _change(self) -> None:
        """Have the motion pass into the one that is set now, after what has been published."""
        assert self._motion is not None and self._now is not None
        before, after = self._motion, make_motion(self._config.changed({'start_duration': 0.0}))
        begin = self._after_published()
        self._motion = self._fitting(
            lambda duration: Transition(before, after, begin, duration), begin, _CHANGE)
        self._shape, self._in_force = _shape(self._config), begin
        self._next = begin // self._period

    def _after_published(self) -> int:
        """Return an instant that the controller surely hears of in time [ns]."""
        assert self._now is not None
        return (self._now // self._period + self._piece) * self._period

    def _fitting(self, make: Callable[[float], Transition], begin: int, least: float
                 ) -> Transition:
        """Return a transition that lasts `start_duration`, or longer if the limits ask for it."""
        duration = self._config.start_duration or least
        if self._limits is None:
            return make(duration)
        longer = shortest(make, begin, duration, self._limits)
        return make(longer if longer < inf else duration)

    def _extend(self) -> None:
        """Publish pieces until the motion is known far enough ahead."""
        if self._now is None or self._motion is None or not self._subscribers:
            return
        if isinstance(self._motion, _Then) and self._now > self._motion.begin:
            self._motion = self._motion.after
        if isinstance(self._motion, Transition) and self._now >= self._motion.end:
            self._motion = self._motion.after
        if (self._shape != _shape(self._config) and self._route is None
                and not isinstance(self._motion, (_Then, Transition))):
            self._change()
        if self._tuning.news:
            if not self.heard((self._publisher,), self._settings.wait_for):
                return
            self._tuning.announce((self._start or 0) + self._in_force)
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
        self.before, self.begin, self.after = before, begin, after

    def at(self, t: int) -> Point:
        return (self.before if t < self.begin else self.after).at(t)


def _shape(config: ReferenceConfig) -> tuple[tuple[float, ...], ...]:
    """Return the parameters of the sinusoid."""
    return config.center, config.amplitude, config.frequency, config.phase


#: What the executable runs.
NODE = ReferenceNode
