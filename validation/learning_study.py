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
Learning from repetition on foreign robots: error by pass, against rivals, as rows and tables.

A run is a periodic motion from rest. A pass is one period of it. Between two passes the correction
that was learned from the last one fades in. Errors are those of the true links against the motion
that is asked for, not against a corrected one.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
import dataclasses
import json
from multiprocessing import get_context
from pathlib import Path
import time
from typing import Any

import arms_study
from ctc_chattering.configuration.arm_knowledge import ArmFacts, ASSUMED_ROTOR
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller import Controller
from ctc_chattering.controller.trips import TripMonitor
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.learning.design import filter_for
from ctc_chattering.learning.learner import Learner, LearningState
from ctc_chattering.learning.learning_filter import low_pass
from ctc_chattering.learning.motion import motion_of
from ctc_chattering.learning.simulated_learner import make_learner
from ctc_chattering.simulation.closed_loop import ClosedLoop, LearnedTable, run_closed_loop
from ctc_chattering.trajectory.joint_limits import read_limits
from ctc_chattering.trajectory.path_clock import PathClock, PathTime
from ctc_chattering.trajectory.reference import make_motion
from learning_robots import (
    Case,
    draw_truth,
    ENGINES,
    ForeignRobot,
    PERIOD_S,
)
from machine_code import compile_step
import numpy as np
from rigid_bodies import Array, dynamics
import robots

#: Arms that no page of the documentation uses, with their rated loads [kg].
ARMS = {'z1': 2.0, 'baxter': 2.2}
#: Middles of their motions [rad], where the drives hold the arm with torque to spare.
CENTRES = {'z1': robots.arm('z1').centre, 'baxter': (0.0, 0.7, 0.0, 1.6, 0.0, 0.5, 0.0)}
#: Period of the motion [s].
MOTION_S = 2.0
#: Duration of the smooth start, and of the first period that no pass counts [s].
START_S = 3.0
#: Duration in which a new correction fades in [s].
FADE_S = 0.75
#: Passes with a correction, after one without.
PASSES = 8
#: Pass before which a load is picked up.
LOAD_PASS = 5
#: Pass that is stopped.
STOPPED_PASS = 4
#: Duration in which the motion slows down or takes up speed again [s].
SLOW_S = 0.3
#: Duration of a stop [s].
STOP_S = 0.5
#: A run with a larger error has diverged [rad].
DIVERGED_RAD = 1.0
#: Room for the correction of the reference within the limits [rad].
BOUND_RAD = 0.1
#: Largest learned torque per effort limit.
TORQUE_BOUND = 0.5
#: Share of the effort limits that friction and the nominal model may take.
TORQUE_SHARE = 0.7
#: Learning by the torque: part of the law's own feedback, kp and kv times the inertia, as in
#: feedback error learning.
TORQUE_GAIN = 0.5
#: Cut-off frequency of a filter without delay [Hz].
TORQUE_CUTOFF = 20.0
#: Time by which a torque is earlier than its error: lag, delay and half a period [s].
TORQUE_LEAD_S = 4e-3
#: Growth of the error over two passes from which on learning ends.
GROWTH = 1.2
#: Samples of a pass, and of a fade.
N = round(MOTION_S / PERIOD_S)
FADE = round(FADE_S / PERIOD_S)

#: Circumstances by name.
CASES = {
    'regular': Case(),
    'lost 2 %': Case(lost=0.02),
    'lost 10 %': Case(lost=0.1),
    'jitter': Case(jitter=True),
    'load': Case(load=0.5),
    'sticky': Case(sticky=True),
    'stopped': Case(stopped=True),
    'elastic 20 Hz': Case(resonance=20.0),
    'elastic 20 Hz, encoder at the motor': Case(resonance=20.0, encoder='motor'),
}
#: Laws by name; `half` is `observer_feedback` at half its bandwidth.
LAWS = ('pd_gravity', 'compensation', 'observer_feedback', 'half', 'chattering', 'slotine_li')
#: Laws that get better without learning, since they adapt the level of friction.
ADAPTIVE_LAWS = ('observer_feedback', 'half', 'slotine_li')
#: Ways to learn: not at all; by the package; the torque by plain iterations.
NOTHING, PACKAGE, TORQUE = 'nothing', 'package', 'torque'


