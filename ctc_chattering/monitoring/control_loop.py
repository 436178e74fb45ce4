"""What the controller does with a joint state, a reference and a request, without ROS."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from ctc_chattering.control.controller import Controller, ControllerConfig, Sample
from ctc_chattering.control.error_monitor import joint_beyond
from ctc_chattering.errors import ParameterError, RejectedMessage
from ctc_chattering.monitoring import stamps
from ctc_chattering.monitoring.controller_health import ControllerHealth
from ctc_chattering.monitoring.controller_state import Event, State
from ctc_chattering.monitoring.watchdog import Logger, Watchdog
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS, period_ns, seconds
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.desired_motion import DesiredMotion

#: Points of the reference that are kept while there is no state: a minute at 1 kHz.
_MOST_POINTS = 60_000
#: Samples after which past points of the reference are forgotten.
_FORGET = 10
#: Real time: silence that is reported at once [ns]; a plant may take so long to shut down.
_SILENCE = 2 * NANOSECONDS


class JointSample(NamedTuple):
    """A joint state: stamp [ns], position [rad] and velocity [rad/s], each of shape (n,)."""

    t: int
    q: Vector
    dq: Vector


class Answer(NamedTuple):
    """What answers a joint state: the sample of the law, and the reference that it followed."""

    state: JointSample
    point: Point
    sample: Sample


class ControlLoop:
    """
    Turns joint states into torques as its state allows.

    A joint state is pending until it has been answered. In real time a new one replaces it, and
    an outage of the states drops it; simulated time waits for the answer.

    Parameters
    ----------
    config : ControllerConfig
        As at the start; the law has the present one.
    state_timeout, reference_timeout : float
        As the parameters of these names [s].
    enabled : bool
        Whether torques are wanted from the start.
    send : callable
        Sends a torque, shape (n,) [N·m].
    logger : Logger
        Where changes are reported.

    Attributes
    ----------
    state : State
        The present one.
    law : Controller or None
        Once the model is known.
    period : int
        Control period [ns].
    restart_duration : float
        As the parameter of this name [s].
    simulated : bool
        Whether time is simulated, as of the last state.
    restarted : bool
        Whether time began again since this was reset.
    reference_outages : int
        How often the reference was late.

    """

    def __init__(self, config: ControllerConfig, state_timeout: float, reference_timeout: float,
                 enabled: bool, send: Callable[[Vector], None], logger: Logger) -> None:
        self._names, self.period = config.joint_names, period_ns(config.control_period)
        self._send, self._log = send, logger
        self._reference_timeout = reference_timeout
        self.law: Controller | None = None
        self.restart_duration = 0.0
        self.simulated = self.restarted = False
        self.state = State.WAITING_FOR_STATE if enabled else State.DISABLED
        self.motion = DesiredMotion(
            round(reference_timeout * NANOSECONDS), self.period, config.input_delay)
        self.watchdog = Watchdog('joint_states', 'state', 'no torque', _SILENCE, logger)
        self.watchdog.timeout = max(round(state_timeout * NANOSECONDS), 3 * self.period)
        self._stamps = stamps.Stamps(self.watchdog.timeout)
        self.health = ControllerHealth(self._names, self.period)
        self.reference_outages = 0
        #: The last state, and the same while it is not answered.
        self.last: JointSample | None = None
        self._pending: JointSample | None = None
        #: The torque sent last; None where nothing has been sent, or a last one of 0.
        self._held: Vector | None = None
        self._tripped = ''

    def take_reference(self, times: Sequence[int], points: Sequence[Point]) -> None:
        """Add a chunk of the reference: instants [ns] and points."""
        unused = self.last is None or self.watchdog.out
        self.motion.extend(times, points, _MOST_POINTS if unused else None)

    def take_state(self, state: JointSample, now: int, simulated: bool, skipped: int = 0) -> None:
        """
        Take the next joint state.

        Parameters
        ----------
        state : JointSample
            Finite.
        now : int
            When it came, on a clock that only goes forward [ns].
        simulated : bool
            Whether time is simulated.
        skipped : int
            States skipped so far because newer ones had come.

        Raises
        ------
        RejectedMessage
            If its stamp does not follow the last one.

        """
        self.simulated = simulated
        verdict = self._stamps.classify(state.t, now, simulated)
        if verdict not in stamps.TAKEN:
            self._reject(verdict, state.t)
        outage = self.watchdog.out
        self.watchdog.feed(now)
        if self.last is not None and (outage or verdict != stamps.NEXT):
            self.health.restart()
            self._restart_law(bumpless=not simulated)
            if verdict == stamps.RESTART:
                self.restarted = True
                self.motion.restart()
        self.handle(Event.STATE)
        self.health.take(state.t, skipped)
        self.last = self._pending = state

    def _reject(self, verdict: str, t: int) -> None:
        """Raise `RejectedMessage` for a stamp [ns]."""
        if verdict == stamps.REPEATED and self.simulated:
            if self._pending is None and self._held is not None:
                self._send(self._held)
            raise RejectedMessage(verdict)  # A plant that waits sends it again, and so do we.
        raise RejectedMessage(verdict, self._stamps.reason(verdict, t))

    def check_silence(self, now: int, publishers: Callable[[], int]) -> None:
        """Real time: end the torques at `now` [ns] if no state has come for too long."""
        if self.watchdog.check(now, publishers):
            self._pending = None
            self.handle(Event.SILENCE)

    def enable(self, on: bool) -> None:
        """Allow torques, or end them."""
        if self.handle(Event.ENABLE if on else Event.DISABLE):
            self._log.info(f'{"enabled again" if on else "disabled"} by ~/enable')
            if on:
                self._restart_law()

    def reset(self) -> bool:
        """Go on after a trip; return whether there was one."""
        if tripped := self.handle(Event.RESET):
            self._log.info('reset by ~/reset')
            self._restart_law()
        return tripped

    def _restart_law(self, bumpless: bool = True) -> None:
        if self.law is not None:
            self.law.reset(bumpless, self._held if bumpless else None)
            self.health.pause()

    def handle(self, event: Event) -> bool:
        """Handle an event; return whether it led to another state, and end torques if so."""
        before = self.state
        self.state = after = before.after(event)
        if after is not before and before.sends_torque and not after.sends_torque and not (
                self.simulated and after is State.WAITING_FOR_REFERENCE):
            self.end_torque()
        return after is not before

    def end_torque(self) -> None:
        """Send no torque from now on; in real time a last one of 0, for those who hold it."""
        if self._held is not None and not self.simulated:
            self._send((0.0,) * len(self._names))
        self._held = None

    def answer(self, matched: bool) -> Answer | None:
        """
        Send the torque that answers the pending state, if there is one to send, and return it.

        Parameters
        ----------
        matched : bool
            Whether those who are to receive the torque do.

        Raises
        ------
        RejectedMessage
            If the law has no finite torque, or the way back to the reference is not finite.

        """
        state, law = self._pending, self.law
        if state is None or law is None:
            return None
        allowed = self.state.allows_torque
        reference = self.motion.reference(
            state.t, wait=self.simulated) if matched and allowed else None
        if reference is None:
            self.motion.pass_over(state.t, driven=allowed)
            self.handle(Event.NO_REFERENCE)
            return None
        try:
            begins = self.motion.begin(*state, self.restart_duration)
        except ParameterError as error:
            raise RejectedMessage('overflow', str(error)) from None
        if begins:
            self._log.info(
                'no torque was sent for a while: back to the reference from where the robot is '
                f'within {self.restart_duration:g} s')
        point, *ahead = self.motion.desired(state.t, reference)
        sample = self._step(law, state, point, ahead)
        beyond = joint_beyond(sample.e, law.config.error_limit)
        if beyond is not None:
            self._tripped = self._names[beyond]
            self.handle(Event.ERROR_LIMIT)
            self.end_torque()
            self._log.error(
                f'the position errors {[float(f"{x:.4g}") for x in sample.e]} rad exceed '
                'error_limit; no torque until ~/reset')
            return None
        self._send(sample.tau)
        self._held, self._pending = sample.tau, None
        return Answer(state, point, sample)

    def _step(self, law: Controller, state: JointSample, point: Point, ahead: list[Point]
              ) -> Sample:
        """
        Return the law's answer; if it has none that is finite, the law restarts.

        Simulated time waits for the answer: there, the law that restarted is asked again.
        """
        for _ in range(2 if self.simulated else 1):
            sample = law.try_step(state.q, state.dq, *point, ahead)
            if sample is not None:
                return sample
            law.reset(bumpless=True, held=self._held)
        raise RejectedMessage('overflow', (
            f'no torque can be computed for {list(state.q)}, {list(state.dq)}'))

    def note(self, answer: Answer) -> None:
        """Note what a torque was made of, after it was sent."""
        if self.motion.late(answer.state.t):
            if self.handle(Event.HOLD):
                self.reference_outages += 1
                self._log.error(f'reference: nothing for {self._reference_timeout:g} s; holding '
                                'the position')
        else:
            self.handle(Event.LEAD_BACK if self.motion.leads_back else Event.FOLLOW)
        assert self.law is not None
        self.health.add(answer.sample, self.law.config)
        if self.health.taken % _FORGET == 0:
            self.motion.pass_over(answer.state.t, driven=True)

    def status(self, now: int, rejected: Mapping[str, int], cause: str = '') -> tuple[int, str]:
        """
        Return level (0 all is well, 1 warning, 2 error) and text of the present state.

        Parameters
        ----------
        now, rejected, cause
            As `ControllerHealth.report` takes them.

        """
        problems = self.health.report(now, rejected, self.simulated, cause)
        level, text = self._describe(now)
        if level == 0 and problems:
            return (max(problem[0] for problem in problems),
                    f'running, but {"; ".join(text for _, text in problems)}')
        return level, text

    def _describe(self, now: int) -> tuple[int, str]:
        tripped = (2, f'tripped: the position error of {self._tripped} exceeded error_limit; '
                      'call ~/reset')
        return {
            State.TRIPPED: tripped, State.TRIPPED_AND_DISABLED: tripped,
            State.DISABLED: (1, 'disabled; call ~/enable'),
            State.NO_STATE: (2, f'no state for {seconds(self.watchdog.silence(now)):.1f} s'),
            State.WAITING_FOR_STATE: (1, 'waiting for joint_states'),
            State.WAITING_FOR_REFERENCE: (1, 'waiting for reference'),
            State.HOLDING: (2, f'no reference for {self._reference_timeout:g} s; holding the '
                            'position')}.get(self.state, (0, self.state.value))
