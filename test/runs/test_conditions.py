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

"""The conditions of a comparison: what they replace, and that it reaches plant and controller."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import UsageError
from ctc_chattering.runs.compare import ComparisonSpec
from ctc_chattering.runs.conditions import (
    CONDITIONS,
    find_condition,
    held_out_cases,
    LOST_ERROR_RAD,
    torque_rates,
)
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
from processes import CONFIG
import pytest
import yaml

FRICTION = CONFIG / 'friction.yaml'
#: What a condition may set, and what it is when nothing is set.
OF_THE_PLANT = ('actuator_lag', 'torque_rate_limit', 'torque_resolution', 'input_delay',
                'encoder_resolution', 'position_noise', 'velocity_noise', 'velocity_sensor',
                'sample_loss', 'sample_jitter', 'late_samples', 'payload', 'stribeck_friction',
                'stribeck_velocity')
OF_THE_CONTROLLER = ('actuator_lag', 'torque_rate_limit', 'input_delay', 'inertia_scale',
                     'gravity_scale')
#: What differs from that, of the plant and, in each run, of the controller.
SET: dict[str, tuple[dict[str, Any], list[dict[str, Any]]]] = {
    'clean': ({}, [{}]),
    'lag': ({'actuator_lag': (2e-3,) * 2}, [{'actuator_lag': (2e-3,) * 2}]),
    'encoder': ({'encoder_resolution': (1e-5,) * 2, 'velocity_sensor': 'difference'}, [{}]),
    'noise': ({'velocity_noise': (5e-3,) * 2}, [{}]),
    'delay': ({'input_delay': 1}, [{'input_delay': 1}]),
    'model_error': ({}, [{'inertia_scale': x, 'gravity_scale': x} for x in (0.9, 1.1)]),
    'real_arm': (
        {'actuator_lag': (2e-3,) * 2, 'torque_rate_limit': (5000.0, 1000.0), 'input_delay': 1,
         'encoder_resolution': (1e-5,) * 2, 'velocity_sensor': 'difference'},
        [{'actuator_lag': (2e-3,) * 2, 'torque_rate_limit': (5000.0, 1000.0), 'input_delay': 1,
          'inertia_scale': x, 'gravity_scale': x} for x in (0.9, 1.1)])}
SET['real_arm_filtered'] = ({**SET['real_arm'][0], 'velocity_sensor': 'filtered'},
                            SET['real_arm'][1])
SET['stops'] = ({**SET['real_arm'][0], 'stribeck_friction': (4.95,) * 2,
                 'stribeck_velocity': (0.01,) * 2}, SET['real_arm'][1])


@pytest.fixture
def spoiled(tmp_path: Path) -> Path:
    """Return a file that has everything which a condition has to replace."""
    tree = yaml.safe_load(FRICTION.read_text())
    tree['plant']['ros__parameters'] |= {
        'actuator_lag': [0.01, 0.01], 'torque_resolution': [1.0, 1.0], 'input_delay': 5,
        'encoder_resolution': [0.1, 0.1], 'position_noise': [0.1, 0.1],
        'velocity_noise': [0.1, 0.1], 'velocity_sensor': 'filtered', 'sample_loss': 0.1,
        'sample_jitter': 1e-4, 'late_samples': 0.1, 'viscous_friction': [0.7, 0.7]}
    tree['controller']['ros__parameters'] |= {
        'input_delay': 4, 'inertia_scale': 2.0, 'gravity_scale': 2.0, 'actuator_lag': [0.1, 0.1],
        'torque_rate_limit': [1.0, 1.0]}
    file = tmp_path / 'spoiled.yaml'
    file.write_text(yaml.safe_dump(tree))
    return file


def setups(file: Path, name: str) -> list[Setup]:
    return [parameter_file.load(file, case.overrides)
            for case in find_condition(name).cases(parameter_file.load(file))]


def test_an_unknown_condition_is_refused() -> None:
    assert [x for x in CONDITIONS if x != 'payload'] == list(SET)
    with pytest.raises(UsageError, match='no condition is called rain; allowed: clean, lag'):
        find_condition('rain')


@pytest.mark.parametrize('name', SET)
def test_a_condition_replaces_drives_sensors_and_model_error_only(
        name: str, spoiled: Path) -> None:
    plant, controllers = SET[name]
    plain = PlantConfig().as_mapping()
    for file in (FRICTION, spoiled):
        found = setups(file, name)
        for setup, controller in zip(found, controllers, strict=True):
            mine = setup.plant.as_mapping()
            assert {key: mine[key] for key in OF_THE_PLANT} == {
                key: plain[key] for key in OF_THE_PLANT} | plant
            known, default = setup.controller.as_mapping(), ControllerConfig().as_mapping()
            assert {key: known[key] for key in OF_THE_CONTROLLER} == {
                key: default[key] for key in OF_THE_CONTROLLER} | {
                    'actuator_lag': (0.0, 0.0)} | controller
            assert setup.reference.start_duration == 2.0
            assert (setup.reference.profile == 'trapezoid') == (name == 'stops')
            assert setup.controller.error_limit == (3.0, 3.0)
    assert found[0].plant.viscous_friction == (0.7, 0.7)
    assert found[0].plant.torque_saturation == (5100.0, 850.0)


def test_friction_of_the_controller_has_the_error_of_the_condition() -> None:
    """Check both signs on both joints, over the two runs."""
    assert [x.controller.friction_level for x in setups(FRICTION, 'real_arm')] == [
        pytest.approx((10.89, 8.91)), pytest.approx((8.91, 10.89))]
    assert [x.controller.friction_level for x in setups(FRICTION, 'lag')] == [(9.9, 9.9)]


def test_events_of_the_file_are_left_out() -> None:
    assert parameter_file.load(CONFIG / 'switch.yaml').events
    assert not setups(CONFIG / 'switch.yaml', 'clean')[0].events


def test_rate_limits_come_from_file_paper_or_description() -> None:
    assert torque_rates(parameter_file.load(FRICTION)) == (5000.0, 1000.0)
    own = {'plant': {'torque_rate_limit': [300.0, inf]}}
    assert torque_rates(parameter_file.load(FRICTION, own)) == (300.0, inf)
    panda = parameter_file.load(CONFIG / 'panda.yaml')
    assert torque_rates(panda) == pytest.approx((87.0 / 0.05,) * 4 + (12.0 / 0.05,) * 3)


def test_stops_are_for_motions_without_waypoints() -> None:
    waypoints = parameter_file.load(FRICTION, {'reference': {
        'trajectory_file': str(CONFIG / 'trajectories' / 'waypoints.yaml')}})
    with pytest.raises(UsageError, match='condition stops needs a motion without waypoints'):
        find_condition('stops').cases(waypoints)


def test_a_payload_is_for_robots_of_a_urdf() -> None:
    """Check that the plant has it and the controller has not, and that `all` is what fits."""
    with pytest.raises(UsageError, match='condition payload needs a robot in a URDF'):
        setups(FRICTION, 'payload')
    (setup,) = setups(CONFIG / 'panda.yaml', 'payload')
    assert setup.plant.payload == 1.0
    found = {path.stem: list(dict.fromkeys(run.columns['condition'] for run in ComparisonSpec(
        [path], ['compensation'], ['all']).runs()))
        for path in (FRICTION, CONFIG / 'panda.yaml')}
    assert found == {'friction': list(SET), 'panda': list(CONDITIONS)}


def drawn(file: Path, seed: int = 5, count: int = 24) -> list[Setup]:
    nominal = parameter_file.load(file)
    return [parameter_file.load(file, case.overrides)
            for case in held_out_cases(nominal, count, seed)]


def test_a_held_out_case_depends_on_seed_and_index_only() -> None:
    """Check that more conditions begin with the same ones."""
    nominal = parameter_file.load(CONFIG / 'friction.yaml')
    few, more, other = (list(held_out_cases(nominal, n, seed))
                        for n, seed in ((3, 5), (9, 5), (3, 6)))
    assert more[:3] == few
    assert all(a.overrides != b.overrides for a, b in zip(few, other))
    assert len({case.name for case in (*more, *other)}) == 12


@pytest.mark.parametrize('robot', ['friction', 'panda', 'ur5'])
def test_draws_are_within_the_documented_ranges(robot: str) -> None:
    """Check the ratios of what the controller is told; both sides of right are drawn."""
    file = CONFIG / f'{robot}.yaml'
    nominal, found = parameter_file.load(file), drawn(file)
    rates, ratios = np.array(torque_rates(nominal)), []
    for setup in found:
        plant, told = setup.plant, setup.controller
        of_drives = np.array(plant.torque_rate_limit) / rates
        friction = np.array(plant.coulomb_friction) / nominal.plant.coulomb_friction
        stribeck = np.array(plant.stribeck_friction) / plant.coulomb_friction
        assert np.ptp(of_drives) < 1e-9
        for values, low, high in (
                (of_drives, 0.5, 2.0), (friction, 0.7, 1.3), (stribeck, 0.0, 0.3),
                ((told.inertia_scale, told.gravity_scale), 0.85, 1.15),
                (plant.encoder_resolution, 1e-6, 1e-4), ((plant.sample_loss,), 0.0, 0.1),
                ((plant.sample_jitter / plant.control_period,), 0.0, 0.3)):
            assert low <= min(values) <= max(values) <= high
        assert told.friction_level == nominal.plant.coulomb_friction
        assert told.input_delay == plant.input_delay <= 2
        assert set(told.error_limit) == {LOST_ERROR_RAD}
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
