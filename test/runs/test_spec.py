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

"""Specs and quantities: what they say, and one line for everything that is wrong with them."""

from __future__ import annotations

from math import inf
from pathlib import Path
import re
from typing import Any

from ctc_chattering.analysis.metrics import WARN_ERROR_SHARE
from ctc_chattering.configuration import parameter_file
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.runs.recommended import recommended_setup
from ctc_chattering.runs.spec import (
    check_quantities,
    Failure,
    KEYS,
    read_axis,
    read_spec,
    read_uncertain,
    set_quantities,
)
from map_specs import SMALL, spec, written
import numpy as np
import pytest
import yaml

CONFIG = Path(__file__).parents[2] / 'config'


def test_every_key_is_in_the_docs_and_means_what_they_say(tmp_path: Path) -> None:
    page = (CONFIG.parent / 'docs' / 'maps.md').read_text(encoding='utf-8')
    text = re.search(r'```yaml\n(params_file.*?)```', page, re.DOTALL)
    assert text
    assert {*KEYS} - {*yaml.safe_load(text[1])} == {'tune'}
    (tmp_path / 'docs.yaml').write_text(text[1], encoding='utf-8')
    found = read_spec(tmp_path / 'docs.yaml')
    assert found.name == 'docs'
    assert found.setup == parameter_file.load(CONFIG / 'friction.yaml', {
        'plant': {'duration': 5.0, 'velocity_noise': [1e-3, 1e-3]}})
    assert found.window == (2.5, 5.0)
    assert [x.name for x in found.axes] == ['friction', 'ka', 'rate', 'delay', 'load']
    assert (found.shape, found.runs) == ((4, 12, 3, 3, 3), 4 * 12 * 3 * 3 * 3 * 4 * 16)
    assert [x.name for x in found.uncertain] == ['model', 'lag']
    assert found.repeats.as_mapping() == {'sampling': 'sobol', 'repeats': 16, 'seed': 0}
    assert found.failure.as_mapping() == {
        'error_above': 0.01, 'error_share_above': 0.2, 'saturated_above': 0.05,
        'not_reached': True, 'slips_above': 1.0}
    assert [(x.name, x.law, x.switching, x.is_recommended) for x in found.variants] == [
        ('compensation', 'compensation', '', False),
        ('chattering sign', 'chattering', 'sign', False),
        ('observer_feedback recommended', 'observer_feedback', '', True),
        ('soft', 'chattering', 'implicit', False)]


def test_an_empty_spec_has_defaults() -> None:
    """Check a spec of nothing: the law of the file, one run, the second half of it."""
    found = spec(**{**dict.fromkeys(SMALL), 'duration': 2.0})
    assert found.setup.plant.experiment == 'friction'
    assert found.window == (1.0, 2.0)
    assert [x.name for x in found.variants] == ['chattering sign']
    assert (found.shape, found.runs) == ((), 1)
    assert found.failure == Failure(error_share_above=WARN_ERROR_SHARE)
    assert spec(failure={}).failure == Failure()
    assert spec(failure={'slips_above': 1.0}).failure.error_share_above == inf


def test_paths_count_from_the_spec(tmp_path: Path) -> None:
    (tmp_path / 'below').mkdir()
    parameters = tmp_path / 'mine.yaml'
    parameters.write_text('controller: {ros__parameters: {ka: [3.0, 4.0]}}', encoding='utf-8')
    path = written(tmp_path / 'below' / 'map.yaml', params_file='../mine.yaml')
    assert read_spec(path).setup.controller.ka == (3.0, 4.0)
    path = written(tmp_path / 'below' / 'map.yaml', params_file=str(parameters))
    assert read_spec(path).setup.controller.ka == (3.0, 4.0)


@pytest.mark.parametrize('path', sorted((CONFIG / 'maps').iterdir()), ids=lambda x: x.stem)
def test_specs_of_the_package_are_read(path: Path) -> None:
    assert read_spec(path).runs > 100