@dataclasses.dataclass(frozen=True)
class Task:
    """A run: what it is and how it learns."""

    arm: str
    engine: str
    case: str
    law: str
    learns: str
    seed: int
    passes: int = PASSES


class Arm:
    """A described arm with its limits."""

    def __init__(self, name: str) -> None:
        self.described = dataclasses.replace(robots.arm(name), centre=CENTRES[name])
        self.effort, self.velocity = self.described.limits()
        limits = read_limits(self.described.urdf, self.described.joints)
        self.lowest, self.highest = np.array([x.position for x in limits]).T


def draw_motion(arm: Arm, centre: Array, dry_per_effort: float, rng: np.random.Generator
                ) -> dict[str, Any]:
    """
    Return the parameters of a drawn motion: sinusoids whose common period is `MOTION_S`.

    It is as large as the limits of velocity and torque allow, with rotors, friction and load.
    """
    n = arm.described.n
    cycles = rng.integers(1, 3, n) / MOTION_S
    amplitude = rng.uniform(0.15, 0.4, n)
    amplitude = np.minimum(amplitude, 0.6 * arm.velocity / (2.0 * np.pi * cycles))
    centre = centre + rng.uniform(-0.15, 0.15, n)
    # The rest is for the correction.
    room = np.minimum(arm.highest - centre, centre - arm.lowest) - BOUND_RAD
    amplitude = np.minimum(amplitude, room)
    phase = rng.uniform(0.0, 2.0 * np.pi, n)
    while not (largest_torque(arm, centre, amplitude, cycles, phase)
               < (TORQUE_SHARE - dry_per_effort) * arm.effort).all():
        amplitude *= 0.8
        centre = centre + 0.2 * (np.array(arm.described.centre) - centre)
        assert amplitude.max() > 0.02, 'the arm cannot hold itself'
    return {'profile': 'sinusoid', 'center': centre.tolist(), 'amplitude': amplitude.tolist(),
            'frequency': cycles.tolist(), 'phase': phase.tolist(), 'start_duration': 2.0}


def largest_torque(arm: Arm, centre: Array, amplitude: Array, cycles: Array, phase: Array
                   ) -> Array:
    """Return the largest torques of a motion, shape (n,) [N·m]."""
    omega, n = 2.0 * np.pi * cycles, arm.described.n
    bodies, mass, bias = arm.described.bodies(), np.zeros((n, n)), np.zeros(n)
    rotors = np.diag(ASSUMED_ROTOR * arm.effort)
    largest = np.zeros(n)
    for t in np.linspace(0.0, MOTION_S, 40, endpoint=False):
        angle = omega * t + phase
        q, dq = centre + amplitude * np.sin(angle), amplitude * omega * np.cos(angle)
        dynamics(bodies, q, dq, mass, bias)
        torque = (mass + rotors) @ (-omega * omega * amplitude * np.sin(angle)) + bias
        largest = np.maximum(largest, np.abs(torque))
    return largest


def make_setup(task: Task, arm: Arm) -> Setup:
    """Return the parameters of a run: gains by rule for what a user knows of the arm."""
    case = CASES[task.case]
    law = 'observer_feedback' if task.law == 'half' else task.law
    facts = ArmFacts(resonance=case.resonance) if case.resonance else ArmFacts()
    arms_study.DRY = case.dry_per_effort
    described = arm.described
    setup = arms_study.setups(described.urdf, described.joints, (law,), facts, False)[law]
    motion = draw_motion(arm, np.array(described.centre), case.dry_per_effort,
                         np.random.default_rng((task.seed, 50)))
    setup = setup.changed({
        'reference': motion, 'plant': {'initial_position': motion['center']}})
    if task.law == 'chattering':
        # The paper's. Those of the file are by the rule of `observer_feedback`.
        setup = setup.changed({'controller': {'kp': 100.0, 'kv': 50.0}})
    if task.law == 'half':
        c = setup.controller
        setup = setup.changed({'controller': {
            'kp': [x / 4.0 for x in c.kp], 'kv': [x / 2.0 for x in c.kv],
            'estimator_bandwidth': c.estimator_bandwidth / 2.0}})
    return setup


