"""The controller as a node: a joint state in, the torque that answers it out."""

from __future__ import annotations

from math import inf, isfinite
import time
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

from ctc_chattering.control.controller import Controller, ControllerConfig, Sample
from ctc_chattering.core import stamps
from ctc_chattering.core.cadence import Cadence
from ctc_chattering.core.grid import NANOSECONDS, period_ns, seconds
from ctc_chattering.core.guard import Guard
from ctc_chattering.core.model import Vector
from ctc_chattering.core.models import model_of
from ctc_chattering.core.rejoining import Rejoining
from ctc_chattering.core.state_health import BUSY, StateHealth
from ctc_chattering.core.term_saturation import TermSaturation
from ctc_chattering.core.trajectory import Point, Trajectory
from ctc_chattering.graph import (
    CLOCK,
    COMMANDS,
    FILTER,
    JOINT_STATES,
    REFERENCE,
    ROBOT_DESCRIPTION,
    TORQUES,
    TRACKING,
)
from ctc_chattering.nodes.description import Description
from ctc_chattering.nodes.inbox import Inbox, LAPSE, PATIENCE, Refused
from ctc_chattering.nodes.joints import Joints
from ctc_chattering.nodes.parameters import NodeParameters
from ctc_chattering.nodes.runtime import qos, Shell, Status, TICK
from ctc_chattering.real_time import RealTime
from ctc_chattering.ros.messages import LATEST
from ctc_chattering.ros.serialization import (
    EffortWriter,
    State,
    StateReader,
    StateWriter,
    TrajectoryChunk,
    TrajectoryReader,
)
from ctc_chattering.settings import ControllerSettings, RealTimeSettings

#: Why a stamp is refused.
_WRONG_STAMP = {
    stamps.REPEATED: 'the stamp repeats', stamps.BACKWARD: 'the stamp goes back',
    stamps.JUMP: 'the stamp leaps'}
#: Points of the reference that are kept while there is no state: a minute at 1 kHz.
_MOST_POINTS = 60_000
#: Real time: silence of the states that is reported as an error at once [ns]; a plant at its end
#: may take so long to leave.
_SILENCE = 2 * NANOSECONDS


class _State(NamedTuple):
    """A joint state that was taken: stamp [ns], arrival [ns], position and velocity."""

    t: int
    now: int
    q: Vector
    dq: Vector


