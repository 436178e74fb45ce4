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

"""Robots whose friction is drawn at random, moved for an identification, and their recordings."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from functools import cache
from typing import Any, NamedTuple

from ctc_chattering.bags.recording import Recording, stretches
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.identification.identify import Identification, identify
from ctc_chattering.identification.least_squares import Data
from ctc_chattering.identification.model_errors import candidates
from ctc_chattering.identification.timing import Profile
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import Rows
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.closed_loop import Run, simulate
from ctc_chattering.simulation.plant import make_plant, Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.motions import Route
from ctc_chattering.trajectory.reference import ReferenceConfig
from mujoco_plant import MujocoPlant
import numpy as np
from other_arms import DESCRIBED, drawn
import urdfs


@dataclasses.dataclass(frozen=True)
class Arm:
    """
    A robot and how it may move.

    Attributes
    ----------
    joints : tuple of str, length n
    urdf : str
        Empty for the two-link arm.
    centre, amplitude : tuple of float, length n
        Of the motion [rad].
    friction : tuple of (float, float), length n
        Least and greatest Coulomb friction [N·m].
    resolution : float
        Of the encoders [rad].

    """

    joints: tuple[str, ...]
    urdf: str
    centre: tuple[float, ...]
    amplitude: tuple[float, ...]
    friction: tuple[tuple[float, float], ...]
    resolution: float


@cache
def arm(name: str) -> Arm:
    """Return the paper's arm, one of `other_arms`, `drawn` with a number, the Panda or the UR5."""
    if name in DESCRIBED:
        file, joints, centre, friction = DESCRIBED[name]
        return Arm(joints, urdfs.robot(file), centre, (0.7,) * len(joints),
                   tuple((0.4 * x, 1.2 * x) for x in friction), 1e-5)
    if name.startswith('drawn'):
        return Arm(('j0', 'j1', 'j2'), drawn(int(name.removeprefix('drawn'))), (0.0,) * 3,
                   (1.0,) * 3, ((1.0, 3.0), (0.6, 2.0), (0.3, 1.5)), 1e-5)
    if name == 'two_link_urdf':
        return dataclasses.replace(arm('two_link'), joints=urdfs.TWO_LINKS,
                                   urdf=urdfs.two_links(), friction=((2.0, 6.0), (0.5, 3.0)))
    if name == 'two_link':
        return Arm(('joint1', 'joint2'), '', (0.0, 0.0), (1.2, 1.5), ((5.0, 12.0),) * 2, 1e-5)
    if name == 'panda':
        return Arm(urdfs.PANDA, urdfs.panda(), (0.0, -0.4, 0.0, -1.8, 0.0, 1.8, 0.5),
                   (0.8, 0.6, 0.8, 0.6, 0.8, 0.8, 1.0), (*[(1.0, 5.0)] * 4, *[(0.2, 1.0)] * 3),
                   1e-6)
    return Arm(urdfs.UR5, urdfs.ur5(), (0.0, -1.0, 1.0, -1.0, -1.5, 0.0),
               (0.8, 0.5, 0.7, 0.8, 0.8, 1.0), (*[(2.0, 9.0)] * 3, *[(0.3, 2.0)] * 3), 1e-5)


class Recorded(NamedTuple):
    """A recording with what made it."""

    recording: Recording
    plant: PlantConfig
    controller: ControllerConfig
    model: Model
    run: Run