class Course:
    """
    The motion that is asked for, with its passes.

    Attributes
    ----------
    first, last : ndarray of int, shape (passes + 1,)
        Samples of each pass; after the last one comes a fade.
    index, rate, acceleration : ndarray, shape (count,)
        Position along the motion [samples], its rate, and the change of the rate [1/s].
    asked : ndarray, shape (count, 3, n)
        The motion that is asked for.
    period : ndarray, shape (N, 3, n)
        One period of it.

    """

    def __init__(self, setup: Setup, case: Case, passes: int, ahead: int) -> None:
        lengths = np.full(passes + 1, N)
        rate = np.ones(round(START_S / PERIOD_S) + (passes + 2) * (N + FADE) + N)
        start = round(START_S / PERIOD_S)
        first = start + (N + FADE) * np.arange(passes + 1)
        if case.stopped and passes >= STOPPED_PASS:
            slow, stop = round(SLOW_S / PERIOD_S), round(STOP_S / PERIOD_S)
            s = (np.arange(slow) + 0.5) / slow
            fall = 1.0 - s ** 3 * (10.0 - 15.0 * s + 6.0 * s * s)
            dip = np.concatenate((fall, np.zeros(stop), fall[::-1]))
            at = first[STOPPED_PASS] + N // 2
            rate[at:at + len(dip)] = dip
            longer = stop + slow
            lengths[STOPPED_PASS] += longer
            first[STOPPED_PASS + 1:] += longer
        self.first, self.last = first, first + lengths
        self.count = int(self.last[-1]) + FADE
        total = self.count + ahead + 1
        self.rate = rate[:total]
        self.index = np.concatenate(([0.0], np.cumsum(self.rate)[:-1]))
        self.acceleration = np.gradient(self.rate, PERIOD_S)
        plant = setup.plant
        initial = dict(zip(plant.joint_names, zip(plant.initial_position, plant.initial_velocity)))
        motion = make_motion(setup.reference, None, initial)
        h = round(1e9 * PERIOD_S)
        beginning = np.array([motion.at(k * h) for k in range(start)])
        self.period = np.array([motion.at(k * h) for k in range(2 * N, 3 * N)])
        self.asked = np.concatenate((beginning, self.sample(self.period, start, total)))

    def sample(self, period: Array, first: int, last: int) -> Array:
        """Return samples of a periodic motion, shape (N, 3, n), along the course."""
        s = self.index[first:last]
        k = np.floor(s + 1e-6).astype(int)
        part = np.maximum(s - k, 0.0)[:, None, None]
        q, dq, ddq = np.moveaxis(
            (1.0 - part) * period[k % N] + part * period[(k + 1) % N], 1, 0)
        rate, change = self.rate[first:last, None], self.acceleration[first:last, None]
        return np.stack((q, rate * dq, rate * rate * ddq + change * dq), axis=1)


def through(x: Array, response: Any) -> Array:
    """Return periodic samples, shape (N, n), through a filter with a frequency response."""
    y: Array = np.fft.irfft(response[:, None] * np.fft.rfft(x, axis=0), N, axis=0)
    return y


