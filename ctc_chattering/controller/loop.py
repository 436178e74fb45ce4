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

"""The control loop without ROS: which joint state is answered, when, and with what torque."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import cast, NamedTuple

from ctc_chattering.control.controller import Controller, ControllerConfig, Sample
from ctc_chattering.controller import timing
from ctc_chattering.controller.answers import (
    Answered,
    AnsweredStates,
    LEAST_STATES,
    Rehearsal,
    shortfall,
)
from ctc_chattering.controller.desired_motion import DesiredMotion
from ctc_chattering.controller.health import ControllerHealth
from ctc_chattering.controller.positions import (
    find_jump,
    JointSample,
    Jump,
    PositionTracker,
)
from ctc_chattering.controller.state_machine import Input, Mode
from ctc_chattering.controller.timing import Logger, Watchdog
from ctc_chattering.controller.trips import low_bandwidth, TripMonitor, unsafe_settings
from ctc_chattering.errors import ParameterError, RejectedMessage
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS, period_ns, seconds
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.transitions import BRAKING_TIME, Stop, TimedMotion

#: Points of the reference that are kept while there is no state: a minute at 1 kHz.
_MOST_POINTS = 60_000
#: Steps are too slow if none of so many answers took less than a period.
_SLOW = 10


class Answer(NamedTuple):
    """What answers a joint state: the sample of the law, and the reference that it followed."""

    state: JointSample
    point: Point
    sample: Sample


class ControlLoop:
    """
    Turns joint states into torques as its mode allows.

    A joint state is pending until it has been answered. In real time a new one replaces it, and
    an outage of the states drops it; simulated time waits for the answer. Vectors are sequences
    of floats from the message to the message; the law has arrays.

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
    mode : Mode
        The present one.
    period : int
        Control period [ns].
    restart_duration, predicted_periods : float, int
        As the parameters of these names [s].
    least_answered : float
        As the parameter of this name; 0 until it is set.
    rehearsal : Rehearsal or None
        What is measured before the first torque, where time is real; None when it is over.
    took : deque of int
        Processor time of the last answers [ns], to be noted by the caller.
    simulated : bool
        Whether time is simulated, as of the last state.
    reference_outages : int
        How often the reference was late.
    tripped : str
        Why the last trip was; empty before the first.

    """

    def __init__(self, config: ControllerConfig, state_timeout: float, reference_timeout: float,
                 enabled: bool, send: Callable[[Vector], None], logger: Logger) -> None:
        self._names, self.period = config.joint_names, period_ns(config.control_period)
        self._send, self._log = send, logger
        self._reference_timeout = reference_timeout
        self._law: Controller | None = None
        self.restart_duration = 0.0
        self.predicted_periods = 0
        self.least_answered = 0.0
        self.rehearsal: Rehearsal | None = None
        self._answers = AnsweredStates(self.period)
        #: States so far that got no answer.
        self._unanswered = 0
        self.took: deque[int] = deque(maxlen=_SLOW)
        #: Whether the law has answered the last state, and all that were predicted after it.
        self._goes_on = False
        self.simulated = False
        self.mode = Mode.WAITING_FOR_STATE if enabled else Mode.DISABLED
        self.motion = DesiredMotion(
            round(reference_timeout * NANOSECONDS), self.period, config.input_delay)
        self.watchdog = Watchdog('joint_states', 'state', 'no torque', logger)
        self.watchdog.timeout = max(round(state_timeout * NANOSECONDS), 3 * self.period)
        self._stamps = timing.Stamps(self.watchdog.timeout)
        self._positions = PositionTracker()
        self.health = ControllerHealth(self._names, self.period)
        self._trips = TripMonitor(self._names, self.period)
        self.reference_outages = 0
        #: The last state, and the same while it is not answered.
        self.last: JointSample | None = None
        self._pending: JointSample | None = None
        #: The torque sent last; None where nothing has been sent, or a last one of 0.
        self._held: Vector | None = None
        self.tripped = ''
        #: Whether a torque was ever sent: before that, gaps of the states are those of the start.
        self._begun = False

    @property
    def law(self) -> Controller | None:
        """Return the law, once the model is known."""
        return self._law

    @law.setter
    def law(self, law: Controller) -> None:
        self._law = law
        self._positions.continuous = self.motion.continuous = law.continuous

    def take_reference(self, times: Sequence[int], points: Sequence[Point]) -> None:
        """
        Add a chunk of the reference: instants [ns] and points; without any, the motion stops.

        Raises
        ------
        RejectedMessage
            If time is real, and all of it is longer past than a reference may be late; or without
            a point, if there is no motion to stop.

        """
        if not times:
            self._stop_motion()
        elif self.last is not None and not self.simulated and (
                self.motion.grace < self.last.t - times[-1]):
            raise RejectedMessage('past', (
                f'all of its points are past: the last one is at {seconds(times[-1]):.3f} s, the '
                f'last state at {seconds(self.last.t):.3f} s; are the clocks synchronised?'))
        self.motion.extend(times, points)
        if self.last is not None:
            self.motion.forget(self.last.t - self.period)
        if self.last is None or self.watchdog.out:
            self.motion.limit(max(_MOST_POINTS, len(times)))

    def _stop_motion(self) -> None:
        """Bring the reference to rest on its path, from the next sample on."""
        begin = None if self.last is None else self.last.t + self.period
        if begin is None or self.motion.at(begin) is None:
            raise RejectedMessage('early', 'it has no points, and there is no motion to stop')
        stop = Stop(cast('TimedMotion', self.motion), begin, BRAKING_TIME)
        times = range(begin, stop.end + self.period, self.period)
        self.motion.extend(times, [stop.at(t) for t in times])

    def take_state(self, state: JointSample, now: int, simulated: bool,
                   unanswered: int = 0) -> bool:
        """
        Take the next joint state; return whether time begins with it, also the first time.

        Parameters
        ----------
        state : JointSample
            Finite.
        now : int
            When it came, on a clock that only goes forward [ns].
        simulated : bool
            Whether time is simulated.
        unanswered : int
            States so far that were skipped for newer ones, or refused as stale.

        Raises
        ------
        RejectedMessage
            If its stamp, or a position, does not follow the last one.

        """
        self.simulated = simulated
        self._note_missed(unanswered)
        verdict = self._stamps.classify(state.t, now, simulated)
        if verdict not in timing.TAKEN:
            again = verdict == timing.REPEATED and simulated  # By a plant that waits.
            if again and self._pending is None and self._held is not None:
                self._send(self._held)
            raise RejectedMessage(verdict, '' if again or not self._begun else (
                f'stamp {seconds(state.t):.9f} s: {verdict}, '
                f'{1e3 * seconds(self._stamps.lateness):.1f} ms late; allowed: increasing, at '
                f'most {1e3 * seconds(self._stamps.limit):g} ms late (state_timeout)'))
        if verdict != timing.NEXT:
            self._positions.forget()
        state = self._positions.follow(state)
        self._check_position(state)
        self._positions.take(state)
        goes_on = verdict == timing.NEXT and not self.watchdog.out
        self.watchdog.feed(now, self._begun)
        if self._begun and not goes_on:
            self.health.restarts += 1
            self._restart_law(bumpless=not simulated)
        if verdict == timing.RESTART:
            self.motion.restart()
        self.handle(Input.STATE)
        self.health.taken += 1
        self.last = self._pending = state
        self._goes_on = False
        return verdict == timing.RESTART

    def _check_position(self, state: JointSample) -> None:
        """Refuse a jump, where the state would be answered; end the torques where it stays."""
        last = self._positions.last
        if last is None or not (self.mode.sends_torque or self.mode is Mode.NO_STATE):
            return
        jump = find_jump(last, state)
        if jump is None:
            return
        text = self._described(jump)
        if self._positions.agrees(state):
            self._positions.take(state)
            self._trip(f'{text} It stays there: was its encoder set anew, or does it slip?')
        raise RejectedMessage('position_jump', text)

    def _described(self, jump: Jump) -> str:
        """Return what is wrong with a position, and what may be the reason."""
        name = self._names[jump.joint]
        text = (f'{name} is at {jump.position:.4g} rad, but {1e3 * jump.elapsed:.3g} ms before it '
                f'was at {jump.last_position:.4g} rad with {jump.last_velocity:.3g} rad/s.')
        return text if not jump.is_whole_turns else (
            f'{text} That is a whole turn: if it turns endlessly, add it to continuous_joints.')

    def answer(self, matched: bool, now: int = 0) -> Answer | None:
        """
        Send the torque that answers the pending state, if there is one to send, and return it.

        Parameters
        ----------
        matched : bool
            Whether those who are to receive the torque do.
        now : int
            Real time: on the clock of `take_state` [ns].

        Raises
        ------
        RejectedMessage
            If the law has no finite torque, or the way back to the reference is not finite.

        """
        state, law = self._pending, self.law
        if state is None or law is None or self._is_silent(now) or self.rehearses:
            return None
        allowed = self.mode.allows_torque
        at = law.instant(state.t)
        if allowed and matched:
            state = self._anchored(law, at, state)
        points = self._desired(at, state) if allowed and matched else None
        if points is None:
            self.motion.pass_over(state.t, driven=allowed)
            self.handle(Input.NO_REFERENCE)
            return None
        if self._is_too_slow(self._answers.total, self._answers.window):
            return None
        # Before the first torque it is not known what moved the robot, such as a brake.
        late = 0 if self.simulated or self._too_slow or self._held is None else (
            self._periods_since(state.t, now))
        sample = law.try_step(state.q, state.dq, *points[0], points[1:],
                              None if self._too_slow else state.t, at, late)
        if sample is None:  # The state is pending; the law that restarts is asked again.
            law.reset(bumpless=True, held=self._held)
            raise RejectedMessage('overflow', (
                f'no torque can be computed for {list(state.q)}, {list(state.dq)}'))
        if not self._send_checked(law, sample):
            return None
        self._pending, self._begun, self._goes_on = None, True, True
        self._note(state.t, sample)
        return Answer(state, points[0], sample)

    @property
    def answered(self) -> Answered:
        """Return the last states in real time, and those answered in time."""
        return self._answers.total

    @property
    def rehearses(self) -> bool:
        """Whether the loop is measured, or will be with the first states."""
        return bool(self.rehearsal and self.least_answered and not self.simulated)

    def rehearse(self, now: int) -> bool:
        """
        Real time, before the first torque: compute one for the pending state, and send none.

        Return whether one was computed; see `note_answer`.
        """
        rehearsal, state = self.rehearsal, self._pending
        if rehearsal is None or self.last is None:
            return False
        rehearsal.begin(now)
        if not self.rehearses:
            self.rehearsal = None
        elif rehearsal.over(now, self._answers.complete):
            self.rehearsal = None
            rehearsal.report(self._log)
            if self.mode.allows_torque:
                self._is_too_slow(rehearsal.total, LEAST_STATES)
        elif state is not None and rehearsal.step(state):
            return True
        return False

    def _is_too_slow(self, answered: Answered, enough: int) -> bool:
        """End the torques where too few of `enough` states were answered in time."""
        reason = shortfall(answered, self.least_answered, enough)
        if reason:
            self._trip(reason)
        return bool(reason)

    def note_answer(self, end: int) -> None:
        """Real time: count the last state, whose torque is sent or computed at `end` [ns]."""
        if self.last is None or self.simulated:
            return
        in_time = end - self._stamps.arrival(self.last.t) <= self.period
        self._answers.answer(in_time)
        if self.rehearsal is not None:
            self.rehearsal.answer(in_time)

    def _note_missed(self, unanswered: int) -> None:
        """Count states without an answer, `unanswered` so far, where they should have one."""
        missed, self._unanswered = unanswered - self._unanswered, unanswered
        if missed <= 0 or self.simulated:
            return
        if self.rehearsal is not None:
            self.rehearsal.miss(missed)
        if self.rehearses or self.mode.sends_torque or self.mode is Mode.NO_STATE:
            self._answers.miss(missed)

    def _anchored(self, law: Controller, at: int, state: JointSample) -> JointSample:
        """
        Return the pending state with the turns that it keeps until the law begins again.

        Those nearest to the reference, at an instant [ns]. After a pause without a torque the
        joints may have been turned, so that the law begins again if these are other ones.
        """
        began = self._positions.anchored
        if began and not self.motion.resumes(at):
            return state
        point = self.motion.at(at)
        if point is None:
            return state
        anchored = self._positions.anchor(state, point[0])
        if anchored is not state:
            self.last = self._pending = anchored
            if began:
                law.reset(bumpless=True, held=self._held)
        return anchored

    @property
    def _too_slow(self) -> bool:
        """
        Return whether steps take too long for the periods without a state to be made good.

        The law then goes on by one period a state.
        """
        return not self.simulated and min(self.took, default=0) > self.period

    def due(self) -> int | None:
        """
        Return when the torque for a predicted state is to be sent, on the clock of `take_state`.

        In real time, that is a quarter of a period after the next state should have come: for as
        many periods as the parameter says, and before `state_timeout`; else None [ns].
        """
        if (self.law is None or self.last is None or not self._goes_on or self.simulated
                or self._too_slow or not self.mode.sends_torque):
            return None
        periods = self.law.predicted_periods + 1
        silence = periods * self.period + self.period // 4
        if periods > self.predicted_periods or silence >= self.watchdog.timeout:
            return None
        return self._stamps.arrival(self.last.t) + silence

    def _periods_since(self, t: int, now: int) -> int:
        """
        Return the periods passed at `now` since the sample of stamp `t` [ns], and made good.

        A torque sent within half a period after the state should have come is in force from its
        sample on.
        """
        passed = (now - self._stamps.arrival(t) + self.period // 2) // self.period
        return min(max(passed, 0), self.predicted_periods)

    def predict(self, now: int) -> None:
        """
        Send the torque that answers the predicted state of the period at `now`, as `due`.

        None after `state_timeout`, however late this is called.

        Raises
        ------
        RejectedMessage
            As `answer`.

        """
        law, last = self.law, self.last
        assert law is not None and last is not None
        before, self._goes_on = law.predicted_periods, False
        if self._is_silent(now):
            return
        periods = self._periods_since(last.t, now)
        points = self._desired(law.instant(last.t + periods * self.period), last)
        sample = None if points is None else law.predicted_step(
            *points[0], points[1:], periods - before)
        self._goes_on = sample is not None and self._send_checked(law, sample)

    def _is_silent(self, now: int) -> bool:
        """Return whether `check_silence` is due: this process, too, may have stood still."""
        return not self.simulated and self.watchdog.silence(now) > self.watchdog.timeout

    def _desired(self, at: int, state: JointSample) -> list[Point] | None:
        """Return what is desired at an instant and for each sample of delay, if it is known."""
        try:
            return self.motion.desired(
                at, state.q, state.dq, self.simulated, self.restart_duration)
        except ParameterError as error:
            raise RejectedMessage('overflow', str(error)) from None

    def _send_checked(self, law: Controller, sample: Sample) -> bool:
        """Send the torque of a sample, or none until a reset; return whether it was sent."""
        if reason := self._trips.check(law, sample):
            self._trip(reason)
            return False
        self._send(sample.tau)
        self._held = sample.tau
        return True

    def _trip(self, reason: str) -> None:
        """End the torques until a reset."""
        self.tripped = reason
        self._answers.clear()
        self.handle(Input.TRIP)
        self.end_torque()
        self._log.error(f'{reason}; no torque until ~/reset')

    def _note(self, t: int, sample: Sample) -> None:
        """Note what a torque was made of, after it was sent."""
        if self.motion.overdue(t):
            if self.handle(Input.HOLD):
                self.reference_outages += 1
                self._log.error(f'reference: nothing for {self._reference_timeout:g} s; holding '
                                'the position', throttle_duration_sec=1.0)
        else:
            self.handle(Input.FOLLOW if self.motion.way_back is None
                        else Input.LEAD_BACK)
        self.health.add(sample)

    def check_silence(self, now: int) -> None:
        """Real time: end the torques at `now` [ns] if no state has come for too long."""
        if self.watchdog.check(now):
            self._pending = None
            self.handle(Input.SILENCE)

    def request(self, event: Input) -> bool:
        """Handle what a user asks for by a service; return whether that was a change."""
        if changed := self.handle(event):
            self._log.info(f'{event.value}, by a service')
            if event is not Input.DISABLE:
                self._restart_law()
        return changed

    def _restart_law(self, bumpless: bool = True) -> None:
        self._positions.anchored = False
        if self.law is not None:
            self.law.reset(bumpless, self._held if bumpless else None)
            self._trips.restart()

    def handle(self, event: Input) -> bool:
        """Handle an input; return whether it led to another mode, and end torques if so."""
        before = self.mode
        self.mode = after = before.after(event)
        if after is before:
            return False
        if before.sends_torque and not after.sends_torque and not (
                self.simulated and after is Mode.WAITING_FOR_REFERENCE):
            self.end_torque()
        return True

    def end_torque(self) -> None:
        """Send no torque from now on; in real time a last one of 0, for those who hold it."""
        if self._held is not None and not self.simulated:
            self._send((0.0,) * len(self._names))
        self._held = None

    def status(self, now: int, rejected: Mapping[str, int], skipped: int, cause: str = ''
               ) -> tuple[int, str]:
        """
        Return level (0 all is well, 1 warning, 2 error) and text of the present mode.

        Parameters
        ----------
        now, rejected, skipped, cause
            As `ControllerHealth.report` takes them.

        """
        problems = [] if self.last is None else self.health.report(
            now, self.last.t, rejected, skipped, self.simulated, cause)
        if self.law is not None:
            problems += self.health.saturation(self.law.config)
            problems += [(1, text) for text in (
                *low_bandwidth(self.law), *unsafe_settings(self.law.config))]
        tripped = f'tripped: {self.tripped}; call ~/reset'
        wrong = {
            Mode.TRIPPED: tripped, Mode.TRIPPED_AND_DISABLED: tripped,
            Mode.NO_STATE: f'no state for {seconds(self.watchdog.silence(now)):.1f} s',
            Mode.HOLDING: f'no reference for {self._reference_timeout:g} s; holding the position'}
        if self.mode in wrong:
            return 2, wrong[self.mode]
        if not self.mode.sends_torque or not problems:
            return int(not self.mode.sends_torque), self.mode.value
        return (max(level for level, _ in problems),
                f'running, but {"; ".join(text for _, text in problems)}')
