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

"""Two plants, MuJoCo's and the package's."""

from __future__ import annotations

from math import sin
from typing import Any

from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from mujoco_plant import MujocoPlant
import numpy as np
from urdfs import TWO_LINKS, two_links


def test_agrees_with_the_builtin_plant() -> None:
    """Check 2 s of stick and slide, gravity and couplings, at 0.1 ms per step."""
    description = two_links('continuous')
    values: dict[str, Any] = {
        'joint_names': TWO_LINKS, 'coulomb_friction': [5.0, 1.0], 'viscous_friction': [0.3, 0.1],
        'initial_position': [1.0, -0.5], 'disturbance.amplitude': [1.0, 0.3],
        'disturbance.frequency': [4.0, 7.0]}
    ours = Plant(PlantConfig.from_mapping(values), UrdfModel(description, TWO_LINKS))
    theirs = MujocoPlant(PlantConfig.from_mapping({
        'model': 'urdf', 'integration_step': 1e-4, **values}), description)
    stuck = 0
    for k in range(2000):
        tau = [3.0 * sin(0.003 * k), 1.0 * sin(0.005 * k)]
        for plant in (ours, theirs):
            plant.step(tau)
        np.testing.assert_allclose(theirs.q, ours.q, atol=2e-4)
        np.testing.assert_allclose(theirs.dq, ours.dq, atol=2e-3)
        stuck += 0 in ours.modes
    assert 100 < stuck < 1900
