"""The simulated robot as a node: torques in, joint states out."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
import time

from diagnostic_msgs.msg import DiagnosticStatus
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from ctc_chattering.core.command_watchdog import CommandWatchdog
from ctc_chattering.core.grid import NANOSECONDS, period_ns, samples, seconds
from ctc_chattering.core.model import Vector
from ctc_chattering.core.plant import PlantConfig
from ctc_chattering.core.plants import limits_of, make_plant
from ctc_chattering.core.robot import Robot
from ctc_chattering.core.ticks import Ticks
from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.graph import CLOCK, COMMANDS, JOINT_STATES
from ctc_chattering.nodes.description import Description
from ctc_chattering.nodes.inbox import Inbox, LAPSE, PATIENCE, Refused
from ctc_chattering.nodes.joints import Joints
from ctc_chattering.nodes.parameters import NodeParameters
from ctc_chattering.nodes.runtime import qos, Shell, Status
from ctc_chattering.real_time import RealTime
from ctc_chattering.ros.messages import stamp
from ctc_chattering.ros.serialization import EffortReader, Efforts, StateWriter
from ctc_chattering.settings import PlantSettings, RealTimeSettings

#: Periods that one tick of the real-time clock makes good at the most.
_CATCH_UP = 100
#: Lockstep: time after which a state without an answer is sent again, and after which the node
#: says what it waits for [ns].
_REPEAT, _SAY = NANOSECONDS // 5, 3 * NANOSECONDS
#: Real time: silence of commands that is reported as an error at once [ns].
_SILENCE = NANOSECONDS // 2


class PlantNode(Shell):
    """
    Publishes the robot's state and holds the torques it is sent.

    In lockstep a state is followed by the next one as soon as its answer has come, and time is
    simulated. In real time the node's clock paces it; the robot stands still until the first
    torque comes, and is braked when no more come.
    """

    def __init__(self) -> None:
        super().__init__('plant')
        self._tuning = NodeParameters(
            self, (PlantConfig, PlantSettings, RealTimeSettings), self._on_change)
        config, self._settings = self._tuning.get(PlantConfig), self._tuning.get(PlantSettings)
        self.scheduling = RealTime(self._tuning.get(RealTimeSettings))
        if config.pacing == 'real_time' and self.get_parameter('use_sim_time').value:
            raise UsageError('use_sim_time: true contradicts real_time, the pacing: the plant '
                             'gives the time itself, in lockstep on clock')
        self._plant: Robot | None = None
        self._period = period_ns(config.control_period)
        self._last = samples(config.duration, self._period)
        self._clock_every = max(1, round(
            self._settings.clock_period * NANOSECONDS / self._period))
        self._joints = Joints(config.joint_names)
        self._names = config.joint_names
        self._n = len(self._names)
        self._rest: Vector = (0.0,) * self._n
        self._latest: Vector = self._rest
        self._begun = self._held = False
        self._subscribers = [0, 0]
        #: Time of sample 0 [ns]; that of lockstep is 0.
        self._start = 0
        self._ticks = Ticks(self._period)
        self._asked = self._repeated = self._said = time.monotonic_ns()
        #: Times that the last state was sent again, and answers more than one that the state
        #: before may still get.
        self._repeats = self._surplus = 0
        #: Real time: when the first state was sent after which no torque has come yet [ns].
        self._sent: int | None = None
        self._labels: Sequence[str] = ()
        self._watchdog = CommandWatchdog(self._period)
        self._said_silent = False
        self._set_timeout()
        self._writer = StateWriter(config.joint_names)
        lockstep = self.hurried = config.pacing == 'lockstep'
        # The clock first: who hears of it knows that a state can wait.
        self._ticker = self.create_publisher(Clock, CLOCK, qos()) if lockstep else None
        self._states = self.create_publisher(JointState, JOINT_STATES, qos())
        self._description = Description(
            self, config.described, config.description, self._begin)

    def _begin(self, description: str) -> None:
        """Make the robot, and begin to listen."""
        config = self._tuning.get(PlantConfig)
        self._plant = make_plant(config, description)
        self._limits = limits_of(config, description)
        lockstep = self._ticker is not None
        self._inbox = Inbox(
            self, Float64MultiArray, COMMANDS, EffortReader().read,
            self._on_answer if lockstep else self._on_command, qos(),
            trusting=lockstep, plausible=self._is_like_the_last,
            lapse=PATIENCE if lockstep else LAPSE)
        self.inboxes = [self._inbox]
        if not lockstep:
            self._timer = self.create_timer(seconds(self._period), self._on_tick)

    def introduction(self) -> str:
        """Return what moves the robot, and what comes first."""
        config = self._tuning.get(PlantConfig)
        first = COMMANDS if self._ticker is None else f'those who are to hear {JOINT_STATES}'
        waits = self._description.problem or f'waits for {first}'
        return (f'simulated robot, {config.plant_backend}, model {config.model}, '
                f'{", ".join(config.joint_names)}, {config.pacing}, '
                f'{1 / config.control_period:g} Hz; {waits}')

    @property
    def _robot(self) -> Robot:
        """The robot, once there is one."""
        assert self._plant is not None
        return self._plant

    @property
    def in_real_time(self) -> bool:
        """Whether the node's clock paces it."""
        return self._ticker is None

    def idle(self) -> None:
        """Begin once all are there; repeat the last message for those who came late."""
        if self._ticker is None or self._plant is None:
            return
        now = time.monotonic_ns()
        counts = [p.get_subscription_count() for p in (self._states, self._ticker)]
        if not self._begun:
            if counts[0] and self.heard((self._states, self._ticker), self._settings.wait_for):
                self._begun = True
                self._publish_sample()
        else:
            if counts[1] > self._subscribers[1]:
                self._publish_clock()
            if now - max(self._asked, self._repeated) > _REPEAT and not self._held:
                self._repeated = now
                self._repeats += 1
                self._publish_clock()
                self._publish_state()
        self._subscribers = counts
        if not self._held and now - max(self._asked, self._said) > _SAY:
            self._said = now
            self.get_logger().info(f'waiting for {self._awaited()}')

    def _awaited(self) -> str:
        """Return what simulated time waits for."""
        if not self._begun:
            return f'those who are to hear {JOINT_STATES}'
        publishers = ', '.join(self._inbox.publishers())
        return (f'the answer on {COMMANDS} to the state at t = {self._robot.t:g} s; '
                + (f'published by {publishers}' if publishers else 'nobody publishes there'))

    def status(self) -> Status:
        """Return what the plant does and why."""
        if self._plant is None:
            return Status(DiagnosticStatus.ERROR, self._description.problem, {})
        level, message = DiagnosticStatus.OK, 'running'
        if self._ticker is not None:
            waiting = time.monotonic_ns() - self._asked
            if self._held:
                message = f'held at t = {self._plant.t:g} s'
            elif waiting > NANOSECONDS:
                level, message = DiagnosticStatus.WARN, (
                    f'waiting for {self._awaited()}, for {waiting / NANOSECONDS:.0f} s')
        elif self._plant.braking:
            level, message = DiagnosticStatus.ERROR, (
                f'no command for {seconds(self._watchdog.timeout):g} s; torque 0, brakes on')
        elif not self._begun:
            level, message = DiagnosticStatus.WARN, f'waiting for {COMMANDS}'
        if self._limits is not None and (beyond := self._limits.excess(
                [(self._plant.q, self._plant.dq, ())])):
            level, message = max(level, DiagnosticStatus.WARN), f'{message}; {beyond}'
        values = {'pacing': self._plant.config.pacing, 'time of the run [s]': self._plant.t}
        return Status(level, message, values) if self._ticker else self._real_time_status(
            level, message, values)

    def _real_time_status(self, level: bytes, message: str, values: dict[str, object]) -> Status:
        """Return a status with how well commands keep up with the samples."""
        watchdog = self._watchdog
        watchdog.rotate(time.monotonic_ns(), self._robot.k)
        if level == DiagnosticStatus.OK and watchdog.poor:
            level = DiagnosticStatus.ERROR if watchdog.bad else DiagnosticStatus.WARN
            message = f'running, but {watchdog}'
        watchdog.longest = 0
        return Status(level, message, {
            **values, 'timeouts, command': watchdog.timeouts,
            'timeouts, command, per second': watchdog.timeouts_per_second,
            'samples without a new command [%]': 100.0 * watchdog.fraction})

    def _on_change(self) -> None:
        self._settings = self._tuning.get(PlantSettings)
        self._set_timeout()
        if self._plant is not None:
            self._plant.configure(self._tuning.get(PlantConfig))
        if self._held:
            self._held = False
            self._publish_sample()

    # Lockstep.

    def _on_answer(self, efforts: Efforts, now: int) -> None:
        tau = self._torques(efforts)
        self._labels = efforts.names
        plant = self._robot
        if not self._begun or self._held:
            return
        if self._surplus and tau == self._latest:
            self._surplus -= 1
            return
        self._latest, self._surplus, self._repeats = tau, self._repeats, 0
        self.pace.answer(self._asked, now)
        if plant.k == self._last and self._last:
            self._end()
            return
        if self._step(tau):
            self.pace.sample(now, time.monotonic_ns())
            self._publish_sample()

    def _publish_sample(self) -> None:
        hold, k = self._settings.hold_at, self._robot.k
        if hold and self._robot.t >= hold:
            self._held = True
            self._publish_clock()
            return
        self._asked = time.monotonic_ns()
        self._publish_state()
        if k % self._clock_every == 0 or k == self._last:
            self._publish_clock()
        if self._tuning.news:
            self._tuning.announce(k * self._period)

    def _publish_clock(self) -> None:
        assert self._ticker is not None
        self._ticker.publish(Clock(clock=stamp(self._robot.k * self._period)))

    # Real time.

    def _on_command(self, efforts: Efforts, now: int) -> None:
        self._latest = self._torques(efforts)
        self._labels = efforts.names
        silence = self._watchdog.command(now)
        if self._sent is not None:
            self.pace.answer(self._sent, now)
            self._sent = None
        if not self._begun:
            self._begun = True
            if self._ticks.start is None:
                self._anchor()
            self._tuning.announce(self._start)
        if self._robot.braking:
            self._robot.braking = False
            if self._said_silent:
                self.get_logger().info(f'{COMMANDS}: commands again, brakes off')
            else:
                self.get_logger().warning(
                    f'{COMMANDS}: no command for {seconds(silence):.3f} s; torque 0 and brakes '
                    f'after {seconds(self._watchdog.timeout):g} s', throttle_duration_sec=1.0)
            self._said_silent = False

    def _on_tick(self) -> None:
        begin = time.monotonic_ns()
        plant = self._robot
        now = self.get_clock().now().nanoseconds
        if not self._begun:
            self._anchor()
        else:
            self._watch(begin)
            due = self._ticks.due(now, plant.k)
            self.pace.misses += max(0, due - 1)
            for _ in range(min(due, _CATCH_UP)):
                if plant.k == self._last and self._last:
                    self._end()
                    return
                self._watchdog.sample()
                if not self._step(self._latest):
                    return
            if due > _CATCH_UP or due < -_CATCH_UP:  # The process stood still, or the clock leapt.
                self._anchor()
            if self._tuning.news:
                self._tuning.announce(self._start + plant.k * self._period)
            if due < 1:
                return
        self._publish_state()
        end = time.monotonic_ns()
        self.pace.sample(begin, end)
        if self._sent is None and self._begun and not plant.braking:
            self._sent = end

    def _anchor(self) -> None:
        """Have the present sample be that of the tick that was due last."""
        now = self.get_clock().now().nanoseconds  # Of just now, as what is left from then on.
        self._start = self._ticks.anchor(now, self._timer.time_until_next_call(), self._robot.k)

    def _set_timeout(self) -> None:
        self._watchdog.timeout = max(
            round(self._settings.command_timeout * NANOSECONDS), 3 * self._period)

    def _watch(self, now: int) -> None:
        """Brake when no command has come for too long."""
        silence = self._watchdog.silence(now)
        if silence > self._watchdog.timeout and not self._robot.braking:
            self._robot.braking = True
            self._latest, self._sent = self._rest, None
        if silence > max(_SILENCE, self._watchdog.timeout) and not (
                self._said_silent or self.stop):
            self._said_silent = True
            self.get_logger().error(
                f'{COMMANDS}: no command for {seconds(silence):.1f} s; torque 0, brakes on')

    # Both.

    def _step(self, tau: Vector) -> bool:
        """Go on by one period; return whether the robot still has a motion, and end if not."""
        if self.failure is not None:
            return False
        try:
            self._robot.step(tau)
        except CtcError as error:
            self.failure = str(error)
            self._watchdog.rotate(time.monotonic_ns(), self._robot.k)
            if self._ticker is None and self._watchdog.poor:
                self.failure += f'; {self._watchdog}'
            self.get_logger().fatal(self.failure)
            self.done.set_result(None)
        return self.failure is None

    def _publish_state(self) -> None:
        plant = self._robot
        self._states.publish(self._writer.write(
            self._start + plant.k * self._period, *plant.measured, plant.applied))

    def _is_like_the_last(self, efforts: Efforts) -> bool:
        """Return whether torques come with the labels of those taken last, and can be used."""
        try:
            return efforts.names == self._labels and bool(self._torques(efforts))
        except Refused:
            return False

    def _torques(self, efforts: Efforts) -> Vector:
        """Return the torques of a message in our order."""
        names, values = efforts
        names = names or self._names
        pick = self._joints.pick(names)
        if pick is None:
            raise Refused('joints', f'torques for joints {list(names)}; needed: each of '
                          f'{list(self._names)} once, or no labels')
        if len(values) != len(names):
            raise Refused('length', f'{len(values)} torques for {len(names)} joints')
        tau = pick(values)
        if not isfinite(sum(tau)):
            raise Refused('not_finite', f'{list(tau)}')
        return tau

    def _end(self) -> None:
        if not self.done.done():
            self.get_logger().info(
                f'the experiment has ended at t = {self._robot.t:g} s after '
                f'{self._robot.k + 1} samples')
            self.done.set_result(None)


#: What the executable runs.
NODE = PlantNode
