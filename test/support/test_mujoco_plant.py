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

"""Two plants, MuJoCo's and the package's, alone and in the loop."""

from __future__ import annotations

from math import sin
from typing import Any

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.simulation.closed_loop import simulate
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
from mujoco_plant import MujocoPlant
import numpy as np
from urdfs import TWO_LINKS, two_links

DESCRIPTION = two_links('continuous')
MODEL = UrdfModel(DESCRIPTION, TWO_LINKS)


def test_agrees_with_the_builtin_plant() -> None:
    """Check 2 s of stick and slide, gravity and couplings, at 0.1 ms per step."""
    values: dict[str, Any] = {
        'joint_names': TWO_LINKS, 'coulomb_friction': [5.0, 1.0], 'viscous_friction': [0.3, 0.1],
        'initial_position': [1.0, -0.5], 'disturbance.amplitude': [1.0, 0.3],
        'disturbance.frequency': [4.0, 7.0]}
    ours = Plant(PlantConfig.from_mapping(values), MODEL)
    theirs = MujocoPlant(PlantConfig.from_mapping({
        'model': 'urdf', 'integration_step': 1e-4, **values}), DESCRIPTION)
    stuck = 0
    for k in range(2000):
        tau = [3.0 * sin(0.003 * k), 1.0 * sin(0.005 * k)]
        for plant in (ours, theirs):
            plant.step(tau)
        np.testing.assert_allclose(theirs.q, ours.q, atol=2e-4)
        np.testing.assert_allclose(theirs.dq, ours.dq, atol=2e-3)
        stuck += 0 in ours.modes
    assert 100 < stuck < 1900


def test_both_plants_give_the_same_error() -> None:
    """Check the RMS error of the loop with MuJoCo against the one with our own plant."""
    config = PlantConfig(joint_names=TWO_LINKS, coulomb_friction=(9.0, 4.0), duration=2.0)
    law = ControllerConfig(joint_names=TWO_LINKS, switching='implicit_observer', ka=(12.0, 6.0))
    runs = [simulate(config, law, ReferenceConfig(joint_names=TWO_LINKS), robot=plant, model=MODEL)
            for plant in (Plant(config, MODEL), MujocoPlant(config, DESCRIPTION))]
    ours, theirs = (np.square(run.q_d - run.q)[1500:].mean(axis=0) for run in runs)
    np.testing.assert_allclose(ours, theirs, rtol=0.1)
