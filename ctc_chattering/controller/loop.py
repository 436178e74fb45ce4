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

"""
The control loop without ROS: from joint states to torques.

`nodes/controller.py` passes states and references to a `ControlLoop`, and sends its torques. The
mode (`state_machine.py`) decides whether a torque may be sent. Stamps, positions, lost states and
trips are judged in modules of their own.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from itertools import takewhile
from math import isfinite
from typing import cast, NamedTuple, NoReturn

from ctc_chattering.control.controller import Controller, ControllerConfig, Sample
from ctc_chattering.control.hand_guiding import HandGuiding
from ctc_chattering.controller import stamps
from ctc_chattering.controller.answers import Answered, AnsweredStates, MIN_STATES, shortfall
from ctc_chattering.controller.desired_motion import DesiredMotion
from ctc_chattering.controller.health import ControllerHealth
from ctc_chattering.controller.lost_states import LostStates
from ctc_chattering.controller.positions import (
    find_jump,
    JointSample,
    Jump,
    PositionTracker,
)
from ctc_chattering.controller.rehearsal import Rehearsal
from ctc_chattering.controller.state_machine import Input, Mode
from ctc_chattering.controller.trips import TripMonitor
from ctc_chattering.controller.watchdog import Logger, Watchdog
from ctc_chattering.errors import CtcError, ParameterError, RejectedMessage
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS, period_ns, seconds
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.joint_limits import TOLERANCE as LIMIT_TOLERANCE
from ctc_chattering.trajectory.path_clock import Stop
from ctc_chattering.trajectory.transitions import BRAKING_TIME, TimedMotion

#: Points of the reference that are kept while there is no state: a minute at 1 kHz.
_MAX_POINTS = 60_000
#: Steps are too slow if each of so many takes more than a period.
_SLOW_STEPS = 10


class Answer(NamedTuple):
    """A state that was answered, its reference, and the sample."""

    state: JointSample
    point: Point
    sample: Sample


class ControlLoop:
    """
    Turns joint states into torques as its mode allows.

    A joint state is pending until it has been answered. In real time a new one replaces it, and
    an outage of the states drops it. Simulated time waits for the answer. Vectors are sequences of
    floats from message to message. The law has arrays.

    Parameters
    ----------
    config : ControllerConfig
        As at the start. The law has the present one.
    state_timeout, reference_timeout : float
        As the parameters of these names [s].
    enabled : bool
        Whether torques are wanted from the start.
    send : callable
        Sends a torque, shape (n,) [N·m].
    logger : Logger
        Logger of changes.

    Attributes
    ----------
    mode : Mode
        The present one.
    period : int
        Control period [ns].
    motion : DesiredMotion
        The reference, and the way back to it.
    lost_states : LostStates
        Times of the torques for states that do not come.
    least_answered : float
        As the parameter of this name, and 0 until it is set.
    rehearsal : Rehearsal or None
        Measurement before the first torque in real time, and None when it is over.
    computing_times : deque of int
        Processor time of the last answers in real time [ns], to be noted by the caller.
    simulated : bool
        Whether time is simulated, as of the last state.
    reference_outages : int
        How often the reference was late.
    last : JointSample or None
        The last state.
    tripped : str
        Reason of the last trip, and '' before the first.

    """

    def __init__(self, config: ControllerConfig, state_timeout: float, reference_timeout: float,
                 enabled: bool, send: Callable[[Vector], None], logger: Logger) -> None:
        self._names, self.period = config.joint_names, period_ns(config.control_period)
        self._send, self._log = send, logger
        self._law: Controller | None = None
        #: Least and greatest position of each joint, empty without a law.
        self._limits: Sequence[tuple[float, float]] = ()
        self.mode = Mode.WAITING_FOR_STATE if enabled else Mode.DISABLED
        self.simulated = False
        self.motion = DesiredMotion(
            round(reference_timeout * NANOSECONDS), self.period, config.input_delay)
        self.watchdog = Watchdog('joint_states', 'state', 'no torque', logger)
        self.watchdog.timeout = max(round(state_timeout * NANOSECONDS), 3 * self.period)
        self._stamps = stamps.Stamps(self.watchdog.timeout)
        self._positions = PositionTracker()
        self.lost_states = LostStates(self.period)
        self.least_answered = 0.0
        self.rehearsal: Rehearsal | None = None
        self._answers = AnsweredStates(self.period)
        self.computing_times: deque[int] = deque(maxlen=_SLOW_STEPS)
        #: States so far that got no answer.
        self._unanswered = 0
        self.health = ControllerHealth(self._names, self.period)
        self._trips = TripMonitor(self._names, self.period)
        self.tripped = ''
        self.reference_outages = 0
        self.last: JointSample | None = None
        #: The last state, while it is not answered.
        self._pending: JointSample | None = None
        #: The torque sent last, or None before the first and after a last one of 0.
        self._held: Vector | None = None
        #: The torque for a hand, while the robot is guided.
        self._guiding: HandGuiding | None = None
        #: Why the robot is held, for a user.
        self.hold_reason = ''
        #: Whether a torque was ever sent: before that, gaps of the states are those of the start.
        self._has_sent = False

    @property
    def law(self) -> Controller | None:
        """Return the law, once the model is known."""
        return self._law

    @law.setter
    def law(self, law: Controller) -> None:
        self._law = law
        self._positions.continuous = self.motion.continuous = law.continuous
        self._limits = law.config.position_limits(law.model)

    def take_reference(self, times: Sequence[int], points: Sequence[Point]) -> None:
        """
        Add a chunk of the reference, or stop the motion.

        Parameters
        ----------
        times, points : sequence of int, sequence of (position, velocity, acceleration)
            Instants [ns], and points.

        Raises
        ------
        RejectedMessage
            If time is real, and all points are longer past than a reference may be late, or if
            there is no motion to stop.

        """
        if not times:
            self._stop_motion()
        elif self.last is not None and not self.simulated and (
                self.motion.grace < self.last.t - times[-1]):
            raise RejectedMessage('past', (
                f'all of its points are past: the last one is at {seconds(times[-1]):.3f} s, the '
                f'last state at {seconds(self.last.t):.3f} s; are the clocks synchronised?'))
        allowed = list(takewhile(lambda point: not self._violation(point[0]), points))
        self.motion.extend(times[:len(allowed)], allowed)
        if len(allowed) < len(points):
            q, _, _ = points[len(allowed)]
            self._stop_before_limit(self._violation(q))
        if self.last is not None:
            self.motion.forget(self.last.t - self.period)
        if self.last is None or self.watchdog.out:
            self.motion.limit(max(_MAX_POINTS, len(times)))

    def _violation(self, q: Vector, tolerance: float = LIMIT_TOLERANCE) -> str:
        """Describe how a position exceeds a limit of the model, if it does."""
        for name, x, (lower, upper) in zip(self._names, q, self._limits):
            if not lower - tolerance <= x <= upper + tolerance:
                return f'{name}: {x:.4g} is beyond its limits, {lower:.4g} to {upper:.4g}'
        return ''

    def _next_instant(self) -> int | None:
        """Return the first instant that may change [ns], None without a motion there."""
        if self.last is None:
            return None
        begin = self.last.t + self.period
        return begin if self.motion.at(begin) is not None else None

    def _stop_before_limit(self, text: str) -> None:
        """Stop the motion before a limit, and refuse the rest of it."""
        begin = self._next_instant()
        if begin is not None and not self.motion.holding:
            self.motion.stop_within(begin, lambda q: not self._violation(q, tolerance=0.0))
            self.hold_reason = text
            self._log.error(f'reference: {text}; stopping before it')
        raise RejectedMessage('limit', text)

    def _stop_motion(self) -> None:
        """Bring the reference to rest on its path."""
        begin = self._next_instant()
        if begin is None:
            raise RejectedMessage(
                'early', 'it has no points, which stops a motion, but there is no motion')
        stop = Stop(cast('TimedMotion', self.motion), begin, BRAKING_TIME)
        times = range(begin, stop.end + self.period, self.period)
        self.motion.extend(times, [stop.at(t) for t in times])

    def take_state(self, state: JointSample, now: int, simulated: bool,
                   unanswered: int = 0) -> bool:
        """
        Take a joint state, and return whether time begins.

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
        if unanswered != self._unanswered:
            self._count_missed(unanswered)
        verdict = self._stamps.classify(state.t, now, simulated)
        if verdict not in stamps.TAKEN:
            self._refuse_stamp(verdict, state.t)
        if verdict != stamps.NEXT:
            self._positions.forget()
        state = self._positions.follow(state)
        self._check_position(state)
        self._positions.take(state)
        is_next = verdict == stamps.NEXT and not self.watchdog.out
        self.watchdog.feed(now, self._has_sent)
        if self._has_sent and not is_next:
            self.health.restarts += 1
            self._restart_law(bumpless=not simulated)
        if verdict == stamps.RESTART:
            self.motion.restart()
        self.handle(Input.STATE)
        self.health.taken += 1
        self.last = self._pending = state
        self.lost_states.may_follow = False
        return verdict == stamps.RESTART

    def _refuse_stamp(self, verdict: str, t: int) -> NoReturn:
        """Refuse a state, but answer one that lockstep repeats."""
        is_repeated = verdict == stamps.REPEATED and self.simulated
        if is_repeated and self._pending is None and self._held is not None:
            self._send(self._held)
        reason = ''
        if self._has_sent and not is_repeated:
            reason = (f'stamp {seconds(t):.9f} s: {verdict}, '
                      f'{1e3 * seconds(self._stamps.lateness):.1f} ms late; allowed: increasing, '
                      f'at most {1e3 * seconds(self._stamps.limit):g} ms late (state_timeout)')
        raise RejectedMessage(verdict, reason)

    def _check_position(self, state: JointSample) -> None:
        """Refuse a jump, and trip if it stays."""
        last = self._positions.last
        if last is None or not (self.mode.sends_torque or self.mode is Mode.NO_STATE):
            return
        jump = find_jump(last, state)
        if jump is None:
            return
        text = self._describe_jump(jump)
        if self._positions.agrees(state):
            self._positions.take(state)
            self._trip(f'{text}; it stays there; check whether its encoder was reset or slips')
        raise RejectedMessage('position_jump', text)

    def _describe_jump(self, jump: Jump) -> str:
        """Return a text on a jump and its likely reason."""
        name = self._names[jump.joint]
        text = (f'{name} is at {jump.position:.4g} rad, but {1e3 * jump.elapsed:.3g} ms before it '
                f'was at {jump.last_position:.4g} rad with {jump.last_velocity:.3g} rad/s')
        return text if not jump.is_whole_turns else (
            f'{text}; the difference is a whole turn; if the joint turns endlessly, add it to '
            'continuous_joints')

    def answer(self, matched: bool, now: int = 0) -> Answer | None:
        """
        Answer the pending state if a torque may be sent.

        Parameters
        ----------
        matched : bool
            Whether the subscribers of the torque are matched.
        now : int
            Real time: on the clock of `take_state` [ns].

        Raises
        ------
        RejectedMessage
            If the law has no finite torque, or the way back to the reference is not finite.

        """
        state, law, simulated = self._pending, self._law, self.simulated
        if state is None or law is None:
            return None
        if not simulated and (self._is_silent(now) or self.rehearses):
            return None
        instant = law.instant(state.t)
        is_allowed = self.mode.allows_torque
        if self._guiding is not None and is_allowed and matched:
            if self._guiding.config is not law.config:
                self._guiding = HandGuiding(law.config, law.model, self.period)
            return self._answer_hand(self._guiding, law, state)
        points = None
        if is_allowed and matched:
            if not self._positions.anchored or self.motion.resumes(instant):
                state = self._anchor_turns(law, instant, state)
            points = self._desired_points(instant, state)
        if points is None:
            self.motion.pass_over(state.t, driven=is_allowed)
            self.handle(Input.NO_REFERENCE)
            return None
        if not simulated and self._trip_if_slow(self._answers.total, self._answers.window):
            return None
        steps_are_slow = not simulated and self._steps_are_slow
        # Before the first torque the cause of a motion is unknown. It may be a brake.
        late = 0 if simulated or steps_are_slow or self._held is None else (
            self.lost_states.periods_since(self._stamps.arrival(state.t), now))
        sample = law.try_step(state.q, state.dq, *points[0], points[1:],
                              None if steps_are_slow else state.t, instant, late)
        if sample is None:  # The state is pending, and the restarted law is asked again.
            law.reset(bumpless=True, held=self._held)
            raise RejectedMessage('overflow', (
                f'the law has no finite torque for q = {list(state.q)}, dq = {list(state.dq)}'))
        if not self._send_checked(law, sample):
            return None
        self._pending = None
        self._has_sent = self.lost_states.may_follow = True
        if self.motion.holding:
            self.handle(Input.HOLD_STILL)
        elif self.motion.overdue(state.t):
            self._hold_position()
        else:
            self.handle(Input.FOLLOW if self.motion.way_back is None else Input.LEAD_BACK)
        self.health.add(sample)
        return Answer(state, points[0], sample)

    def _answer_hand(self, guiding: HandGuiding, law: Controller, state: JointSample) -> Answer:
        """Answer a state of a robot that is guided by hand."""
        zero = (0.0,) * len(self._names)
        law.advance_payload()
        tau = guiding.torque(law.model, state.q, state.dq, self._held or zero)
        self._pending = None
        if not all(map(isfinite, tau)):
            raise RejectedMessage('overflow', (
                f'a hand has no finite torque for q = {list(state.q)}, dq = {list(state.dq)}'))
        self._send(tau)
        self._held, self._has_sent = tau, True
        self.lost_states.may_follow = False
        self.handle(Input.GUIDE)
        sample = Sample(tau, zero, zero, zero, tau, zero, zero, None)
        self.health.add(sample)
        return Answer(state, (state.q, state.dq, zero), sample)

    def guide(self, on: bool) -> str:
        """
        Begin or end guiding by hand, and tell what was done.

        After its end the robot is held where it is, until a reference rests there.
        """
        if on == (self._guiding is not None):
            return 'The robot is guided already.' if on else 'The robot was not guided.'
        if not on:
            self._leave_guiding()
            return 'The robot is held until a reference rests there.'
        if self._law is None or not self.mode.allows_torque:
            raise CtcError(f'The robot cannot be guided while the controller is '
                           f'{self.mode.text}.')
        self._guiding = HandGuiding(self._law.config, self._law.model, self.period)
        self._log.info('guided by hand, by a service')
        return 'The robot is guided by hand.'

    def _leave_guiding(self) -> None:
        """Hold the robot where it is, if it was guided."""
        if self._guiding is None:
            return
        self._guiding = None
        self.hold_reason = 'it was guided by hand'
        self.motion.hold()
        self._restart_law()

    def _anchor_turns(self, law: Controller, instant: int, state: JointSample) -> JointSample:
        """
        Return the state with the turns of the desired motion.

        It keeps them until the law begins again. After a pause without a torque the
        joints may have been turned, so that the law begins again if the turns are other ones.
        """
        point = self.motion.anchor_point(instant)
        if point is None:
            return state
        was_anchored = self._positions.anchored
        anchored = self._positions.anchor(state, point[0])
        if anchored is not state:
            self.last = self._pending = anchored
            if was_anchored:
                law.reset(bumpless=True, held=self._held)
        return anchored

    def _desired_points(self, instant: int, state: JointSample) -> list[Point] | None:
        """Return the desired points, if they are known."""
        try:
            return self.motion.desired(instant, state.q, state.dq, self.simulated)
        except ParameterError as error:
            raise RejectedMessage('overflow', str(error)) from None

    def _send_checked(self, law: Controller, sample: Sample) -> bool:
        """Send a torque unless it trips, and return whether."""
        if reason := self._trips.check(law, sample):
            self._trip(reason)
            return False
        self._send(sample.tau)
        self._held = sample.tau
        return True

    def _hold_position(self) -> None:
        """Count and report a reference that is late."""
        if self.handle(Input.HOLD):
            self.reference_outages += 1
            self._log.error(f'reference: no message for {seconds(self.motion.grace):g} s; the '
                            'robot holds its position', throttle_duration_sec=1.0)

    @property
    def answered(self) -> Answered:
        """States of the last second, and those answered in time."""
        return self._answers.total

    @property
    def rehearses(self) -> bool:
        """Return whether the loop is or will be measured."""
        return bool(self.rehearsal and self.least_answered and not self.simulated)

    def rehearse(self, now: int) -> bool:
        """
        Compute a torque for the pending state, and send none.

        Return whether one was computed, to be noted by `note_answer`. That is before the first
        torque in real time.
        """
        rehearsal, state = self.rehearsal, self._pending
        if rehearsal is None or self.last is None:
            return False
        if not self.rehearses:
            self.rehearsal = None
        elif rehearsal.is_over(now, self._answers.complete):
            self.rehearsal = None
            rehearsal.report(self._log)
            if self.mode.allows_torque:
                self._trip_if_slow(rehearsal.total, MIN_STATES)
        elif state is not None:
            return rehearsal.step(state)
        return False

    def _trip_if_slow(self, answered: Answered, min_states: int) -> bool:
        """Trip if too few states were answered, and return whether."""
        reason = shortfall(answered, self.least_answered, min_states)
        if reason:
            self._trip(reason)
        return bool(reason)

    def note_answer(self, end: int) -> None:
        """Count the last state as answered at `end` [ns]."""
        if self.last is None or self.simulated:
            return
        in_time = end - self._stamps.arrival(self.last.t) <= self.period
        self._answers.answer(in_time)
        if self.rehearsal is not None:
            self.rehearsal.answer(in_time)

    def _count_missed(self, unanswered: int) -> None:
        """Count new states that lack an answer."""
        missed, self._unanswered = unanswered - self._unanswered, unanswered
        if missed <= 0 or self.simulated:
            return
        if self.rehearsal is not None:
            self.rehearsal.miss(missed)
        if self.rehearses or self.mode.sends_torque or self.mode is Mode.NO_STATE:
            self._answers.miss(missed)

    @property
    def _steps_are_slow(self) -> bool:
        """
        Return whether steps are too slow for lost states, in real time.

        The law then goes on by one period a state.
        """
        return min(self.computing_times, default=0) > self.period

    def due(self) -> int | None:
        """
        Return when a predicted state is answered, if at all.

        Only in real time, and on the clock of `take_state` [ns].
        """
        if (self.law is None or self.last is None or not self.lost_states.may_follow
                or self.simulated or self._steps_are_slow or not self.mode.sends_torque):
            return None
        return self.lost_states.due(self._stamps.arrival(self.last.t), self.law.predicted_periods,
                                    self.watchdog.timeout)

    def predict(self, now: int) -> None:
        """
        Answer the predicted state at `now`, as `due`.

        After `state_timeout` no torque is sent, however late this is called.

        Raises
        ------
        RejectedMessage
            As `answer`.

        """
        law, last = self.law, self.last
        assert law is not None and last is not None
        self.lost_states.may_follow = False
        if self._is_silent(now):
            return
        predicted = law.predicted_periods
        periods = self.lost_states.periods_since(self._stamps.arrival(last.t), now)
        points = self._desired_points(law.instant(last.t + periods * self.period), last)
        sample = None if points is None else law.predicted_step(
            *points[0], points[1:], periods - predicted)
        self.lost_states.may_follow = sample is not None and self._send_checked(law, sample)

    def _is_silent(self, now: int) -> bool:
        """Return whether `check_silence` is due, as after a stall."""
        return not self.simulated and self.watchdog.silence(now) > self.watchdog.timeout

    def check_silence(self, now: int) -> None:
        """End the torques if no state has come."""
        if self.watchdog.check(now):
            self._pending = None
            self.handle(Input.SILENCE)

    def _trip(self, reason: str) -> None:
        """End the torques until a reset."""
        self.tripped = reason
        self._leave_guiding()
        self._answers.clear()
        self.handle(Input.TRIP)
        self.end_torque()
        self._log.error(f'{reason}; no torque until ~/reset')

    def request(self, event: Input) -> bool:
        """Handle a request, and return whether anything changed."""
        if event is Input.DISABLE:
            self._leave_guiding()
        if changed := self.handle(event):
            self._log.info(f'{event.value} by a service')
            if event is not Input.DISABLE:
                self._restart_law()
        return changed

    def _restart_law(self, bumpless: bool = True) -> None:
        self._positions.anchored = False
        if self.law is not None:
            self.law.reset(bumpless, self._held if bumpless else None)
            self._trips.restart()

    def handle(self, event: Input) -> bool:
        """Handle an input, and return whether the mode changed."""
        previous = self.mode
        mode = previous.after(event)
        if mode is previous:
            return False
        self.mode = mode
        if previous.sends_torque and not mode.sends_torque and not (
                self.simulated and mode is Mode.WAITING_FOR_REFERENCE):
            self.end_torque()
        return True

    def end_torque(self) -> None:
        """End the torques, in real time by a last 0."""
        if self._held is not None and not self.simulated:
            self._send((0.0,) * len(self._names))
        self._held = None
