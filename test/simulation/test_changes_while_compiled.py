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

"""A plant that runs as machine code goes on from where it is when its parameters change."""

from __future__ import annotations

from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.compilation import compile_setups
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
import pytest

SETUP = parameter_file.load(None, {'plant': {
    'position_noise': [1e-5, 0.0], 'velocity_noise': [0.0, 1e-3], 'velocity_sensor': 'filtered',
    'encoder_resolution': [1e-4, 0.0], 'sample_loss': 0.1, 'late_samples': 0.1, 'input_delay': 2,
    'actuator_lag': [1e-3, 2e-3], 'torque_rate_limit': [3e4, 2e4], 'duration': 1.0}})
TAU = np.random.default_rng(1).normal([0.0, 0.0], [60.0, 20.0], (400, 2))


@pytest.fixture(scope='module', autouse=True)
def compiled() -> None:
    compile_setups([SETUP], print)


def run(config: PlantConfig, changes: dict[int, dict[str, Any]]) -> Array:
    """Return what is seen of a plant, with the brakes on from sample 300 to 350."""
    plant, seen = Plant(config), []
    for k, tau in enumerate(TAU):
        if k in changes:
            plant.configure(plant.config.changed(changes[k]))
        plant.brake(300 <= k < 350)
        assert plant.computed_by == ('machine code' if config.compiled else 'plain Python')
        plant.step(tau)
        seen.append([*plant.q, *plant.dq, *plant.measured[0], *plant.measured[1], *plant.applied,
                     *plant.modes, plant.lost, plant.k, plant.t])
    return np.array(seen, float)


def test_it_is_the_motion_of_plain_python() -> None:
    changes = {100: {'coulomb_friction': [3.0, 1.0]}, 200: {'disturbance.push': [40.0, 0.0]}}
    right = run(SETUP.plant.changed({'compiled': False}), changes)
    np.testing.assert_allclose(run(SETUP.plant, changes), right, rtol=1e-9, atol=1e-9)
    assert np.abs(run(SETUP.plant, {}) - right).max() > 1e-3
    assert right[:, 12].sum() > 10


def test_a_change_of_nothing_changes_nothing() -> None:
    """The state that is read back is the whole state, to the last bit."""
    changes: dict[int, dict[str, Any]] = {k: {} for k in range(3, 290, 7)}
    np.testing.assert_array_equal(run(SETUP.plant, changes), run(SETUP.plant, {}))
