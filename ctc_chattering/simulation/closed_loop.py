"""The closed loop without ROS: the same plant, controller and reference that the nodes run."""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Callable, Mapping, Sequence
import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from ctc_chattering.control.controller import Controller, ControllerConfig, Sample
from ctc_chattering.control.error_monitor import joint_beyond
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import period_ns, samples, seconds
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.registry import make_plant
from ctc_chattering.simulation.simulated_robot import Robot
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig
from ctc_chattering.trajectory.waypoints import Route

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
    A run sample by sample; arrays of shape (N,) and (N, n).

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

    """

    t: Array
    q: Array
    dq: Array
    q_d: Array
    dq_d: Array
    ddq_d: Array
    tau: Array
    v: Array


class Record:
    """Collects samples into a `Run` without an object per number."""

    def __init__(self, n: int) -> None:
        self._n = n
        self._columns = [array('d') for _ in range(7)]
        self._t = array('d')

    def add(self, t: float, *rows: Sequence[float]) -> None:
        """Append one sample: q, dq, q_d, dq_d, ddq_d, tau, v."""
        self._t.append(t)
        for column, row in zip(self._columns, rows):
            column.extend(row)

    def run(self) -> Run:
        """Return what was collected."""
        return Run(np.frombuffer(self._t) if self._t else np.zeros(0), *(
            np.frombuffer(c).reshape(-1, self._n) if c else np.zeros((0, self._n))
            for c in self._columns))


def simulate(plant: PlantConfig, controller: ControllerConfig, reference: ReferenceConfig,
             events: Sequence[Event] = (),
             progress: Callable[[float], None] | None = None, truth: bool = False,
             route: Route | None = None, robot: Robot | None = None,
             model: Model | None = None) -> Run:
    """
    Run the closed loop from t = 0 to the plant's `duration`, both samples included.

    At every sample the controller answers the state, and the plant takes that torque until the
    next; that is the lockstep of the nodes. A sample whose state is lost is not in the result.

    Parameters
    ----------
    plant, controller, reference
        Configurations; the joints of all three are the same, in any order for the reference.
    events : sequence of Event
        Changes of parameters during the run.
    progress : callable, optional
        Called now and then with the simulated time [s].
    truth : bool
        Record the true state in place of the one that the sensors show, as a bag has it.
    route : Route, optional
        Waypoints in place of the reference's sinusoid.
    robot : Robot, optional
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
    robot = robot or make_plant(plant)
    law = Controller(controller, model)
    motion = make_motion(
        reference, route, dict(zip(plant.joint_names, zip(*robot.measured))))
    order = [reference.joint_names.index(name) for name in controller.joint_names]
    straight = order == list(range(len(order)))
    period = period_ns(plant.control_period)
    last = samples(plant.duration, period)
    delay = controller.input_delay

    def at(k: int) -> Point:
        point = motion.at(k * period)
        if straight:
            return point
        q_d, dq_d, ddq_d = ([row[i] for i in order] for row in point)
        return q_d, dq_d, ddq_d

    coming = deque(at(k) for k in range(delay))
    due = sorted(events, key=lambda event: event.time)
    record = Record(robot.n)
    every = max(1, last // 100)
    tau: Vector = ()
    for k in range(last + 1):
        t = seconds(k * period)
        while due and t >= due[0].time:
            _apply(due.pop(0), robot, law)
        coming.append(at(k + delay))
        desired = coming.popleft()
        if robot.lost:
            robot.step(tau)
            continue
        sample = _answer(law, t, *robot.measured, desired, coming)
        tau = sample.tau
        q, dq = (robot.q, robot.dq) if truth else robot.measured
        record.add(t, q, dq, *desired, tau, sample.v)
        if k < last:
            robot.step(tau)
        if progress is not None and k % every == 0:
            progress(t)
    return record.run()


def _apply(event: Event, robot: Robot, law: Controller) -> None:
    if event.node == 'plant':
        robot.configure(robot.config.changed(event.values))
    else:
        law.configure(law.config.changed(event.values))


def _answer(law: Controller, t: float, q: Vector, dq: Vector, desired: Point,
            ahead: Sequence[Point]) -> Sample:
    """Return the law's answer to a state at `t` [s]; raise `CtcError` where the nodes end."""
    sample = law.try_step(q, dq, *desired, ahead)
    if sample is None:
        raise CtcError(f'no torque can be computed at t = {t:g} s for {list(q)}, {list(dq)}')
    config = law.config
    i = joint_beyond(sample.e, config.error_limit)
    if i is not None:
        raise CtcError(
            f'the position error of {config.joint_names[i]} at t = {t:g} s, '
            f'{sample.e[i]:.4g} rad, exceeds error_limit, {config.error_limit[i]:g} rad')
    return sample