class TorqueLearner:
    """
    The torque that is added, learned from the errors of passes.

    Attributes
    ----------
    added : ndarray, shape (N, n)
        Torque in each sample of a period [N·m].

    """

    def __init__(self, task: Task, setup: Setup, arm: Arm) -> None:
        n = arm.described.n
        self.added = self.best = np.zeros((N, n))
        self.errors: list[float] = []
        self.learns = task.learns == TORQUE
        self.frozen = False
        mass, bias = np.zeros((n, n)), np.zeros(n)
        dynamics(arm.described.bodies(), np.array(arm.described.centre), np.zeros(n), mass, bias)
        mass += np.diag(setup.controller.rotor_inertia)
        alone = 1.0 / np.diagonal(np.linalg.inv(mass))
        self.kp, self.kd = (alone * x for x in (
            np.array(setup.controller.kp), np.array(setup.controller.kv)))
        self.bound = TORQUE_BOUND * arm.effort

    def learn(self, error: Array) -> None:
        """Take the errors of a pass, shape (N, n) [rad]."""
        if not self.learns or self.frozen:
            return
        size = float(np.sqrt(np.square(error).mean(axis=0)).max())
        if not self.errors or size < min(self.errors):
            self.best = self.added
        self.errors.append(size)
        last = self.errors[-3:]
        if len(last) == 3 and last == sorted(last) and last[2] > GROWTH * last[0]:
            self.frozen, self.added = True, self.best
            return
        frequency = np.fft.rfftfreq(N, PERIOD_S).astype(float)
        s = 2j * np.pi * frequency
        q = low_pass(frequency, TORQUE_CUTOFF)
        smooth = through(error, q)
        torque = self.kp * smooth + self.kd * through(smooth, s)
        step = TORQUE_GAIN * through(torque, np.exp(s * TORQUE_LEAD_S))
        added = through(self.added + step, q)
        self.added = np.clip(added, -self.bound, self.bound)


def run(task: Task) -> dict[str, Any]:
    """Return what happens, as a row."""
    began = time.process_time()
    arm, case = Arm(task.arm), CASES[task.case]
    setup = make_setup(task, arm)
    delay = setup.controller.input_delay
    course = Course(setup, case, task.passes, delay)
    rng = np.random.default_rng((task.seed, list(ARMS).index(task.arm), 53))
    truth = draw_truth(case, arm.effort, arm.velocity, rng)
    start = course.asked[0, 0]
    engine = ENGINES[task.engine](arm.described, arm.effort, truth, case, start, task.seed)
    robot = ForeignRobot(engine, case, course.count, task.seed)
    if case.load and task.passes >= LOAD_PASS:
        robot.pick_at(int(course.last[LOAD_PASS - 1]), case.load * ARMS[task.arm])
    law = Controller(setup.controller, model_of(setup.controller, arm.described.urdf))
    compile_step(law)
    if task.learns == PACKAGE:
        outcome = by_package(task, setup, robot, course, law)
    else:
        outcome = by_hand(task, setup, robot, course, law, arm)
    return dataclasses.asdict(task) | outcome | {
        **scores(robot, course), 'seconds': round(time.process_time() - began, 1)}


def by_hand(task: Task, setup: Setup, robot: ForeignRobot, course: Course, law: Controller,
            arm: Arm) -> dict[str, Any]:
    """Run the loop without learning, or with a learned torque."""
    learner = TorqueLearner(task, setup, arm)
    end, trip = closed_loop(robot, law, course, learner, CASES[task.case])
    return {'end': end, 'trip': trip, 'frozen': learner.frozen}


