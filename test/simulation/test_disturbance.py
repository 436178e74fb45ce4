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

"""The disturbance d(t) of the plant."""

from math import inf

from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.simulation.motion import acting, total
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
import pytest


def disturbance(amplitude: Vector, frequency: Vector, t: float) -> Vector:
    mechanics = Plant(PlantConfig()).parameters.mechanics._replace(
        amplitude=np.array(amplitude), frequency=np.array(frequency), disturbed=1.0)
    nothing = np.zeros(len(amplitude))
    loads: list[float] = total(
        mechanics, acting(mechanics, nothing, nothing, 0), nothing, t, 0.0).tolist()
    return loads


def test_is_the_paper_s() -> None:
    """Check d = [sin t, sin 2t] of the second experiment."""
    for t in np.linspace(0.0, 10.0, 97).tolist():
        assert disturbance((1.0, 1.0), (1.0, 2.0), t) == [np.sin(t), np.sin(2.0 * t)]


def test_a_push_acts_for_its_duration_after_it_was_set() -> None:
    """Check it against the same torque from the drives, which have no bounds here."""
    config = PlantConfig(torque_saturation=(inf, inf))
    pushed, driven = Plant(config), Plant(config)
    amount = (30.0, -4.0)
    for k in range(400):
        if k in (100, 250):
            pushed.configure(config)
            pushed.configure(config.changed({
                'disturbance.push': amount, 'disturbance.push_duration': 0.05}))
        acts = 100 <= k < 150 or 250 <= k < 300
        pushed.step((20.0, 5.0))
        driven.step((50.0, 1.0) if acts else (20.0, 5.0))
        assert [*pushed.q, *pushed.dq] == pytest.approx([*driven.q, *driven.dq], abs=1e-9)


def test_a_push_in_a_file_acts_from_the_start() -> None:
    config = PlantConfig(disturbance_push=(30.0, 0.0), coulomb_friction=(0.0, 0.0))
    plant = Plant(config)
    for _ in range(199):
        plant.step((0.0, 0.0))
    before = plant.dq[0]
    plant.step((0.0, 0.0))
    during = plant.dq[0] - before
    plant.step((0.0, 0.0))
    # 30 N·m on 8.77 kg·m² or more, and then gravity alone, which brings the arm back.
    assert during > 0.0 > plant.dq[0] - before - during