def motion(robot: Arm, duration: float, seed: int) -> Route:
    """Return waypoints from rest: five harmonics, then slow reversals of every joint."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration + 0.025, 0.05)
    centre, amplitude = np.array(robot.centre), np.array(robot.amplitude)
    n = len(centre)
    q = np.zeros((len(t), n))
    late = _blend((t - 0.6 * duration) / 4.0)
    for i in range(n):
        sizes, phases = rng.normal(size=5), rng.uniform(0.0, 2.0 * np.pi, 5)
        fast = sum(size / k * np.sin(0.2 * np.pi * k * t + phase)
                   for k, (size, phase) in enumerate(zip(sizes, phases), 1))
        slow = 0.25 * np.sin(2.0 * np.pi * (0.07 + 0.02 * i) * t + i)
        q[:, i] = amplitude[i] * ((1.0 - late) * fast / np.abs(fast).max() + late * slow)
    q *= _blend(t / 3.0)[:, None]
    q += centre
    dq = np.asarray(np.gradient(q, 0.05, axis=0, edge_order=2))
    dq[0] = 0.0
    ddq = np.asarray(np.gradient(dq, 0.05, axis=0, edge_order=2))
    ddq[0] = 0.0
    points = [tuple(tuple(row.tolist()) for row in rows) for rows in zip(q, dq, ddq)]
    return Route(robot.joints, [round(x * 1e9) for x in t], points)  # type: ignore[arg-type]


def _blend(s: Array) -> Array:
    s = np.clip(s, 0.0, 1.0)
    found: Array = s ** 3 * (10.0 - 15.0 * s + 6.0 * s * s)
    return found


def record(name: str, seed: int, duration: float = 60.0, *, backend: str = 'builtin',
           period: float = 1e-3, plant: Mapping[str, Any] | None = None,
           controller: Mapping[str, Any] | None = None, truth: str | Model = '',
           route: Route | None = None) -> Recorded:
    """
    Move an arm under law compensation, and return what is recorded of it.

    Parameters
    ----------
    name : str
        As `arm` has it.
    seed : int
        Of friction, motion and noise.
    duration, period : float
        [s].
    backend : {'builtin', 'mujoco'}
        What moves the robot.
    plant, controller : mapping, optional
        Parameters.
    truth : str or Model, optional
        URDF or model of the plant, where it differs from the controller's.
    route : Route, optional
        Motion in place of `motion`.

    """
    robot = arm(name)
    n = len(robot.joints)
    rng = np.random.default_rng(1000 + seed)
    coulomb = np.array([rng.uniform(*limits) for limits in robot.friction])
    viscous = rng.uniform(0.1, 0.4, n) * coulomb
    route = route or motion(robot, duration, seed)
    common = {'joint_names': list(robot.joints), 'control_period': period,
              'model': 'urdf' if robot.urdf else 'two_link'}
    config = PlantConfig.from_mapping({
        **common, 'coulomb_friction': coulomb.tolist(),
        'viscous_friction': viscous.tolist(), 'duration': duration,
        'initial_position': list(route.points[0][0]), 'noise_seed': seed,
        'encoder_resolution': [robot.resolution] * n, 'velocity_noise': [1e-3] * n,
        **(plant or {})})
    law = ControllerConfig.from_mapping({**common, 'law': 'compensation', **(controller or {})})
    model = model_of(law, robot.urdf)
    body: Plant
    if isinstance(truth, Model):
        body = Plant(config, truth)
    elif backend == 'mujoco':
        body = MujocoPlant(config, truth or robot.urdf)
    else:
        body = make_plant(config, truth or robot.urdf)
    run = simulate(config, law, ReferenceConfig(
        joint_names=robot.joints, control_period=period, center=(0.0,) * n,
        amplitude=(0.0,) * n, frequency=(0.0,) * n, phase=(0.0,) * n),
        route=route, robot=body, model=model)
    recording = Recording(name, robot.joints, run.t, run.q, run.dq, None, run.tau)
    return Recorded(recording, config, law, model, run)


@cache
def identified(duration: float, noise: float = 1e-3) -> tuple[Recorded, Identification]:
    """
    Return a recording of the paper's arm, and what is identified of it, once per process.

    Parameters
    ----------
    duration : float
        [s].
    noise : float
        Of the velocities [rad/s].

    """
    made = record('two_link', 7, duration, plant={'velocity_noise': [noise] * 2})
    return made, identify([made.recording.checked()], made.model, candidates(made.model))


def windows_of(found: Identification, recording: Recording, model: Model) -> Data:
    """Return the windows of another run, with the torques that an identification has found."""
    period = found.clock.period
    parts = list(stretches(recording, period))
    phi = TestFunction(period, period * sum(len(part.q) for part in parts))
    rows = [Rows.of(part, model, phi, found.columns) for part in parts]
    return Profile(parts, rows, found.timing.source, phi).windows(*found.timing.acting)