class StopClock:
    """Path time with a stop, in the place of `PathClock`."""

    t0 = end = 0

    def __init__(self, course: Course) -> None:
        """Make the stop of a course."""
        begin = int(course.first[STOPPED_PASS] + N // 2) * 1_000_000
        self.stop = PathClock().slew(begin, 0.0, SLOW_S)
        self.go_on = self.stop.slew(begin + round(1e9 * (SLOW_S + STOP_S)), 1.0, SLOW_S)

    def at(self, t: int) -> PathTime:
        """Return the path time at t [ns]."""
        return (self.stop if t < self.go_on.t0 else self.go_on).at(t)


class StoppedTable(LearnedTable):
    """A motion that is stopped, and goes on, as by the services of the reference node."""

    def __init__(self, stop: StopClock, learner: Learner, *arguments: Any) -> None:
        self._stop = stop
        self._own_learner = learner
        self._is_interrupted = False
        super().__init__(learner, *arguments)

    def _fill(self) -> None:
        self._clock = self._stop  # type: ignore[assignment]
        super()._fill()

    def _report(self, stamp: int, e: Array) -> None:
        if stamp >= self._stop.stop.t0 and not self._is_interrupted:
            self._is_interrupted = True
            self._own_learner.interrupt(self._stop.at(self._stop.go_on.end).instant)
        super()._report(stamp, e)


def by_package(task: Task, setup: Setup, robot: ForeignRobot, course: Course, law: Controller
               ) -> dict[str, Any]:
    """Run the loop of the package, which learns."""
    setup = setup.changed({
        'plant': {'duration': robot.last * PERIOD_S}, 'reference': {'learning': True},
        'controller': {'error_limit': DIVERGED_RAD}})
    plant: Any = robot
    start = dict(zip(setup.plant.joint_names, zip(*map(tuple, robot.measured))))
    motion = make_motion(setup.reference, None, start)
    row = {'end': '', 'trip': '', 'frozen': False}
    try:
        learner = make_learner(setup, plant, law.model)
        designed = filter_for(motion_of(setup.reference, None, motion), setup.reference,
                              setup.controller, law.model)
    except CtcError as error:
        return row | {'end': f'refused: {error}'}
    try:
        if CASES[task.case].stopped:
            table = StoppedTable(
                StopClock(course), learner, motion, setup.reference, setup.controller,
                robot.period_ns, robot.last + 1 + setup.controller.input_delay)
            table.run(ClosedLoop(plant, law, table.rows))
        else:
            run_closed_loop(setup.plant, setup.controller, setup.reference, robot=plant,
                            model=law.model, learner=learner)
    except CtcError as error:
        row['end'] = str(error)
    _take_windows(course, learner, CASES[task.case])
    return row | {'frozen': learner.state is LearningState.STOPPED, 'cutoff': designed.cutoff,
                  'contraction': designed.contraction, 'problem': learner.problem}


def _take_windows(course: Course, learner: Learner, case: Case) -> None:
    """Have a course the passes that a learner has measured, and the one that was stopped."""
    windows = [(p.begin, p.end) for p in learner.passes]
    if case.stopped:
        stopped = course.first[STOPPED_PASS], course.last[STOPPED_PASS]
        before = [w for w in windows if w[0] < course.index[stopped[0]] * ForeignRobot.period_ns]
        later = round(1e9 * (STOP_S + SLOW_S))
        after = [(begin + later, end + later) for begin, end in windows[len(before):]]
        windows = [*before, tuple(k * ForeignRobot.period_ns for k in stopped), *after]
    if windows:
        samples = np.rint(np.array(windows) / ForeignRobot.period_ns)
        course.first, course.last = samples.astype(int).T


def closed_loop(robot: ForeignRobot, law: Controller, course: Course, learner: TorqueLearner,
                case: Case) -> tuple[str, str]:
    """Run all passes; return why it ended early, and the first trip."""
    n, delay = robot.n, law.config.input_delay
    monitor, trip = TripMonitor(law.config.joint_names, robot.period_ns), ''
    torque = np.zeros((len(course.asked), n))
    held: Sequence[float] = [0.0] * n
    instants: list[float] = []
    errors: list[Array] = []
    done = 0
    for k in range(course.count):
        if done < len(course.first) and k == course.last[done]:
            if not (case.stopped and done == STOPPED_PASS):
                before = learner.added
                learner.learn(_on_grid(instants, errors, course, done))
                _take(course, learner, before, k, torque)
            else:
                _take(course, learner, learner.added, k, torque)
            done += 1
            instants, errors = [], []
        if not robot.lost:
            q, dq = (x.tolist() for x in robot.measured)
            (q_d, dq_d, ddq_d), *ahead = course.asked[k:k + delay + 1].tolist()
            sample = law.try_step(q, dq, q_d, dq_d, ddq_d, ahead, robot.stamp,
                                  k * robot.period_ns)
            if sample is None:
                return f'no finite torque at {k * PERIOD_S:.2f} s', trip
            trip = trip or str(monitor.check(law, sample) or '')
            held = sample.tau
            if k >= course.first[min(done, len(course.first) - 1)]:
                s = robot.offset
                instants.append(k + s / PERIOD_S)
                asked = course.asked[k]
                errors.append(asked[0] + s * asked[1] - q)
        robot.feedforward = torque[k]
        robot.step(held)
        error = np.abs(course.asked[k + 1, 0] - robot.truth[-1]).max()
        if not error < DIVERGED_RAD:
            return f'diverged at {k * PERIOD_S:.2f} s', trip
    return '', trip


def _on_grid(instants: Sequence[float], errors: Sequence[Array], course: Course, done: int
             ) -> Array:
    """Return the errors of a pass in each sample of a period, shape (N, n)."""
    at = np.array(instants) - course.first[done] + course.index[course.first[done]]
    columns = np.array(errors).T
    grid = np.arange(N)
    return np.column_stack([np.interp(grid, at % N, x, period=N) for x in columns])


def _take(course: Course, learner: TorqueLearner, before: Array, k: int, torque: Array) -> None:
    """Fade from what was added to what is added, from sample k on until the next pass ends."""
    s = np.clip(np.arange(len(torque) - k) / FADE, 0.0, 1.0)[:, None]
    index = np.rint(course.index[k:]).astype(int) % N
    w = s * s * (3.0 - 2.0 * s)
    torque[k:] = before[index] + w * (learner.added - before)[index]


def scores(robot: ForeignRobot, course: Course) -> dict[str, Any]:
    """Return RMS error of each joint [rad] and torque variation [N·m/s] by pass."""
    truth, commands = np.array(robot.truth), np.array(robot.commands)
    rms, variation = [], []
    off = PERIOD_S * 0.25 * robot.off[:, None]
    for first, last in zip(course.first, course.last):
        if last > len(commands):
            break
        asked = course.asked[first:last]
        error = asked[:, 0] + off[first:last] * asked[:, 1] - truth[first:last]
        rms.append(np.sqrt(np.square(error).mean(axis=0)).tolist())
        change = np.abs(np.diff(commands[first:last], axis=0)).sum()
        variation.append(float(change / ((last - first) * PERIOD_S)))
    return {'rms': rms, 'variation': variation}


def tasks(options: argparse.Namespace) -> Iterator[Task]:
    """Yield the runs of a study."""
    for seed in range(options.first, options.first + options.seeds):
        for arm in options.arms:
            for engine in options.engines:
                which = list(ARMS).index(arm) + list(ENGINES).index(engine) + seed
                if options.alternate and which % 2:
                    continue
                for case in options.cases:
                    for law in options.laws:
                        for way in options.ways:
                            few = (way == NOTHING and not CASES[case].load
                                   and law not in ADAPTIVE_LAWS)
                            yield Task(arm, engine, case, law, way, seed,
                                       1 if few else options.passes)


def line(row: dict[str, Any]) -> str:
    """Return a row as text: the worst joint by pass."""
    errors = ' '.join(f'{max(x):.1e}' for x in row['rms'])
    variation = row['variation'] or [np.nan]
    return (f"{row['arm']:6s} {row['engine'][:4]} {row['case']:14.14s} {row['law']:17s} "
            f"{row['learns']:9s} {errors} | {variation[0]:.0f} -> {variation[-1]:.0f} "
            f"{row['end']} {row['trip'][:40]} {'frozen' if row['frozen'] else ''} "
            f"{row.get('cutoff', 0.0):.1f} Hz "
            f"{row['seconds']} s")


def worst(rms: Sequence[float]) -> float:
    """Return the error of the worst joint [rad]."""
    return max(rms)


class Comparison:
    """
    Rows of the same robot, motion and law, with and without learning.

    Attributes
    ----------
    without : float
        Error of the last pass without learning [rad], inf if the run did not last.
    by_way : dict
        Row of each way to learn.

    """

    def __init__(self, rows: Sequence[dict[str, Any]]) -> None:
        self.by_way = {row['learns']: row for row in rows}
        self.without = self.final(NOTHING)

    def final(self, way: str) -> float:
        """Return the error of the last pass [rad]; inf if the run did not last, NaN if none."""
        row = self.by_way.get(way)
        if row is None:
            return np.nan
        return np.inf if row['end'] or not row['rms'] else worst(row['rms'][-1])

    def gain(self, way: str) -> float:
        """Return by what factor the last error is smaller than without."""
        return self.without / self.final(way)

    def variation(self, way: str, at: int) -> float:
        """Return the torque variation of a pass [N·m/s], NaN if there is none."""
        row = self.by_way.get(way)
        return row['variation'][at] if row and row['variation'] else np.nan


def compared(rows: Sequence[dict[str, Any]]) -> dict[tuple[Any, ...], Comparison]:
    """Return comparisons by arm, engine, seed, case and law; of equal rows the last counts."""
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for row in rows:
        key = tuple(row[x] for x in ('arm', 'engine', 'seed', 'case', 'law'))
        groups.setdefault(key, []).append(row)
    return {key: Comparison(group) for key, group in groups.items()}


def tables(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield lines of Markdown: each comparison, then medians and worst."""
    comparisons = compared(rows)
    slotine = {key[:4]: c.without for key, c in comparisons.items() if key[4] == 'slotine_li'}
    ways = [way for way in (PACKAGE, TORQUE) if any(r['learns'] == way for r in rows)]
    yield ('| arm | engine | case | law | without | '
           + ' | '.join(f'{way}, after passes 1, 2, 4, 8 | factor' for way in ways)
           + ' | slotine_li without | variation without | '
           + ' | '.join(f'with {way}' for way in ways) + ' |')
    yield '|---' * (7 + 3 * len(ways)) + '|'
    for key, c in comparisons.items():
        cells = [key[0], key[1], key[3], key[4], f'{c.without:.1e}']
        for way in ways:
            errors = [worst(x) for x in c.by_way.get(way, {'rms': ()})['rms']]
            end = c.by_way[way]['end'] if way in c.by_way else ''
            shown = ' '.join(f'{errors[k]:.1e}' for k in (1, 2, 4, 8) if k < len(errors))
            cells += [end[:60] or shown, f'{c.gain(way):.3g}']
        cells.append(f'{slotine.get(key[:4], np.nan):.1e}')
        cells += [f'{c.variation(NOTHING, -1):.0f}',
                  *(f'{c.variation(way, -1):.0f}' for way in ways)]
        yield f'| {" | ".join(cells)} |'
    yield ''
    yield '| law | way | runs | median factor | least factor, where | below 1 / 1.1 |'
    yield '|---|---|---|---|---|---|'
    for law in dict.fromkeys(key[4] for key in comparisons):
        for way in ways:
            gains = {key: c.gain(way) for key, c in comparisons.items()
                     if key[4] == law and np.isfinite(c.without) and way in c.by_way}
            if gains:
                least = min(gains, key=lambda key: gains[key])
                worse = sum(x < 1.0 / 1.1 for x in gains.values())
                yield (f'| {law} | {way} | {len(gains)} | {np.median(list(gains.values())):.3g} '
                       f'| {gains[least]:.3g}, {" ".join(map(str, least[:4]))} | {worse} |')


def main() -> None:
    """Run the study, and write and print its rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--arms', nargs='*', default=list(ARMS))
    parser.add_argument('--engines', nargs='*', default=list(ENGINES))
    parser.add_argument('--cases', nargs='*', default=list(CASES))
    parser.add_argument('--laws', nargs='*', default=list(LAWS))
    parser.add_argument('--ways', nargs='*', default=[NOTHING, PACKAGE, TORQUE])
    parser.add_argument('--seeds', type=int, default=1)
    parser.add_argument('--first', type=int, default=5207)
    parser.add_argument('--passes', type=int, default=PASSES)
    parser.add_argument('--jobs', type=int, default=1)
    parser.add_argument('--all', dest='alternate', action='store_false',
                        help='run every arm on every engine, not each on one of them by seed')
    parser.add_argument('--rows', type=Path, default=Path('learning.jsonl'))
    parser.add_argument('--quick', action='store_true', help='few circumstances and laws')
    parser.add_argument('--tables', type=Path, nargs='*',
                        help='print the tables of these rows instead')
    options = parser.parse_args()
    if options.tables:
        lines = [x for path in options.tables for x in path.read_text().splitlines()]
        print(*tables([json.loads(x) for x in lines]), sep='\n')
        return
    if options.quick:
        options.cases = ['regular', 'lost 10 %', 'load']
        options.laws = ['pd_gravity', 'half', 'slotine_li']
    with get_context('spawn').Pool(options.jobs) as pool, options.rows.open('a') as file:
        for row in pool.imap(run, list(tasks(options))):
            print(line(row), flush=True)
            file.write(json.dumps(row) + '\n')
            file.flush()


if __name__ == '__main__':
    main()
