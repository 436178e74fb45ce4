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

"""Specs: what they say, and one line for everything that is wrong with them."""

from __future__ import annotations

from math import inf
from pathlib import Path
import re
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.errors import CtcError
from ctc_chattering.runs.recommended import recommended_setup
from ctc_chattering.runs.spec import KEYS, read_spec
from map_specs import ON_TRACK, SMALL, spec, written
import pytest
import yaml

CONFIG = Path(__file__).parents[2] / 'config'
#: Every key, as docs/maps.md explains them.
FULL = """
params_file: friction
duration: 5.0
window: [2.0, 5.0]
overrides:
  plant: {velocity_noise: [1.0e-3, 1.0e-3]}
laws:
  - compensation
  - chattering sign
  - {law: observer_feedback, recommended: true}
  - {law: chattering, switching: implicit, name: 'soft', ka: [15.0, 15.0]}
axes:
  friction: {parameter: plant.coulomb_friction, values: [2, 5, 10, 20]}
  ka: {parameter: controller.ka, range: [1, 40], count: 12, spacing: log}
  rate: {parameter: control_period, values: [5.0e-4, 1.0e-3, 2.0e-3]}
  delay: {parameters: [plant.input_delay, controller.input_delay], values: [0, 1, 2]}
  load: {parameter: plant.coulomb_friction, values: [0.5, 1, 2], factor: true}
uncertain:
  model: {parameters: [controller.inertia_scale, controller.gravity_scale], uniform: [0.9, 1.1]}
sampling: latin_hypercube
repeats: 16
seed: 3
failure:
  error_above: 0.01
  saturated_above: 0.05
  not_reached: true
"""


def test_every_key(tmp_path: Path) -> None:
    (tmp_path / 'full.yaml').write_text(FULL, encoding='utf-8')
    found = read_spec(tmp_path / 'full.yaml')
    assert found.name == 'full'
    assert found.setup == parameter_file.load(CONFIG / 'friction.yaml', {
        'plant': {'duration': 5.0, 'velocity_noise': [1e-3, 1e-3]}})
    assert found.window == (2.0, 5.0)
    assert [x.name for x in found.axes] == ['friction', 'ka', 'rate', 'delay', 'load']
    assert found.shape == (4, 12, 3, 3, 3)
    assert found.runs == 4 * 12 * 3 * 3 * 3 * 4 * 16
    assert [x.name for x in found.uncertain] == ['model']
    assert found.repeats.as_mapping() == {
        'sampling': 'latin_hypercube', 'repeats': 16, 'seed': 3}
    assert found.failure.as_mapping() == {
        'error_above': 0.01, 'saturated_above': 0.05,
        'not_reached': True, 'slips_above': inf}
    assert [(x.name, x.law, x.switching, x.recommended) for x in found.variants] == [
        ('compensation', 'compensation', '', False),
        ('chattering sign', 'chattering', 'sign', False),
        ('observer_feedback recommended', 'observer_feedback', '', True),
        ('soft', 'chattering', 'implicit', False)]
    assert found.variants[3].values == {
        'law': 'chattering', 'switching': 'implicit', 'ka': [15.0, 15.0]}


def test_defaults() -> None:
    """Check a spec of nothing: the law of the file, one run, the second half of it."""
    found = spec(**{**dict.fromkeys(SMALL), 'duration': 2.0})
    assert found.setup.plant.experiment == 'friction'
    assert found.window == (1.0, 2.0)
    assert [x.name for x in found.variants] == ['chattering sign']
    assert (found.shape, found.runs) == ((), 1)
    assert found.failure.error_above == inf


def test_paths_count_from_the_spec(tmp_path: Path) -> None:
    (tmp_path / 'below').mkdir()
    parameters = tmp_path / 'mine.yaml'
    parameters.write_text('controller: {ros__parameters: {ka: [3.0, 4.0]}}', encoding='utf-8')
    path = written(tmp_path / 'below' / 'map.yaml', params_file='../mine.yaml')
    assert read_spec(path).setup.controller.ka == (3.0, 4.0)
    path = written(tmp_path / 'below' / 'map.yaml', params_file=str(parameters))
    assert read_spec(path).setup.controller.ka == (3.0, 4.0)


@pytest.mark.parametrize('path', sorted((CONFIG / 'maps').iterdir()), ids=lambda x: x.stem)
def test_specs_of_the_package(path: Path) -> None:
    assert read_spec(path).runs > 100


def test_the_spec_of_the_docs_is_one(tmp_path: Path) -> None:
    """Check that the page has every key, and nothing that is refused."""
    page = (CONFIG.parent / 'docs' / 'maps.md').read_text(encoding='utf-8')
    found = re.search(r'```yaml\n(params_file.*?)```', page, re.DOTALL)
    assert found
    (tmp_path / 'docs.yaml').write_text(found[1], encoding='utf-8')
    assert read_spec(tmp_path / 'docs.yaml').runs == 4 * 12 * 3 * 3 * 3 * 4 * 16
    assert {*KEYS} - {*yaml.safe_load(found[1])} == {'tune'}


def test_a_law_is_recommended_as_docs_say() -> None:
    found = spec(laws=['compensation', {'law': 'chattering', 'recommended': True}])
    made = recommended_setup(found.setup, 'chattering').controller
    assert found.variants[1].switching == made.switching
    assert found.variants[1].name == f'chattering {made.switching} recommended'