class ControllerNode(Shell):
    """
    Answers every joint state with a torque, by the law (2) or (6).

    A state for which there is no reference yet waits for it. In real time it falls silent without
    states, and begins anew with the next one; simulated time can wait.
    """

    def __init__(self) -> None:
        super().__init__('controller')
        self._tuning = NodeParameters(
            self, (ControllerConfig, ControllerSettings, RealTimeSettings), self._on_change)
        config = self._tuning.get(ControllerConfig)
        self._settings = self._tuning.get(ControllerSettings)
        self.scheduling = RealTime(self._tuning.get(RealTimeSettings))
        self._controller: Controller | None = None
        self._guard = Guard(self._settings.enabled)
        self._watched = min(config.error_limit) < inf
        names = self._names = config.joint_names
        self._period = period_ns(config.control_period)
        self._timeout = max(
            round(self._settings.state_timeout * NANOSECONDS), 3 * self._period)
        self.tick = min(TICK, seconds(self._timeout) / 2)
        self._stamps = stamps.Stamps(self._timeout)
        self._cadence = Cadence(self._period)
        self._trajectory = Trajectory(round(self._settings.reference_timeout * NANOSECONDS))
        self._rejoining = Rejoining(self._trajectory)
        self._lags = [self._period * (i + 1) for i in range(config.input_delay)]
        self._state_joints, self._reference_joints = Joints(names), Joints(names)
        self._writer = EffortWriter(names)
        self._tracking_writer = StateWriter(
            [f'{j}/{x}' for x in ('desired', 'error') for j in names], ('position', 'velocity'))
        self._filter_writer = StateWriter(names, ('velocity',))
        self._torque_writer = StateWriter(
            [*(f'{j}/{x}' for x in ('inverse_dynamics', 'compensation', 'chattering')
               for j in names), 'V'], ('effort',))
        self._commands = self.create_publisher(Float64MultiArray, COMMANDS, qos())
        self._tracking, self._filter, self._torques = (
            self.create_publisher(JointState, f'~/{name}', qos())
            for name in (TRACKING, FILTER, TORQUES))
        self._count = 0
        self._heard = False
        self._waiting: _State | None = None
        #: The last state, if no torque can be computed for it with the parameters in force.
        self._beyond: _State | None = None
        #: The torque sent last; None where nothing has been sent, or a last one of 0.
        self._held: Vector | None = None
        #: Whether somebody publishes the clock, and whether somebody did at the last state.
        self._clock_heard = self._simulated = False
        self._arrived = 0
        #: Stamp of the last state taken [ns].
        self._last = 0
        #: States taken so far.
        self._taken = 0
        self._seen = False
        self._lost = False
        self._late = False
        self._said_silent = False
        self._saturated = self._restarts = 0
        self._health = StateHealth(self._period)
        self._term_saturation = TermSaturation(len(names))
        self._timeouts = {'state': 0, 'reference': 0}
        self.create_service(SetBool, '~/enable', self._on_enable)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self._description = Description(
            self, config.described, config.description, self._begin)

    def _begin(self, description: str) -> None:
        """Make the law for a robot, and begin to listen."""
        config = self._tuning.get(ControllerConfig)
        self._controller = Controller(config, model_of(config, description))
        if description:
            self._described = self.create_publisher(
                String, f'~/{ROBOT_DESCRIPTION}', qos(1, latched=True))
            self._described.publish(String(data=description))
        self._reference_inbox = Inbox(
            self, JointTrajectory, REFERENCE, TrajectoryReader().read, self._on_reference,
            qos(), trusting=True, plausible=self._continues)
        self._state_inbox = Inbox(
            self, JointState, JOINT_STATES, StateReader().read, self._on_state, qos(),
            lambda state: self._state_joints.concerned(state.names), trusting=True,
            plausible=self._goes_on)
        self.inboxes = [self._state_inbox, self._reference_inbox]

    @property
    def in_real_time(self) -> bool:
        """Whether states come in real time."""
        return self._seen and not self._simulated

    def introduction(self) -> str:
        """Return the law, and what must come before the first torque."""
        config = self._tuning.get(ControllerConfig)
        switching = f', switching {config.switching}' if config.law == 'chattering' else ''
        waits = self._description.problem or f'waits for {JOINT_STATES} and {REFERENCE}'
        return (f'law {config.law}{switching}, model {config.model}, '
                f'{", ".join(config.joint_names)}, {1 / config.control_period:g} Hz; {waits}')

    def idle(self) -> None:
        """Answer the state that waits for those who are to hear the answer; miss the next one."""
        self._clock_heard = self.count_publishers(CLOCK) > 0
        for inbox in self.inboxes:
            inbox.arbiter.lapse = PATIENCE if self._clock_heard else LAPSE
        now = time.monotonic_ns()
        late = not self._simulated and now - self._arrived > self._timeout
        if late and self._seen:
            self._miss(now - self._arrived)
        if self._waiting is not None:
            if late:
                self._waiting = None
            else:
                self._answer(self._waiting._replace(now=now))

    def _miss(self, silence: int) -> None:
        """Send no torque without states, and report an outage that lasts."""
        if not self._lost:
            self._lost = True
            self._timeouts['state'] += 1
            self._stop()
        if silence > max(_SILENCE, self._timeout) and not (self._said_silent or self.stop):
            self._said_silent = True
            if self.count_publishers(JOINT_STATES):
                self.get_logger().error(
                    f'{JOINT_STATES}: no state for {seconds(silence):.1f} s; no torque')
            else:
                self.get_logger().info(f'{JOINT_STATES}: its publisher has left; no torque')

    def finish(self) -> None:
        """Leave no torque behind."""
        self._stop()

    def status(self) -> Status:
        """Return what the controller does and why."""
        level, message = DiagnosticStatus.OK, 'running'
        if self._description.problem:
            level, message = DiagnosticStatus.ERROR, self._description.problem
        elif self._guard.tripped is not None:
            level, message = DiagnosticStatus.ERROR, (
                f'tripped: the position error of {self._names[self._guard.tripped]} exceeded '
                'error_limit; call ~/reset')
        elif not self._guard.enabled:
            level, message = DiagnosticStatus.WARN, 'disabled; call ~/enable'
        elif self._lost:
            silence = (time.monotonic_ns() - self._arrived) / NANOSECONDS
            level, message = DiagnosticStatus.ERROR, f'no state for {silence:.1f} s'
        elif not self._seen:
            level, message = DiagnosticStatus.WARN, f'waiting for {JOINT_STATES}'
        elif self._waiting is not None:
            level, message = DiagnosticStatus.WARN, f'waiting for {REFERENCE}'
        elif self._late:
            level, message = DiagnosticStatus.ERROR, (
                f'no {REFERENCE} for {self._settings.reference_timeout:g} s; holding the '
                'position')
        config = self._tuning.get(ControllerConfig)
        self._cadence.rotate()
        if self.inboxes:
            self._health.rotate(time.monotonic_ns(), self._taken, self._restarts,
                                self._state_inbox.refused)
        problems = self._problems()
        if level == DiagnosticStatus.OK and problems:
            level = max(problem[0] for problem in problems)
            message = f'running, but {"; ".join(text for _, text in problems)}'
        self._term_saturation.clear()
        return Status(level, message, {
            'period of the stamps, mean [ms]': 1e3 * self._cadence.mean,
            'law': config.law, 'switching': config.switching,
            'points of the reference': len(self._trajectory),
            'saturated samples': self._saturated, 'restarts': self._restarts,
            'restarts per second': self._health.restarts_per_second,
            **{f'timeouts, {name}': count for name, count in self._timeouts.items()},
            'time': 'simulated' if self._simulated else 'real'})

    def _problems(self) -> list[tuple[bytes, str]]:
        """Return what goes wrong at present: level and text."""
        found = []
        health = self._health
        if health.poor and not self._simulated:
            found.append((DiagnosticStatus.ERROR if health.bad else DiagnosticStatus.WARN,
                          str(health)))
        if self._cadence.wrong:
            found.append((DiagnosticStatus.WARN, (
                f'states come every {1e3 * self._cadence.mean:.3g} ms; control_period is '
                f'{1e3 * seconds(self._period):g} ms')))
        found += [(DiagnosticStatus.WARN, f'{name}: {joint}') for name, joint in zip(
            self._names, self._term_saturation.found()) if joint.cause]
        return found

    def _on_change(self) -> None:
        self._settings = self._tuning.get(ControllerSettings)
        config = self._tuning.get(ControllerConfig)
        if self._controller is not None:
            self._controller.configure(config)
        if self._beyond is not None:
            self._waiting, self._beyond = self._beyond, None
        self._watched = min(config.error_limit) < inf

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response
                   ) -> SetBool.Response:
        if request.data and not self._guard.enabled:
            self._restart()
        self._guard.enabled = request.data
        if not request.data:
            self._stop('disabled by ~/enable', error=False)
        response.success = True
        response.message = 'enabled' if request.data else 'disabled'
        if request.data and self._guard.tripped is not None:
            response.message += ', but tripped: call ~/reset'
        return response

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response
                  ) -> Trigger.Response:
        response.success = True
        response.message = 'reset' if self._guard.tripped is not None else 'was not tripped'
        if self._guard.tripped is not None:
            self._guard.reset()
            self._restart()
        return response

    def _restart(self, bumpless: bool = True) -> None:
        if self._controller is not None:
            self._controller.reset(bumpless, self._held if bumpless else None)
            self._term_saturation.pause()

    def _on_reference(self, piece: TrajectoryChunk, now: int) -> None:
        pick = self._reference_joints.pick(piece.names)
        n = len(piece.names)
        if pick is None:
            raise Refused('joints', f'joints {list(piece.names)}; needed: each of '
                          f'{list(self._names)} once')
        if not all(len(row) == n for point in piece.points for row in point):
            raise Refused('length', 'a point without position, velocity and acceleration of '
                          'every joint')
        if not isfinite(sum([sum(row) for point in piece.points for row in point])):
            raise Refused('not_finite', 'a number that is not finite')
        if any(b <= a for a, b in zip(piece.times, piece.times[1:])):
            raise Refused('times', 'points whose times do not increase')
        self._trajectory.extend(
            piece.times, [(pick(q), pick(dq), pick(ddq)) for q, dq, ddq in piece.points])
        if not self._seen or self._lost:  # No state says what is past.
            self._trajectory.limit(max(_MOST_POINTS, len(piece.times)))
        if self._waiting is not None:
            self._answer(self._waiting._replace(now=now))

    def _goes_on(self, state: State) -> bool:
        """Return whether a state is the next one by its stamp."""
        step = state.t - self._last
        return 0 < step <= self._timeout and not (self._simulated and step % self._period)

    def _continues(self, piece: TrajectoryChunk) -> bool:
        """Return whether a piece begins where the motion is known, or right behind it."""
        end = self._trajectory.end
        return bool(piece.times) and end is not None and (
            self._last <= piece.times[0] <= end + self._period)

    def _on_state(self, state: State, now: int) -> None:
        t, names, position, velocity, _ = state
        pick = self._state_joints.pick(names)
        if pick is None:
            raise Refused('joints', f'joints {list(names)}; needed: each of '
                          f'{list(self._names)} once')
        if not len(names) == len(position) == len(velocity):
            raise Refused('length', f'{len(position)} positions and {len(velocity)} velocities '
                          f'for {len(names)} joints')
        q, dq = pick(position), pick(velocity)
        if not isfinite(sum(q) + sum(dq)):
            raise Refused('not_finite', f'{list(q)}, {list(dq)}')
        if t > LATEST:
            raise Refused('stamp', f'no stamp is as late as {seconds(t):.9f} s')
        if not self._seen:
            self._clock_heard = self.count_publishers(CLOCK) > 0
        self._simulated = self.hurried = self._clock_heard
        verdict = self._stamps.judge(t, now, self._simulated)
        if verdict != stamps.NEXT or self._lost:  # Lost: a torque of 0 was sent since.
            self._judged(verdict, t)
        if self._lost:
            self._report_outage(now - self._arrived)
        self._taken += 1
        self._seen, self._lost, self._arrived, self._last = True, False, now, t
        self._cadence.note(t)
        self._answer(_State(t, now, q, dq))

    def _report_outage(self, silence: int) -> None:
        if self._said_silent:
            self.get_logger().info(f'{JOINT_STATES}: states again, after {seconds(silence):.1f} s')
        else:
            self.get_logger().warning(
                f'{JOINT_STATES}: no state for {seconds(silence):.3f} s; no torque after '
                f'{seconds(self._timeout):g} s', throttle_duration_sec=1.0)
        self._said_silent = False

    def _judged(self, verdict: str, t: int) -> None:
        """Act on a stamp that does not follow the last one."""
        if verdict not in stamps.TAKEN:
            if verdict == stamps.REPEATED and self._simulated:
                if t == self._last and self._waiting is None and self._held is not None:
                    self._commands.publish(self._writer.write(self._held))
                raise Refused(verdict, '')  # A plant that waits says it again, and so do we.
            if verdict == stamps.STALE:
                raise Refused(verdict, (
                    f'it comes {1e3 * seconds(self._stamps.lateness):.1f} ms later than the '
                    f'quickest one, more than {1e3 * seconds(self._timeout):g} ms '
                    f'(state_timeout): {BUSY}'))
            raise Refused(verdict, f'{_WRONG_STAMP[verdict]}: {seconds(t):.9f} s')
        if not self._seen:
            return
        self._restarts += 1
        self._restart(bumpless=not self._simulated)
        self.pace.pause()
        self._cadence.pause()
        if verdict == stamps.ANEW:
            self._count = 0
            self._rejoining = Rejoining(self._trajectory)
            self._tuning.news = True
            self.get_logger().info(
                f'time begins anew at {seconds(t):.3f} s', throttle_duration_sec=1.0)

    def _answer(self, state: _State) -> None:
        """Send the torque that answers a state, or have the state wait."""
        law = self._controller
        assert law is not None
        t = state.t
        self._beyond = None
        point = self._trajectory.at(t)
        if not self._heard:
            self._heard = self.heard(
                (self._commands, self._tracking, self._filter, self._torques),
                self._settings.wait_for)
        if point is None or not self._heard or not self._guard.allows or self._must_wait(t):
            self._waiting = state
            self._trajectory.forget(t)
            if not self._guard.allows:
                self._rejoining.pause(t)
            return
        self._waiting = None
        q = state.q
        if self._rejoining.begin(t, q, state.dq, self._settings.restart_duration):
            self.get_logger().info(
                f'no torque was sent for a while: back to {REFERENCE} from where the robot is '
                f'within {self._settings.restart_duration:g} s')
        point = self._rejoining.at(t, point)
        ahead = [self._rejoining.at(t + lag, x) for lag in self._lags
                 if (x := self._trajectory.at(t + lag)) is not None]
        sample = self._sample(state, point, ahead)
        if sample is None:
            self._beyond = state
            self._state_inbox.refuse(
                Refused('overflow', f'no torque can be computed for {list(q)}, '
                        f'{list(state.dq)}'), state.now)
            return
        if self._watched and not self._guard.check(sample.e, law.config.error_limit):
            self._stop(f'the position errors {[float(f"{x:.4g}") for x in sample.e]} rad exceed '
                       'error_limit; no torque until ~/reset')
            self._waiting = state
            return
        self._commands.publish(self._writer.write(sample.tau))
        self._held = sample.tau
        if sample.saturation_error is not None:
            self._saturated += 1
        config = law.config
        if config.law == 'chattering':
            self._term_saturation.add(sample.chattering, config.ka, config.switching)
        if self._count % self._settings.state_decimation == 0:
            self._publish_terms(t, sample, point, law.lyapunov(q, sample.v))
            self._trajectory.forget(t)
            self._note_late(t)
        self._count += 1
        if self._tuning.news:
            self._tuning.announce(t)
        end = time.monotonic_ns()
        self.pace.sample(state.now, end)
        if end - state.now > self._period and not self._simulated:
            self.pace.misses += 1

    def _sample(self, state: _State, point: Point, ahead: list[Point]) -> Sample | None:
        """
        Return the law's answer; None, and the law begins anew, if it has none that is finite.

        Simulated time waits for the answer: there, the law that begins anew is asked again.
        """
        law = self._controller
        assert law is not None
        for _ in range(2 if self._simulated else 1):
            sample = law.try_step(state.q, state.dq, *point, ahead)
            if sample is not None:
                return sample
            law.reset(bumpless=True, held=self._held)
        return None

    def _must_wait(self, t: int) -> bool:
        """Return whether the reference lags behind, and time, being simulated, can wait."""
        end = self._trajectory.end
        needed = t + self._lags[-1] if self._lags else t
        return (end is not None and needed > end and self._simulated
                and not self._trajectory.ends_at_rest)

    def _note_late(self, t: int) -> None:
        late = self._trajectory.overdue(t)
        if late and not self._late:
            self._timeouts['reference'] += 1
            self.get_logger().error(
                f'{REFERENCE}: nothing for {self._settings.reference_timeout:g} s; holding the '
                'position')
        self._late = late

    def _stop(self, why: str = '', error: bool = True) -> None:
        """Send no torque from now on; in real time a last one of 0, for those who hold it."""
        if self._held is not None and not self._simulated:  # First: the log may be slow.
            self._commands.publish(self._writer.write((0.0,) * len(self._names)))
        self._held = None
        self.pace.pause()
        # A line each: ROS takes no second severity from the same line, and raises.
        if why and error:
            self.get_logger().error(why)
        elif why:
            self.get_logger().info(why)

    def _publish_terms(self, t: int, s: Sample, point: Point, lyapunov: float) -> None:
        self._tracking.publish(self._tracking_writer.write(
            t, (*point[0], *s.e), (*point[1], *s.de)))
        self._filter.publish(self._filter_writer.write(t, s.v))
        self._torques.publish(self._torque_writer.write(t, (
            *s.inverse_dynamics, *(-x for x in s.compensation), *(-x for x in s.chattering),
            lyapunov)))


#: What the executable runs.
NODE = ControllerNode