def test_a_recommended_law_has_its_own_switching_and_name() -> None:
    found = spec(laws=['compensation', {'law': 'chattering', 'recommended': True}])
    made = recommended_setup(found.setup, 'chattering').controller
    assert found.variants[1].switching == made.switching
    assert found.variants[1].name == f'chattering {made.switching} recommended'


@pytest.mark.parametrize(('changes', 'words'), [
    ({'axis': {}}, ["'axis'", 'params_file, duration']),
    ({'params_file': 'nowhere.yaml'}, ['nowhere.yaml', 'no such file']),
    ({'duration': 0}, ['duration', 'a number > 0']),
    ({'window': [0.05]}, ['window', 'two times']), ({'window': 3}, ['window', 'a list']),
    ({'window': [0.05, 0.2]}, ['window', 'from 0 to 0.1 s']),
    ({'overrides': [1]}, ['overrides', 'a mapping of nodes']),
    ({'overrides': {'plant': {'mass': 3}}}, ['overrides', 'plant has no parameter mass']),
    ({'laws': []}, ['laws', 'a list of laws']), ({'laws': 'chattering'}, ['laws', 'a list']),
    ({'laws': ['chatering']}, ['laws[0].law', "'chatering'", 'compensation | chattering']),
    ({'laws': ['chattering soft']}, ['laws[0].switching', "'soft'", 'sign']),
    ({'laws': ['integral sign']}, ['laws[0].switching', "'sign'", 'none under law integral']),
    ({'laws': ['chattering sign now']}, ['laws[0]', 'a law and a switching']),
    ({'laws': [{'law': 'chattering', 'gain': 3}]}, ['laws[0].gain', 'one of']),
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
    ({'failure': 3}, ['failure', '3', 'error_above']),
    ({'failure': {'error': 3}}, ["'error'", 'error_above, error_share_above, saturated_above']),
    ({'repeats': 9_999_999}, ['119999988 runs', '6 points, 2 laws', 'allowed: 10000000'])])
def test_an_error_names_file_key_value_and_allowed_ones(
        tmp_path: Path, changes: dict[str, Any], words: list[str]) -> None:
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
def test_a_file_that_is_no_spec_is_refused(tmp_path: Path, text: str, word: str) -> None:
    (tmp_path / 'bad.yaml').write_text(text, encoding='utf-8')
    with pytest.raises(CtcError, match=word):
        read_spec(tmp_path / 'bad.yaml')
    with pytest.raises(CtcError, match='No such file'):
        read_spec(tmp_path / 'none.yaml')


#: Two uncertain quantities.
TWO = {**SMALL['uncertain'], 'lag': {'parameter': 'plant.actuator_lag', 'uniform': [0.0, 1e-3]}}


@pytest.mark.parametrize(('changes', 'words'), [
    ({'refine': 1}, 'refine: 1 is not allowed; allowed: 0, or an axis with a range'),
    ({'refine': -1}, 'refine: -1'),
    ({'refine': 2, 'axes': {'ka': {'parameter': 'ka', 'range': [1, 9], 'count': 8}}},
     'axes.ka.count: 8 is not allowed; allowed: a multiple of 4 and 1 with refine 2'),
    ({'laws': [{1: 2}]}, 'laws[0]: {1: 2} is not allowed; allowed: a law, a law and a switching'),
    ({'laws': [{None: 2, 'law': 'integral'}]}, 'is not allowed; allowed: a law, a law and'),
    ({'sampling': 'saltelli', 'axes': None, 'repeats': 12}, 'two quantities or more, with'),
    ({'sampling': 'saltelli'}, 'is not allowed; allowed: without axes, for what is uncertain'),
    ({'sampling': 'saltelli', 'axes': None, 'repeats': 9, 'uncertain': TWO},
     'with repeats of 4 times a power of two')])
