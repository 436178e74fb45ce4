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

"""Figures and page of a map, from its spec and its rows."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.runs.map_page import facts, write_report
from ctc_chattering.runs.spec import MapSpec, read_spec
from map_tables import made_up
import pytest

SPEC = """
params_file: friction
duration: 3.0
window: [1.0, 2.5]
laws: [compensation, chattering sign]
axes:
  ka: {parameter: controller.ka, values: [5, 20]}
  load: {parameter: plant.coulomb_friction, values: [1], factor: true}
uncertain:
  model: {parameters: [controller.inertia_scale, controller.gravity_scale], uniform: [0.8, 1.2]}
  noise: {parameter: plant.position_noise, log_uniform: [1.0e-5, 2.0e-4]}
sampling: latin_hypercube
repeats: 3
seed: 4
failure: {error_above: 0.005, saturated_above: 0.25, not_reached: true}
"""


@pytest.fixture
def spec(tmp_path: Path) -> MapSpec:
    path = tmp_path / 'small.yaml'
    path.write_text(SPEC, encoding='utf-8')
    return read_spec(path)


def test_facts_are_those_of_the_spec(spec: MapSpec) -> None:
    assert facts(spec) == {
        'map': 'small', 'robot and motion': 'friction, 3 s, evaluated from 1 s to 2.5 s',
        'ka': 'controller.ka', 'load': 'factor of plant.coulomb_friction',
        'model': 'controller.inertia_scale and controller.gravity_scale, uniform, 0.8 to 1.2',
        'noise': 'plant.position_noise, log-uniform, 1e-5 to 2e-4',
        'draws': 'latin_hypercube, with seed 4',
        'a run fails if': 'it diverges, or the RMS error of a joint exceeds 0.005 rad, or a '
                          'torque is at its limit in more than 25 % of the samples, or v never '
                          'stays within its band, or it would take more than 1e6 steps of the '
                          'integrator'}


def test_without_limits_only_a_run_that_diverges_fails(tmp_path: Path) -> None:
    path = tmp_path / 'least.yaml'
    path.write_text('duration: 1.0', encoding='utf-8')
    found = facts(read_spec(path))
    assert found['a run fails if'] == (
        'it diverges, or it would take more than 1e6 steps of the integrator')
    assert 'draws' not in found


def test_figures_and_page_are_beside_the_results(spec: MapSpec, tmp_path: Path) -> None:
    table = made_up({axis.name: axis.values for axis in spec.axes}, 3,
                    variants=[x.name for x in spec.variants])
    page = write_report(spec, table, tmp_path / 'out')
    assert page == tmp_path / 'out' / 'index.html'
    text = page.read_text(encoding='utf-8')
    for file in ('lines', 'bands', 'failures', 'dependence'):
        assert (tmp_path / 'out' / 'figures' / f'{file}.svg').is_file()
        assert f'src="figures/{file}.svg"' in text
    assert 'href="map.parquet"' in text and 'href="map.json"' in text
    assert '2 values, 5 to 20: controller.ka' in text
    assert 'ka [N·m]' in text
