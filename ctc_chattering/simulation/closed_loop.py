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
Simulate the closed loop without ROS.

`analysis.result.simulate` calls `simulate`, and so do `ctc simulate`, maps and searches. Plant,
controller and reference are those of the nodes. Each is given by its configuration. Plant and
model may also be given as objects. At every sample the controller computes a torque from the
measured state. The plant holds it until the next sample. The loop runs as machine code
(`CompiledLoop`) where that is possible, otherwise in Python. A `Corrector` may correct the motion
while it runs: the loop is then advanced in segments.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
import dataclasses
from threading import get_ident
from typing import Any, Protocol

from ctc_chattering.compiled.records import described
from ctc_chattering.control.compiled_step import CompiledStep
from ctc_chattering.control.controller import Controller, ControllerConfig, Sample
from ctc_chattering.controller.trips import joint_beyond
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.angles import TURN, turns_to
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.simulation.compiled_loop import (
    BEYOND_LIMIT,
    CompiledLoop,
    DIVERGED,
    empty_samples,
    NO_TORQUE,
    Samples,
)
from ctc_chattering.simulation.plant import diverged, make_plant, Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.plant_step import CompiledPlantStep
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.path_clock import PathClock, ScaledMotion
from ctc_chattering.trajectory.reference import make_motion, reference_table, ReferenceConfig
from ctc_chattering.trajectory.transitions import TimedMotion
from ctc_chattering.trajectory.waypoints import Route
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
#: Calls of `progress` during a run in Python, at least where there are as many samples.
_PROGRESS_CALLS = 100


@dataclasses.dataclass(frozen=True)
class Event:
    """
    Parameters that change at a sample.

    Attributes
    ----------
    time : float
        The change is in force from the first sample at or after this time [s].
    node : str
        ``plant`` or ``controller``.
    values : mapping
        New values by parameter name.

    """

    time: float
    node: str
    values: Mapping[str, Any]


@dataclasses.dataclass(frozen=True)
class Run:
    """
    The N recorded samples of a run with n joints.

    For a prismatic joint rad is m, and N·m is N.

    Attributes
    ----------
    t : ndarray, shape (N,)
        Time [s].
    q, dq : ndarray, shape (N, n)
        Position [rad] and velocity [rad/s].
    q_d, dq_d, ddq_d : ndarray, shape (N, n)
        Desired position [rad], velocity [rad/s] and acceleration [rad/s²].
    tau : ndarray, shape (N, n)
        Torque sent at the sample, to be held until the next [N·m].
    v : ndarray, shape (N, n)
        Filtered error of equation (3) [rad/s].
    correction : ndarray, shape (N, 3, n), optional
        Part of q_d [rad], dq_d [rad/s] and ddq_d [rad/s²] that was learned from earlier passes.
        The errors are those from the desired motion without it.
    compiled : bool
        Whether machine code computed it.

    """

    t: Array
    q: Array
    dq: Array
    q_d: Array
    dq_d: Array
    ddq_d: Array
    tau: Array
    v: Array
    correction: Array | None = dataclasses.field(default=None, kw_only=True)
    compiled: bool = dataclasses.field(default=False, kw_only=True)

    @property
    def desired(self) -> tuple[Array, Array, Array]:
        """Return q_d, dq_d and ddq_d without the correction, each of shape (N, n)."""
        followed = self.q_d, self.dq_d, self.ddq_d
        if self.correction is None:
            return followed
        q_d, dq_d, ddq_d = followed - self.correction.swapaxes(0, 1)
        return q_d, dq_d, ddq_d

    @property
    def e(self) -> Array:
        """Return the position error q_d - q [rad], shape: (N, n)."""
        return self.desired[0] - self.q

    @property
    def de(self) -> Array:
        """Return the velocity error dq_d - dq [rad/s], shape: (N, n)."""
        return self.desired[1] - self.dq


class Corrector(Protocol):
    """A correction of the motion, learnt while it runs. Joints are in the reference's order."""

    def corrected(self, motion: TimedMotion) -> TimedMotion:
        """Return a motion over path time with its correction."""

    def known_until(self) -> int | None:
        """Return the path time before which the correction is final [ns], None for ever."""

    def add(self, s: int, q_d: Sequence[float], e: Sequence[float]) -> None:
        """Take desired position and error, shape (n,) [rad], at path time `s` [ns]."""