def test_refine_and_saltelli_are_checked(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(CtcError, match=re.escape(words)):
        spec(**changes)


def test_the_coarse_grid_is_of_axes_with_a_range() -> None:
    axes = {'ka': {'parameter': 'ka', 'range': [1, 9], 'count': 9},
            'delay': {'parameter': 'plant.input_delay', 'values': [0, 1, 2]}}
    assert spec(axes=axes, refine=2).coarse == (4, 1)
    assert spec(axes=axes).coarse == (1, 1)
    assert spec(sampling='saltelli', axes=None, repeats=16, uncertain=TWO).runs == 32


SETUP = parameter_file.load(None, {'plant': {'duration': 1.0}})
FRICTION = 'plant.coulomb_friction'


def axis(parameter: str | list[str], values: list[float], **more: Any) -> Any:
    key = 'parameter' if isinstance(parameter, str) else 'parameters'
    return read_axis('x', {key: parameter, 'values': values, **more})


def test_a_number_is_set_on_every_joint_and_node() -> None:
    setup = set_quantities(SETUP, [
        (axis(FRICTION, [3]), 3.0), (axis('control_period', [2e-3]), 2e-3)])
    assert setup.plant.coulomb_friction == (3.0, 3.0)
    periods = {x.control_period for x in (setup.plant, setup.controller, setup.reference)}
    assert periods == {2e-3}
    assert setup == parameter_file.load(None, {
        'plant': {'duration': 1.0, 'coulomb_friction': [3, 3]}, '/**': {'control_period': 2e-3}})


def test_an_integer_stays_one() -> None:
    delay = axis(['plant.input_delay', 'controller.input_delay'], [0, 1, 2])
    setup = set_quantities(SETUP, [(delay, 2.0)])
    assert (setup.plant.input_delay, setup.controller.input_delay) == (2, 2)
    assert type(setup.plant.input_delay) is int
    with pytest.raises(CtcError, match=r'input_delay: 1\.5 is not allowed; allowed: an integer'):
        set_quantities(SETUP, [(delay, 1.5)])


def test_a_factor_multiplies_the_current_value() -> None:
    file = SETUP.changed({'plant': {'coulomb_friction': [2.0, 4.0]}})
    double, level = axis(FRICTION, [2], factor=True), axis(FRICTION, [3])
    assert set_quantities(file, [(double, 2.0)]).plant.coulomb_friction == (4.0, 8.0)
    assert set_quantities(file, [(level, 3.0), (double, 2.0)]).plant.coulomb_friction == (6.0, 6.0)
    twice = set_quantities(file, [(double, 2.0), (double, 2.0)])
    assert twice.plant.coulomb_friction == (8.0, 16.0)
    full = SETUP.changed({'controller': {'kp': [2.0, 0.5, 0.5, 3.0]}})
    gain = axis('controller.kp', [2], factor=True)
    assert set_quantities(full, [(gain, 2.0)]).controller.kp == (4.0, 1.0, 1.0, 6.0)


def test_a_range_is_a_grid() -> None:
    """Check both spacings against their definition."""
    linear = read_axis('x', {'parameter': FRICTION, 'range': [1, 3], 'count': 5})
    assert linear.values == (1.0, 1.5, 2.0, 2.5, 3.0)
    log = read_axis('x', {'parameter': FRICTION, 'range': [1, 100], 'count': 5, 'spacing': 'log'})
    np.testing.assert_allclose(log.values, [10.0 ** (k / 2) for k in range(5)], rtol=1e-14)
    assert (log.values[0], log.values[-1]) == (1.0, 100.0)


@pytest.mark.parametrize(('tree', 'words'), [
    ({'values': [1]}, ['one of parameter, parameters']),
    ({'parameter': FRICTION, 'parameters': [FRICTION], 'values': [1]}, ['one of parameter']),
    ({'parameters': [], 'values': [1]}, ['axes.x.parameters', 'one or more']),
    ({'parameters': [FRICTION, FRICTION], 'values': [1]}, ['one or more, each once']),
    ({'parameter': 'plant.coulomb', 'values': [1]}, ['plant.coulomb', 'such as plant.']),
    ({'parameter': 'controller.law', 'values': [1]}, ['controller.law', 'that is a number']),
    ({'parameter': 'plant.duration', 'values': [1]}, ['plant.duration', 'set others']),
    ({'parameter': 'noise_seed', 'values': [1]}, ['noise_seed', 'set others']),
    ({'parameter': FRICTION, 'values': [1], 'range': [1, 2]}, ['values', 'parameter, ']),
    ({'parameter': FRICTION, 'values': []}, ['axes.x.values', 'one number or more']),
    ({'parameter': FRICTION, 'values': [2, 1]}, ['ascending']),
    ({'parameter': FRICTION, 'values': [1], 'count': 3}, ['count', 'factor, values']),
    ({'parameter': FRICTION, 'range': [1, 2], 'count': 1}, ['axes.x.count', '1', '>= 2']),
    ({'parameter': FRICTION, 'range': [2, 1], 'count': 3}, ['axes.x.range', 'ascending']),
    ({'parameter': FRICTION, 'range': [0, 1], 'count': 3, 'spacing': 'log'}, ['range', '> 0']),
    ({'parameter': FRICTION, 'range': [1, 2], 'count': 3, 'spacing': 'cubic'}, ['linear | log']),
    ({'parameter': FRICTION, 'values': [1], 'factor': 2}, ['axes.x.factor', 'a boolean'])])
def test_an_axis_that_is_not_allowed_is_refused(tree: Any, words: list[str]) -> None:
    with pytest.raises(ParameterError) as error:
        read_axis('x', tree)
    assert [word for word in words if word not in str(error.value)] == []


@pytest.mark.parametrize(('distribution', 'words'), [
    ({}, ['one of uniform, log_uniform, normal, choice']),
    ({'uniform': [1, 2], 'normal': [1, 2]}, ["['uniform', 'normal']", 'one of']),
    ({'uniform': [2, 1]}, ['uncertain.x.uniform', 'two numbers, ascending']),
    ({'uniform': [1]}, ['two numbers']), ({'uniform': 1}, ['uncertain.x.uniform', 'a list']),
    ({'log_uniform': [0, 1]}, ['> 0']), ({'normal': [1, 0]}, ['standard deviation > 0']),
    ({'choice': []}, ['different numbers']), ({'choice': [1, 1]}, ['different numbers']),
    ({'values': [1]}, ['values', 'a mapping of parameter'])])
def test_a_distribution_that_is_not_allowed_is_refused(
        distribution: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(ParameterError) as error:
        read_uncertain('x', {'parameter': FRICTION, **distribution})
    assert [word for word in words if word not in str(error.value)] == []


def test_values_are_checked_before_anything_runs() -> None:
    """Check the ends of a distribution, contradictions, and the order of what is set twice."""
    level, factor = axis(FRICTION, [3]), axis(FRICTION, [2], factor=True)
    check_quantities([(level, (3.0,)), (factor, (2.0,))], SETUP)
    for quantities, words in (
            ([(axis(FRICTION, [-1, 1]), (-1.0, 1.0))], ['x = -1', 'coulomb_friction', '>= 0']),
            ([(axis('plant.control_period', [2e-3]), (2e-3,))], ['x = 0.002', 'put what nodes']),
            ([(level, ()), (read_axis('y', {'parameter': FRICTION, 'values': [1]}), ())],
             ['y', FRICTION, 'a factor, since x sets it'])):

        with pytest.raises(CtcError) as error:
            check_quantities(quantities, SETUP)
        assert [word for word in words if word not in str(error.value)] == []
    far = read_uncertain('x', {'parameter': FRICTION, 'normal': [1.0, 9.0]})
    check_quantities([(far, far.typical)], SETUP)  # A draw below 0 is refused when it comes.