@pytest.mark.parametrize(('changes', 'words'), [
    ({'axis': {}}, ["'axis'", 'params_file, duration']),
    ({'params_file': 'nowhere.yaml'}, ['nowhere.yaml', 'no such file']),
    ({'params_file': 3}, ['params_file', '3', 'a string']),
    ({'duration': 0}, ['duration', 'a number > 0']),
    ({'duration': 'long'}, ['plant: duration', "'long'", 'a finite number']),
    ({'window': [0.05]}, ['window', 'two times']), ({'window': 3}, ['window', 'a list']),
    ({'window': [0.05, 0.2]}, ['window', 'from 0 to 0.1 s']),
    ({'window': [0.05, 0.05]}, ['window', 'ascending']),
    ({'overrides': [1]}, ['overrides', 'a mapping of nodes']),
    ({'overrides': {'plant': 3}}, ['overrides', 'a mapping of nodes']),
    ({'overrides': {'plant': {'mass': 3}}}, ['overrides', 'plant has no parameter mass']),
    ({'laws': []}, ['laws', 'a list of laws']), ({'laws': 'chattering'}, ['laws', 'a list']),
    ({'laws': ['chatering']}, ['laws[0].law', "'chatering'", 'compensation | chattering']),
    ({'laws': ['chattering soft']}, ['laws[0].switching', "'soft'", 'sign']),
    ({'laws': ['integral sign']}, ['laws[0].switching', "'sign'", 'none under law integral']),
    ({'laws': ['chattering sign now']}, ['laws[0]', 'a law and a switching']),
    ({'laws': [3]}, ['laws[0]', '3', 'a mapping']),
    ({'laws': [{'law': 'chattering', 'gain': 3}]}, ['laws[0].gain', 'one of']),
    ({'laws': [{'ka': [1.0] * 3}]}, ['laws[0].ka', 'got 3 values']),
    ({'laws': [{'recommended': 1}]}, ['laws[0].recommended', 'a boolean']),
    ({'laws': ['chattering', 'chattering sign']}, ['laws', 'give each a name']),
    ({'axes': [1]}, ['axes', 'a mapping of names']),
    ({'axes': {'error': {}}}, ['axes', "'error'", 'no column']),
    ({'axes': {'rms_error_rad_2': {}}}, ['rms_error_rad_2', 'no column']),
    ({'axes': {'a b': {}}}, ["'a b'", 'letters, digits']), ({'axes': {1: {}}}, ['axes: 1']),
    ({'axes': {'x': {'parameter': 'plant.payload', 'values': [1]}}}, ['x = 1', 'payload']),
    ({'uncertain': {'friction': SMALL['uncertain']['model']}}, ["'friction'", 'no column']),
    ({'uncertain': {'x': {'parameter': 'plant.actuator_lag', 'uniform': [-1, 1]}}},
     ['x = -1', 'actuator_lag', '>= 0']),
    ({'sampling': 'halton'}, ['sampling', "'halton'", 'random | latin_hypercube | sobol']),
    ({'repeats': 0}, ['repeats', '0', '>= 1']), ({'seed': -1}, ['seed', '-1', '>= 0']),
    ({'failure': 3}, ['failure', '3', 'error_above']),
    ({'failure': {'error': 3}}, ["'error'", 'error_above, saturated_above']),
    ({'failure': {'error_above': -1}}, ['failure.error_above', '-1', '>= 0']),
    ({'repeats': 9_999_999}, ['119999988 runs', '6 points, 2 laws', 'allowed: 10000000'])])
def test_bad_specs(tmp_path: Path, changes: dict[str, Any], words: list[str]) -> None:
    """Check a line with the file, the key, its value and what is allowed."""
    path = written(tmp_path / 'bad.yaml', **changes)
    with pytest.raises(CtcError) as error:
        read_spec(path)
    text = str(error.value)
    assert len(text.splitlines()) == 1
    assert [word for word in (str(path), *words) if word not in text] == []


@pytest.mark.parametrize(('text', 'word'), [
    ('- 1', 'a mapping of params_file'), ('a: [', 'not a YAML file'),
    ('laws: &a [*a]', 'Circular reference')])
def test_what_is_no_spec(tmp_path: Path, text: str, word: str) -> None:
    (tmp_path / 'bad.yaml').write_text(text, encoding='utf-8')
    with pytest.raises(CtcError, match=word):
        read_spec(tmp_path / 'bad.yaml')
    with pytest.raises(CtcError, match='No such file'):
        read_spec(tmp_path / 'none.yaml')


def test_the_small_map_starts_on_track() -> None:
    assert spec().setup.plant.initial_velocity == tuple(ON_TRACK['initial_velocity'])


@pytest.mark.parametrize(('changes', 'words'), [
    ({'refine': 1}, 'refine: 1 is not allowed; allowed: 0, or an axis with a range'),
    ({'refine': -1}, 'refine: -1'),
    ({'refine': 2, 'axes': {'ka': {'parameter': 'ka', 'range': [1, 9], 'count': 8}}},
     'axes.ka.count: 8 is not allowed; allowed: a multiple of 4 and 1 with refine 2'),
    ({'sampling': 'saltelli'}, 'is not allowed; allowed: without axes, for what is uncertain'),
    ({'sampling': 'saltelli', 'axes': None, 'repeats': 9},
     'with repeats of 3 times a power of two')])
def test_refine_and_saltelli_are_checked(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(CtcError, match=re.escape(words)):
        spec(**changes)


def test_the_coarse_grid_is_of_axes_with_a_range() -> None:
    axes = {'ka': {'parameter': 'ka', 'range': [1, 9], 'count': 9},
            'delay': {'parameter': 'plant.input_delay', 'values': [0, 1, 2]}}
    assert spec(axes=axes, refine=2).coarse == (4, 1)
    assert spec(axes=axes).coarse == (1, 1)
    assert spec(sampling='saltelli', axes=None, repeats=12).runs == 24