@np.errstate(all='ignore')  # An overflow gives a torque that is not finite.
def run_closed_loop(plant: PlantConfig, controller: ControllerConfig, reference: ReferenceConfig,
                    events: Sequence[Event] = (),
                    progress: Callable[[float], None] | None = None, truth: bool = False,
                    route: Route | None = None, robot: Plant | None = None,
                    model: Model | None = None, learner: Corrector | None = None) -> Run:
    """
    Return the samples of the closed loop.

    They are from t = 0 to the plant's `duration`, both included. Samples whose measurement is lost
    are left out. Timing is that of the nodes in lockstep.

    Parameters
    ----------
    plant, controller, reference
        Consistent configurations (`configuration.loop_setup.check_agreement`). All three name the
        same joints, the reference in any order.
    events : sequence of Event
        Changes of parameters during the run.
    progress : callable, optional
        Called with the simulated time [s]: machine code calls it only with 0 and `duration`.
    truth : bool
        Record the true state. By default the measured state is recorded, as in a bag.
    route : Route, optional
        Waypoints in place of the reference's profile.
    robot : Plant, optional
        Plant in its initial state, made for `plant`. The default is a new one.
    model : Model, optional
        Model of the controller. The default is the one that its configuration names.
    learner : Corrector, optional
        Corrects the motion, from every `state_decimation`-th sample. It must not simulate.

    Raises
    ------
    CtcError
        If `duration` is 0, the motion diverges, the law has no finite torque, a position error
        exceeds `error_limit`, or the waypoints are invalid.

    """
    if plant.duration <= 0.0:
        raise CtcError('duration: a simulation must end; set the duration of the plant above 0')
    robot = robot or make_plant(plant)
    law = Controller(controller, model)
    start = tuple(zip(plant.joint_names, zip(*map(tuple, robot.measured))))
    endless = dict(zip(controller.joint_names, law.continuous))
    continuous = tuple(endless.get(name, False) for name in reference.joint_names)
    count = robot.last + 1 + controller.input_delay
    start = start if reference.start_duration or route is not None else ()
    table = desired = reference_table(
        reference, route, start, controller.joint_names, robot.period_ns, count, continuous)
    learned: LearnedTable | None = None
    if learner is not None:
        motion = make_motion(reference, route, dict(start), continuous=continuous)
        learned = LearnedTable(learner, motion, reference, controller, robot.period_ns, count)
        table = learned.rows
    report_progress = progress or (lambda _: None)
    report_progress(0.0)
    compiled_loop = None if events else compiled_loop_of(robot, law)
    if compiled_loop is not None and compiled_loop.compiled:
        loop: ClosedLoop = MachineCodeLoop(compiled_loop, robot, law, table, truth)
    else:
        loop = ClosedLoop(robot, law, table, truth, events, report_progress)
    if learned is None:
        loop.advance(robot.last + 1)
    else:
        learned.run(loop)
    report_progress(plant.duration)
    return loop.run(None if learned is None else desired)


#: Compiled loops by thread, delays and array layouts; never emptied.
_LOOPS: dict[Any, CompiledLoop] = {}


def compiled_loop_of(robot: Plant, law: Controller) -> CompiledLoop | None:
    """
    Return the loop for machine code, or None if plant or law cannot have it.

    If it is not `compiled`, its code is yet to be built. Otherwise it is before its first sample.
    A thread has one such loop for the same kinds of arms, delays and array layouts, and each call
    fills in its numbers. So it must be run before it is requested again.
    """
    arm = robot.arm
    model = law.arm
    if arm is None or model is None:
        return None
    plant = robot.own_friction, robot.parameters, robot.state
    control = law.settings, law.law, law.memories
    layouts, numbers = zip(*map(described, (*plant, *control)))
    key = (
        get_ident(), type(arm), type(model), len(robot.transit), len(law.transit), layouts)
    loop = _LOOPS.get(key) or CompiledLoop(
        CompiledPlantStep(arm, *plant, robot.transit),
        CompiledStep(*control, law.transit.copy(), model))
    if loop.compiled:
        _LOOPS[key] = loop
        loop.fill(numbers, (arm, robot.transit), (model, law.transit))
    return loop


