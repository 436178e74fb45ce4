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

"""Held-out conditions: reproducible, within what is documented, and wrong for the controller."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.runs.conditions import held_out, LOST, torque_rates
import numpy as np
from processes import CONFIG
import pytest


def setups(file: Path, seed: int = 5, count: int = 24) -> list[Setup]:
    nominal = parameter_file.load(file)
    return [parameter_file.load(file, *x.overrides(nominal)) for x in held_out(count, seed)]


def test_a_condition_depends_on_seed_and_index_only() -> None:
    """Check that more conditions begin with the same ones."""
    nominal = parameter_file.load(CONFIG / 'friction.yaml')
    few, more, other = ([x.overrides(nominal) for x in held_out(n, seed)]
                        for n, seed in ((3, 5), (9, 5), (3, 6)))
    assert more[:3] == few
    assert all(a != b for a, b in zip(few, other))
    assert len({x.name for x in (*held_out(9, 5), *held_out(3, 6))}) == 12


@pytest.mark.parametrize('robot', ['friction', 'panda', 'ur5'])
def test_the_draws_are_within_what_is_documented(robot: str) -> None:
    """Check the ratios of what the controller is told; both sides of right are drawn."""
    file = CONFIG / f'{robot}.yaml'
    nominal, found = parameter_file.load(file), setups(file)
    rates, ratios = np.array(torque_rates(nominal)), []
    for setup in found:
        plant, told = setup.plant, setup.controller
        of_drives = np.array(plant.torque_rate_limit) / rates
        friction = np.array(plant.coulomb_friction) / nominal.plant.coulomb_friction
        assert np.ptp(of_drives) < 1e-9
        assert 0.5 <= of_drives[0] <= 2.0
        assert (friction >= 0.7).all()
        assert (friction <= 1.3).all()
        assert told.friction_level == nominal.plant.coulomb_friction
        assert (np.array(plant.stribeck_friction) <= 0.3 * np.array(plant.coulomb_friction)).all()
        assert told.input_delay == plant.input_delay <= 2
        assert min(told.inertia_scale, told.gravity_scale) >= 0.85
        assert max(told.inertia_scale, told.gravity_scale) <= 1.15
        assert 1e-6 <= plant.encoder_resolution[0] <= 1e-4
        assert 0.0 <= plant.sample_loss <= 0.1
        assert 0.0 <= plant.sample_jitter <= 0.3 * plant.control_period
        assert set(told.error_limit) == {LOST}
        assert (plant.payload > 0.0) == nominal.plant.described
        ratios.append((told.actuator_lag[0] / plant.actuator_lag[0],
                       told.torque_rate_limit[0] / plant.torque_rate_limit[0]))
    lag, rate = np.array(ratios).T
    assert (lag >= 0.5).all() and (lag <= 1.5).all()
    assert (rate >= 0.5).all() and (rate <= 2.0).all()
    for ratio in (lag, rate):
        assert ratio.min() < 0.8 < 1.2 < ratio.max()
    assert max(x.plant.sample_loss for x in found) > 0.08
    assert max(x.plant.sample_jitter for x in found) > 3e-4
    assert {x.controller.control_period for x in found} == {5e-4, 1e-3, 2e-3}


def test_every_start_is_smooth_and_every_third_off_the_reference() -> None:
    """Check the distance from the sinusoid at t = 0."""
    for i, setup in enumerate(setups(CONFIG / 'friction.yaml')):
        motion, plant = setup.reference, setup.plant
        begin = np.array(motion.center) + np.array(motion.amplitude) * np.sin(motion.phase)
        assert motion.start_duration == 2.0
        if i % 3 == 2:
            assert 0.0 < np.abs(begin - plant.initial_position).max() <= 0.3
