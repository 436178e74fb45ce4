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

"""The closed loop without ROS: the same plant, controller and reference that the nodes run."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
import dataclasses
from threading import get_ident
from typing import Any

from ctc_chattering.compiled.records import described
from ctc_chattering.control.compiled_step import CompiledStep
from ctc_chattering.control.controller import Controller, ControllerConfig, Sample
from ctc_chattering.controller.trips import joint_beyond
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.angles import TURN, turns_to
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import seconds
from ctc_chattering.simulation.compiled_loop import (
    BEYOND,
    CompiledLoop,
    DIVERGED,
    DQ,
    FILTERED,
    NO_TORQUE,
    Q,
    SENT,
)
from ctc_chattering.simulation.plant import diverged, make_plant, Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.plant_step import CompiledPlantStep
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.reference import reference_table, ReferenceConfig
from ctc_chattering.trajectory.waypoints import Route
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


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
    The samples of a run; N samples, n joints.

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
    compiled: bool = dataclasses.field(default=False, kw_only=True)

    @property
    def e(self) -> Array:
        """Return the position error q_d - q [rad], shape: (N, n)."""
        return self.q_d - self.q

    @property
    def de(self) -> Array:
        """Return the velocity error dq_d - dq [rad/s], shape: (N, n)."""
        return self.dq_d - self.dq


@np.errstate(all='ignore')  # What overflows shows in the torque.
def simulate(plant: PlantConfig, controller: ControllerConfig, reference: ReferenceConfig,
             events: Sequence[Event] = (),
             progress: Callable[[float], None] | None = None, truth: bool = False,
             route: Route | None = None, robot: Plant | None = None,
             model: Model | None = None) -> Run:
    """
    Return the samples of the closed loop from t = 0 to the plant's `duration`, both included.

    At every sample the controller answers the state, and the plant takes that torque until the
    next; that is the lockstep of the nodes. A sample whose state is lost is not in the result.

    Parameters
    ----------
    plant, controller, reference
        Configurations that agree (`configuration.loop_setup.check_agreement`); the joints of all
        three are the same, in any order for the reference.
    events : sequence of Event
        Changes of parameters during the run.
    progress : callable, optional
        Called now and then with the simulated time [s].
    truth : bool
        Record the true state in place of the one that the sensors show, as a bag has it.
    route : Route, optional
        Waypoints in place of the reference's sinusoid.
    robot : Plant, optional
        At its start, made from `plant`; in place of the one that `plant` describes.
    model : Model, optional
        Of the controller, in place of the one that its configuration names.

    Raises
    ------
    CtcError
        If `duration` is 0, the motion diverges, the law has no finite torque, a position error
        exceeds `error_limit`, or the waypoints are not allowed.

    """
    if plant.duration <= 0.0:
        raise CtcError('duration: a simulation must end; set the duration of the plant above 0')
    robot, law = robot or make_plant(plant), Controller(controller, model)
    start = tuple(zip(plant.joint_names, zip(*map(tuple, robot.measured))))
    endless = dict(zip(controller.joint_names, law.continuous))
    table = reference_table(
        reference, route, start if reference.start_duration or route is not None else (),
        controller.joint_names, robot.period_ns, robot.last + 1 + controller.input_delay,
        tuple(endless.get(name, False) for name in reference.joint_names))
    #: What the angles of the robot lack to those nearest to the reference [rad].
    lacking = TURN * np.array([turns_to(q, target) if turns else 0 for q, target, turns in zip(
        robot.measured[0], table[0, 0].tolist(), law.continuous)])
    show = progress or (lambda _: None)
    show(0.0)
    loop = None if events else compiled_loop_of(robot, law)
    compiled = loop is not None and loop.compiled
    stamps, rows = (
        _by_machine_code(loop, table, robot, law, truth, lacking)
        if loop is not None and compiled
        else _by_steps(robot, law, table, events, show, truth, lacking))
    show(plant.duration)
    return _run_of(stamps, rows, table, robot.period_ns, truth, compiled)


#: Loops that are compiled, by thread and by what their layouts depend on.
_LOOPS: dict[Any, CompiledLoop] = {}


def compiled_loop_of(robot: Plant, law: Controller) -> CompiledLoop | None:
    """
    Return the loop as machine code takes it, before its first sample; None where it cannot.

    It may have to be compiled first. In a thread it is the same one for the same kind of law and
    robot, with other numbers filled in: it must be run before it is asked for again.
    """
    arm, model = robot.arm, law.arm
    if arm is None or model is None:
        return None
    plant, control = ((robot.own, robot.parameters, robot.state),
                      (law.settings, law.law, law.memories))
    kinds, numbers = zip(*map(described, (*plant, *control)))
    key = get_ident(), len(robot.transit), len(law.transit), kinds
    loop = _LOOPS.get(key) or CompiledLoop(
        CompiledPlantStep(arm, *plant, robot.transit),
        CompiledStep(*control, law.transit.copy(), model))
    if loop.compiled:
        _LOOPS[key] = loop
        loop.fill(numbers, (arm, robot.transit), (model, law.transit))
    return loop


def _by_machine_code(loop: CompiledLoop, table: Array, robot: Plant, law: Controller, truth: bool,
                     lacking: Array) -> tuple[Any, Array]:
    """Return what `_by_steps` does, of machine code."""
    end, last, joint, stamps, rows = loop.run(
        robot, table, np.array(law.config.error_limit), truth, lacking)
    t = seconds(last * robot.period_ns)
    if end == DIVERGED:
        raise diverged(t, loop.plant_step.state.driven.commanded)
    if end == BEYOND:
        raise CtcError(_beyond(law.config, joint, t, loop.error[joint]))
    if end == NO_TORQUE:
        raise CtcError(_no_torque(t, *loop.measured.tolist()))
    return stamps, rows


def _by_steps(robot: Plant, law: Controller, table: Array, events: Sequence[Event],
              show: Callable[[float], None], truth: bool, lacking: Array) -> tuple[Any, Array]:
    """
    Return stamp [ns], and q, dq, tau and v, of each sample not lost, (N,) and (N, 4, n).

    Parameters
    ----------
    robot, law
        At their start.
    table : array, shape (N + delay, 3, n)
        Of `reference_table`.
    events, show, truth
        As of `simulate`.
    lacking : array, shape (n,)
        What is added to the robot's positions [rad].

    """
    period, last, delay = robot.period_ns, robot.last, law.config.input_delay
    due = deque(sorted(events, key=lambda event: event.time))
    changed: dict[str, Any] = {'plant': robot, 'controller': law}
    stamps, rows = np.zeros(last + 1, np.int64), np.empty((last + 1, 4, robot.n))
    tau, count = robot.applied, 0
    for k in range(last + 1):
        t = seconds(k * period)
        while due and t >= due[0].time:
            event = due.popleft()
            changed[event.node].configure(changed[event.node].config.changed(event.values))
        if not robot.lost:
            point, *ahead = table[k:k + delay + 1].tolist()
            q, dq = robot.measured
            sample = _step(law, robot.stamp, k * period, (q + lacking).tolist(), dq, point, ahead)
            tau = sample.tau
            stamps[count] = robot.stamp
            rows[count] = *((robot.q, robot.dq) if truth else (q, dq)), tau, sample.v
            rows[count, Q] += lacking
            count += 1
        if k < last:
            robot.step(tau)
        if k % max(1, last // 100) == 0:
            show(t)
    return stamps[:count], rows[:count]


def _run_of(stamps: Any, rows: Array, table: Array, period: int, truth: bool, compiled: bool
            ) -> Run:
    """Return the run of what `_by_steps` returns, under a reference."""
    at = np.rint(stamps / period).astype(int)
    q_d, dq_d, ddq_d = table[at].transpose(1, 0, 2)
    if truth:
        stamps = at * period
    elif (stamps != at * period).any():
        s = (stamps - at * period)[:, np.newaxis] / 1e9
        q_d, dq_d = q_d + s * (dq_d + 0.5 * s * ddq_d), dq_d + s * ddq_d
    return Run(stamps / 1e9, rows[:, Q], rows[:, DQ], q_d, dq_d, ddq_d, rows[:, SENT],
               rows[:, FILTERED], compiled=compiled)


def _no_torque(t: float, q: Vector, dq: Vector) -> str:
    return f'no torque can be computed at t = {t:g} s for {list(q)}, {list(dq)}'


def _beyond(config: ControllerConfig, joint: int, t: float, error: float) -> str:
    return (f'the position error of {config.joint_names[joint]} at t = {t:g} s, {error:.4g} rad, '
            f'exceeds error_limit, {config.error_limit[joint]:g} rad')


def _step(law: Controller, stamp: int, at: int, q: Vector, dq: Vector, point: Point,
          ahead: Sequence[Point]) -> Sample:
    """Return the law's sample at a stamp; raise `CtcError` if no torque may be sent for it."""
    sample, t = law.try_step(q, dq, *point, ahead, stamp, at), seconds(stamp)
    if sample is None:
        raise CtcError(_no_torque(t, q, dq))
    i = joint_beyond(sample.e, law.config.error_limit)
    if i is not None:
        raise CtcError(_beyond(law.config, i, t, sample.e[i]))
    return sample