class ClosedLoop:
    """
    A closed loop in plain Python, from its start on.

    Parameters
    ----------
    robot, law
        Plant and controller before their first sample.
    table : array, shape (samples + delay, 3, n)
        Points of the reference, from `reference_table`, also at lost samples. The first must be
        filled in, the others only before `advance` needs them.
    truth, events, report_progress
        As in `run_closed_loop`.

    Attributes
    ----------
    k : int
        The next sample.

    """

    compiled = False

    def __init__(self, robot: Plant, law: Controller, table: Array, truth: bool = False,
                 events: Sequence[Event] = (),
                 report_progress: Callable[[float], None] = lambda _: None) -> None:
        self.k = 0
        self._robot = robot
        self._law = law
        self._table = table
        self._truth = truth
        self._pending_events = deque(sorted(events, key=lambda event: event.time))
        self._report_progress = report_progress
        #: Multiples of 2 π by which the angles start nearest to the reference [rad].
        self._turns = TURN * np.array([
            turns_to(q, target) if continuous else 0
            for q, target, continuous in zip(
                robot.measured[0], table[0, 0].tolist(), law.continuous)])
        self._tau = robot.applied
        self._samples = empty_samples(robot.last + 1, robot.n)
        self._count = 0

    @property
    def recorded(self) -> Samples:
        """Return the samples so far, without those that are lost."""
        return self._samples.head(self._count)

    def advance(self, until: int) -> None:
        """
        Run all samples before `until`.

        Sample k needs rows k to k + delay of the table. Raise `CtcError` if the run must end.
        """
        robot = self._robot
        nodes: dict[str, Any] = {'plant': robot, 'controller': self._law}
        samples = self._samples
        for k in range(self.k, until):
            t = seconds(k * robot.period_ns)
            while self._pending_events and t >= self._pending_events[0].time:
                event = self._pending_events.popleft()
                node = nodes[event.node]
                node.configure(node.config.changed(event.values))
            if not robot.lost:
                sample = self._control_step(k)
                count = self._count
                self._tau = sample.tau
                samples.stamps[count] = robot.stamp
                q, dq = (robot.q, robot.dq) if self._truth else robot.measured
                samples.q[count] = q + self._turns
                samples.dq[count] = dq
                samples.tau[count] = sample.tau
                samples.v[count] = sample.v
                samples.e[count] = sample.e
                self._count += 1
            if k < robot.last:
                robot.step(self._tau)
            if k % max(1, robot.last // _PROGRESS_CALLS) == 0:
                self._report_progress(t)
        self.k = until

    def _control_step(self, k: int) -> Sample:
        """Return the law's sample at `k`; raise `CtcError` if it must end."""
        robot = self._robot
        law = self._law
        q, dq = robot.measured
        q = (q + self._turns).tolist()
        point: Point
        point, *ahead = self._table[k:k + law.config.input_delay + 1].tolist()
        sample = law.try_step(q, dq, *point, ahead, robot.stamp, k * robot.period_ns)
        t = seconds(robot.stamp)
        if sample is None:
            raise _no_torque(t, q, dq)
        joint = joint_beyond(sample.e, law.config.error_limit)
        if joint is not None:
            raise _beyond_limit(law.config, joint, t, sample.e[joint])
        return sample

    def run(self, desired: Array | None = None) -> Run:
        """
        Return the run so far, with the reference extrapolated to the stamps.

        Parameters
        ----------
        desired : array, shape of the table, optional
            The reference without its correction.

        """
        stamps, q, dq, tau, v, _ = self.recorded
        k = np.rint(stamps / self._robot.period_ns).astype(int)
        on_grid = k * self._robot.period_ns
        late = (stamps - on_grid)[:, np.newaxis] / NANOSECONDS
        if self._truth:
            stamps = on_grid
            late = 0.0 * late
        q_d, dq_d, ddq_d = _extrapolated(self._table[k], late)
        correction = None
        if desired is not None:
            rows = zip((q_d, dq_d, ddq_d), _extrapolated(desired[k], late))
            correction = np.stack([x - x_desired for x, x_desired in rows], axis=1)
        t = stamps / NANOSECONDS
        return Run(t, q, dq, q_d, dq_d, ddq_d, tau, v, correction=correction,
                   compiled=self.compiled)


def _extrapolated(points: Array, late: Array) -> tuple[Array, Array, Array]:
    """Return q_d, dq_d and ddq_d a time after points of the reference, shape (N, 1) [s]."""
    q_d, dq_d, ddq_d = points.transpose(1, 0, 2)
    if late.any():
        q_d = q_d + late * (dq_d + 0.5 * late * ddq_d)
        dq_d = dq_d + late * ddq_d
    return q_d, dq_d, ddq_d


class MachineCodeLoop(ClosedLoop):
    """
    A closed loop as machine code.

    Parameters
    ----------
    loop : CompiledLoop
        From `compiled_loop_of`. Until the last segment, the thread runs no other loop.
    robot, law, table, truth
        As of `ClosedLoop`.

    """

    compiled = True

    def __init__(self, loop: CompiledLoop, robot: Plant, law: Controller, table: Array,
                 truth: bool = False) -> None:
        super().__init__(robot, law, table, truth)
        self._loop = loop
        self._arguments = loop.start(
            robot, table, self._samples, np.array(law.config.error_limit), self._turns, truth)

    def advance(self, until: int) -> None:
        """Run all samples before `until`."""
        loop = self._loop
        end = loop.advance(self._arguments, until)
        status = loop.status
        self.k = status.k
        self._count = status.recorded
        t = seconds(self.k * self._robot.period_ns)
        if end == DIVERGED:
            raise diverged(t, loop.plant_step.state.driven.commanded)
        if end == BEYOND_LIMIT:
            raise _beyond_limit(self._law.config, status.joint, t, loop.error[status.joint])
        if end == NO_TORQUE:
            raise _no_torque(t, *loop.measured.tolist())


class LearnedTable:
    """
    Samples of a motion that a learner corrects, filled in once they are final.

    Parameters
    ----------
    learner : Corrector
    motion : TimedMotion
        Motion over path time, in the order of the reference's joints.
    reference, controller
        As in `run_closed_loop`.
    period : int
        Control period [ns].
    count : int
        Number of rows.

    Attributes
    ----------
    rows : array, shape (count, 3, n)
        As of `reference_table`, NaN from row `filled` on.
    filled : int
        Number of rows that are final.

    """

    def __init__(self, learner: Corrector, motion: TimedMotion, reference: ReferenceConfig,
                 controller: ControllerConfig, period: int, count: int) -> None:
        self._learner = learner
        self._motion = motion
        self._clock = PathClock.steady(reference.speed_scaling)
        self._controller = controller
        self._period = period
        #: Columns of the motion's joints.
        self._columns = [controller.joint_names.index(name) for name in reference.joint_names]
        self.rows = np.full((count, 3, len(self._columns)), np.nan)
        self.filled = 0
        self._fill()

    def run(self, loop: ClosedLoop) -> None:
        """Run a loop on these rows to its end."""
        delay = self._controller.input_delay
        decimation = self._controller.state_decimation
        next_report = 0
        while loop.k < len(self.rows) - delay:
            if loop.k >= self.filled - delay:
                raise RuntimeError(f'the learner does not know the motion at row {self.filled}')
            loop.advance(self.filled - delay)
            recorded = loop.recorded
            for i in range(next_report, len(recorded.stamps), decimation):
                self._report(int(recorded.stamps[i]), recorded.e[i])
                next_report = i + decimation
            self._fill()

    def _report(self, stamp: int, e: Array) -> None:
        """Pass a sample on to the learner, as the controller publishes it."""
        q_d = self.rows[round(stamp / self._period), 0]
        by_motion = np.array((q_d, e))[:, self._columns]
        self._learner.add(self._clock.at(stamp).instant, *by_motion.tolist())

    def _fill(self) -> None:
        """Fill in the rows that have become final."""
        motion = ScaledMotion(self._learner.corrected(self._motion), self._clock)
        end = self._learner.known_until()
        for k in range(self.filled, len(self.rows)):
            t = k * self._period
            if end is not None and self._clock.at(t).instant >= end:
                return
            self.rows[k][:, self._columns] = motion.at(t)
            self.filled = k + 1


def _no_torque(t: float, q: Vector, dq: Vector) -> CtcError:
    return CtcError(f'the law has no finite torque at t = {t:g} s for {list(q)}, {list(dq)}')


def _beyond_limit(config: ControllerConfig, joint: int, t: float, error: float) -> CtcError:
    return CtcError(
        f'the position error of {config.joint_names[joint]} at t = {t:g} s, {error:.4g} rad, '
        f'exceeds error_limit, {config.error_limit[joint]:g} rad')
