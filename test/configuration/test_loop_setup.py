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

"""The setup of a closed loop: its values, their changes and contradictions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.node_parameters import LOOP, NODES
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
from parameter_files import loaded, refused
import pytest

CONFIG = Path(__file__).parents[2] / 'config'


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / 'a file.yaml'


@pytest.mark.parametrize(('node', 'line'), [
    ('plant', 'control_period: 0.002'), ('reference', 'control_period: 0.002'),
    ('controller', 'control_period: 0.002'), ('plant', 'joint_names: [joint2, joint1]'),
    ('controller', 'joint_names: [a, b]'), ('reference', 'joint_names: [joint1, other]'),
    ('plant', 'gravity: 9.8'), ('controller', 'gravity: 1.0')])
def test_contradictions(file: Path, node: str, line: str) -> None:
    """Check that both nodes and the parameter are named; the same under /** is no trouble."""
    name = line.split(':')[0]
    refused(lambda: loaded(file, (node, line)), name, ' of ', 'contradicts', node, '/**')
    if 'other' not in line:
        assert loaded(file, ('/**', line)).values[node][name]


@pytest.mark.parametrize('values', [
    {'plant': {'coulomb_friction': [1, 2], 'noise_seed': 3}, 'controller': {'lambda': 4}},
    {node: {'control_period': 2e-3} for node in LOOP},
    {'reference': {'amplitude': [0.1, 0.2]}, 'plant': {'initial_position': [1, 2]}}])
def test_what_is_changed_is_as_if_loaded(file: Path, values: dict[str, Any]) -> None:
    setup = loaded(file, ('plant', 'duration: 1.0'),
                   ('bringup', "events: ['0.5 controller law compensation']"))
    assert setup.changed(values) == parameter_file.load(file, values)


def test_what_is_changed_is_checked() -> None:
    setup = parameter_file.load(CONFIG / 'panda.yaml')
    for node, values, words in (
            ('plant', {'control_period': 2e-3}, ('control_period', 'put what nodes share')),
            ('controller', {'ka': [-1.0] * 7}, ('controller: ka', '-1.0', '>= 0')),
            ('plant', {'initial_position': [9.0] * 7}, ('panda_joint1', 'limits')),
            ('reference', {'amplitude': [9.0] * 7}, ('the motion', 'panda_joint1', 'limits'))):
        refused(lambda: setup.changed({node: values}), *words)


def test_a_setup_of_configurations_has_their_values() -> None:
    """A value is that of its configuration, also after a change, and a file has no other ones."""
    plant, controller = PlantConfig(duration=2.0), ControllerConfig(law='integral')
    setup = Setup(plant, controller, ReferenceConfig())
    assert setup.values['plant'] == plant.as_mapping()
    assert setup.changed({'controller': {'ki': 5.0}}).values['controller']['ki'] == (5.0, 5.0)
    loaded_setup = parameter_file.load(CONFIG / 'friction.yaml')
    assert list(loaded_setup.values) == list(NODES)
    for node, config in NODES.items():
        assert list(loaded_setup.values[node]) == list(config.parameters())
