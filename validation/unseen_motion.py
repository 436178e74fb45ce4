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

"""An unseen motion as fast as the limits allow, and how recommended gains do in it."""

from __future__ import annotations

from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.trajectory.motions import Route
from faulty_robots import description, Faulty, Plant, sampled
from identified_robots import arm, motion
import numpy as np
import pinocchio as pin
from rigid_bodies import Array, dynamics

#: Parts of the limits of velocity and torque that the motion takes.
_PART = 0.9
#: What Pinocchio has in place of a limit that a joint has not is above [rad/s].
_NO_LIMIT = 100.0
#: Acceleration over the limit of velocity [1/s], as URDFs have none.
_ACCELERATION = 4.0
#: Error at which a run has failed [rad].
_FAILED = 1.5


def speeds(robot: Faulty, known: Array) -> Array:
    """Return the limits of velocity, shape (n,) [rad/s]; known speeds where there is none."""
    model: Any = pin.buildModelFromXML(description(robot.name))
    limit = model.velocityLimit[_places(model, robot)]
    return np.where((limit > 0.0) & (limit < _NO_LIMIT), limit, known)


def fast(robot: Faulty, duration: float, seed: int, known: Array) -> Route:
    """
    Return a motion that was not recorded, as fast as the limits allow.

    A joint without a limit of velocity is as fast as it was in the recorded motion, `known`.
    """
    route = motion(arm(robot.name), duration, seed + 500)
    model: Any = pin.buildModelFromXML(description(robot.name))
    speed, torque = speeds(robot, known / _PART), model.effortLimit[_places(model, robot)]
    torque = np.where(torque > 0.0, torque, np.inf)
    q, dq, ddq = sampled(route, 0.01).transpose(1, 0, 2)
    times = min(float((_PART * speed / np.abs(dq).max(axis=0)).min()),
                float(np.sqrt((_ACCELERATION * speed / np.abs(ddq).max(axis=0)).min())))
    while (_torque(robot, q, times * dq, times ** 2 * ddq) > _PART * torque).any():
        times *= 0.9
    points = [(a, tuple(times * x for x in b), tuple(times ** 2 * x for x in c))
              for a, b, c in route.points]
    return Route(route.names, [round(t / times) for t in route.times], points)


def _places(model: Any, robot: Faulty) -> list[int]:
    """Return where the joints of a robot are in a model of Pinocchio."""
    return [model.joints[model.getJointId(name)].idx_v for name in robot.joints]


def _torque(robot: Faulty, q: Array, dq: Array, ddq: Array) -> Array:
    """Return the largest torque of each joint with friction [N·m]."""
    n = robot.n
    mass, bias, most = np.empty((n, n)), np.empty(n), np.zeros(n)
    for x, v, a in zip(q, dq, ddq):
        dynamics(robot.nominal, x, v, mass, bias)
        most = np.maximum(most, np.abs(mass @ a + bias))
    found: Array = most + robot.physics.coulomb + robot.physics.viscous * np.abs(dq).max(axis=0)
    return found


def tracked(robot: Faulty, model: Model, config: ControllerConfig, route: Route, seed: int
            ) -> Array:
    """Return the RMS error of each joint under a law of this package; nan where it fails."""
    wanted = sampled(route, robot.period)
    plant = Plant(robot, wanted[0, 0], seed)
    controller = Controller(config, model)
    delay, rows = config.input_delay, wanted.tolist()
    rows += rows[-1:] * (delay + 1)
    total = np.zeros(robot.n)
    for k in range(len(wanted)):
        q, dq = plant.measured()
        q_d, dq_d, ddq_d = rows[k]
        sample = controller.try_step(q.tolist(), dq.tolist(), q_d, dq_d, ddq_d,
                                     rows[k + 1:k + 1 + delay])
        error = plant.state.x[:robot.n] - wanted[k, 0]
        if sample is None or not (np.abs(error) < _FAILED).all():
            return np.full(robot.n, np.nan)
        total += np.square(error)
        plant.step(sample.tau)
    found: Array = np.sqrt(total / len(wanted))
    return found


def config_of(robot: Faulty, values: dict[str, Any]) -> ControllerConfig:
    """Return the controller of a parameter file's values."""
    return ControllerConfig.from_mapping({
        'joint_names': list(robot.joints), 'control_period': robot.period,
        'model': 'urdf' if arm(robot.name).urdf else 'two_link', **values})
