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

from ctc_chattering.runs.map_page import write_report
from ctc_chattering.runs.spec import MapSpec, read_spec, rows_of
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


def test_the_page_has_the_spec_as_it_was_given(spec: MapSpec) -> None:
    found = dict(rows_of(spec.tree))
    assert found['window'] == '[1.0, 2.5]'
    assert found['laws'] == '[compensation, chattering sign]'
    assert found['axes ka'] == '{parameter: controller.ka, values: [5, 20]}'
    assert found['uncertain noise'] == (
        '{parameter: plant.position_noise, log_uniform: [1.0e-05, 0.0002]}')
    assert (found['sampling'], found['seed']) == ('latin_hypercube', '4')
    assert found['failure error_above'] == '0.005'
    assert found['failure not_reached'] == 'true'


def test_figures_and_page_are_beside_the_results(spec: MapSpec, tmp_path: Path) -> None:
    table = made_up({axis.name: axis.values for axis in spec.axes}, 3,
                    variants=[x.name for x in spec.variants])
    page = write_report(spec, table, tmp_path / 'out')
    assert page == tmp_path / 'out' / 'index.html'
    text = page.read_text(encoding='utf-8')
    for file in ('lines', 'failures', 'dependence'):
        assert (tmp_path / 'out' / 'figures' / f'{file}.svg').is_file()
        assert f'src="figures/{file}.svg"' in text
    assert 'href="map.parquet"' in text and 'href="map.json"' in text
    assert 'friction, 3 s, evaluated from 1 s to 2.5 s' in text
    assert 'ka [N·m]' in text
