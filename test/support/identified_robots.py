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
from functools import cache
from typing import Any, NamedTuple

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.identification.drives import known_torque
from ctc_chattering.identification.identify import Identification, identify_recordings
from ctc_chattering.identification.recording import Recording
from ctc_chattering.identification.regression import Observations
from ctc_chattering.identification.regressor import BodyRegressor
from ctc_chattering.identification.stretches import split_recording
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import join_windows, Windows
from ctc_chattering.simulation.closed_loop import Run, run_closed_loop
from ctc_chattering.simulation.plant import make_plant, Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
from ctc_chattering.trajectory.waypoints import Route
import numpy as np
from robots import arm, motion


class Recorded(NamedTuple):
    """A recording with what made it."""

    recording: Recording
    plant: PlantConfig
    controller: ControllerConfig
    model: Model
    run: Run


def record(name: str, seed: int, duration: float = 60.0, *, period: float = 1e-3,
           plant: Mapping[str, Any] | None = None,
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
    body = Plant(config, truth) if isinstance(truth, Model) else make_plant(
        config, truth or robot.urdf)
    run = run_closed_loop(config, law, ReferenceConfig(
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
    return made, identify_recordings([made.recording.checked()], made.model)


def windows_of(found: Identification, recording: Recording, model: Model) -> Observations:
    """Return the windows of another run, with the torque that acts by an identification."""
    period = found.clock.period
    parts = list(split_recording(recording, period))
    phi = TestFunction(period, period * sum(len(part.q) for part in parts))
    rows = [Windows.of(part, model, phi, BodyRegressor.of(model)) for part in parts]
    torque = [known_torque(part, x.centres, found.timing.source, phi, found.timing.acting)
              for part, x in zip(parts, rows)]
    return Observations.of(join_windows(rows), np.concatenate(torque))
