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

"""Quantities: what a number does to parameters, and what is refused."""

from __future__ import annotations

from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.runs.spec import applied, check, read_axis, read_uncertain
import numpy as np
import pytest

SETUP = parameter_file.load(None, {'plant': {'duration': 1.0}})
FRICTION = 'plant.coulomb_friction'


def axis(parameter: str | list[str], values: list[float], **more: Any) -> Any:
    key = 'parameter' if isinstance(parameter, str) else 'parameters'
    return read_axis('x', {key: parameter, 'values': values, **more})


def test_a_number_is_that_of_every_joint_and_of_every_node() -> None:
    setup = applied(SETUP, [(axis(FRICTION, [3]), 3.0), (axis('control_period', [2e-3]), 2e-3)])
    assert setup.plant.coulomb_friction == (3.0, 3.0)
    periods = {x.control_period for x in (setup.plant, setup.controller, setup.reference)}
    assert periods == {2e-3}
    assert setup == parameter_file.load(None, {
        'plant': {'duration': 1.0, 'coulomb_friction': [3, 3]}, '/**': {'control_period': 2e-3}})


def test_an_integer_stays_one() -> None:
    delay = axis(['plant.input_delay', 'controller.input_delay'], [0, 1, 2])
    setup = applied(SETUP, [(delay, 2.0)])
    assert (setup.plant.input_delay, setup.controller.input_delay) == (2, 2)
    assert type(setup.plant.input_delay) is int
    with pytest.raises(CtcError, match=r'input_delay: 1\.5 is not allowed; allowed: an integer'):
        applied(SETUP, [(delay, 1.5)])


def test_a_factor_multiplies_what_is_there() -> None:
    file = SETUP.changed({'plant': {'coulomb_friction': [2.0, 4.0]}})
    double, level = axis(FRICTION, [2], factor=True), axis(FRICTION, [3])
    assert applied(file, [(double, 2.0)]).plant.coulomb_friction == (4.0, 8.0)
    assert applied(file, [(level, 3.0), (double, 2.0)]).plant.coulomb_friction == (6.0, 6.0)
    assert applied(file, [(double, 2.0), (double, 2.0)]).plant.coulomb_friction == (8.0, 16.0)
    full = SETUP.changed({'controller': {'kp': [2.0, 0.5, 0.5, 3.0]}})
    gain = axis('controller.kp', [2], factor=True)
    assert applied(full, [(gain, 2.0)]).controller.kp == (4.0, 1.0, 1.0, 6.0)


def test_the_noise_has_a_seed() -> None:
    assert applied(SETUP, [], 5).plant.noise_seed == 5


def test_a_range_is_a_grid() -> None:
    """Check both spacings against their definition."""
    linear = read_axis('x', {'parameter': FRICTION, 'range': [1, 3], 'count': 5})
    assert linear.values == (1.0, 1.5, 2.0, 2.5, 3.0)
    log = read_axis('x', {'parameter': FRICTION, 'range': [1, 100], 'count': 5, 'spacing': 'log'})
    np.testing.assert_allclose(log.values, [10.0 ** (k / 2) for k in range(5)], rtol=1e-14)
    assert (log.values[0], log.values[-1]) == (1.0, 100.0)


def test_units() -> None:
    assert axis(FRICTION, [1]).unit == 'N*m'
    assert axis(FRICTION, [1], factor=True).unit == ''
    assert axis('plant.input_delay', [1]).unit == ''


@pytest.mark.parametrize(('tree', 'words'), [
    (3, ['axes.x', '3', 'a mapping of parameter']),
    ({'parametr': 'a'}, ['parametr', 'allowed: a mapping of parameter']),
    ({'values': [1]}, ['one of parameter, parameters']),
    ({'parameter': FRICTION, 'parameters': [FRICTION], 'values': [1]}, ['one of parameter']),
    ({'parameters': [], 'values': [1]}, ['axes.x.parameters', 'one or more']),
    ({'parameters': [FRICTION, FRICTION], 'values': [1]}, ['one or more, each once']),
    ({'parameter': 'plant.coulomb', 'values': [1]}, ['plant.coulomb', 'such as plant.']),
    ({'parameter': 'recorder.bag', 'values': [1]}, ['recorder.bag', 'a parameter of plant']),
    ({'parameter': 'controller.law', 'values': [1]}, ['controller.law', 'that is a number']),
    ({'parameter': 'plant.command_timeout', 'values': [1]}, ['plant.command_timeout']),
    ({'parameter': 'plant.duration', 'values': [1]}, ['plant.duration', 'set others']),
    ({'parameter': 'noise_seed', 'values': [1]}, ['noise_seed', 'set others']),
    ({'parameter': FRICTION}, ['axes.x.values: None', 'a list']),
    ({'parameter': FRICTION, 'values': [1], 'range': [1, 2]}, ['values', 'parameter, ']),
    ({'parameter': FRICTION, 'values': []}, ['axes.x.values', 'one number or more']),
    ({'parameter': FRICTION, 'values': [2, 1]}, ['ascending']),
    ({'parameter': FRICTION, 'values': [1, 1]}, ['ascending']),
    ({'parameter': FRICTION, 'values': [1, 'a']}, ['axes.x.values', 'a list of finite numbers']),
    ({'parameter': FRICTION, 'values': [1], 'count': 3}, ['count', 'factor, values']),
    ({'parameter': FRICTION, 'range': [1, 2]}, ['axes.x.count', 'an integer >= 2']),
    ({'parameter': FRICTION, 'range': [1, 2], 'count': 1}, ['axes.x.count', '1', '>= 2']),
    ({'parameter': FRICTION, 'range': [2, 1], 'count': 3}, ['axes.x.range', 'ascending']),
    ({'parameter': FRICTION, 'range': [0, 1], 'count': 3, 'spacing': 'log'}, ['range', '> 0']),
    ({'parameter': FRICTION, 'range': [1, 2], 'count': 3, 'spacing': 'cubic'}, ['linear | log']),
    ({'parameter': FRICTION, 'values': [1], 'factor': 2}, ['axes.x.factor', 'a boolean'])])
def test_bad_axes(tree: Any, words: list[str]) -> None:
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
def test_bad_distributions(distribution: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(ParameterError) as error:
        read_uncertain('x', {'parameter': FRICTION, **distribution})
    assert [word for word in words if word not in str(error.value)] == []


def test_values_are_checked_before_anything_runs() -> None:
    """Check the ends of a distribution, contradictions, and the order of what is set twice."""
    level, factor = axis(FRICTION, [3]), axis(FRICTION, [2], factor=True)
    check([(level, (3.0,)), (factor, (2.0,))], SETUP)
    for quantities, words in (
            ([(axis(FRICTION, [-1, 1]), (-1.0, 1.0))], ['x = -1', 'coulomb_friction', '>= 0']),
            ([(axis('plant.control_period', [2e-3]), (2e-3,))], ['x = 0.002', 'put what nodes']),
            ([(level, ()), (read_axis('y', {'parameter': FRICTION, 'values': [1]}), ())],
             ['y', FRICTION, 'a factor, for x sets it'])):

        with pytest.raises(CtcError) as error:
            check(quantities, SETUP)
        assert [word for word in words if word not in str(error.value)] == []
    far = read_uncertain('x', {'parameter': FRICTION, 'normal': [1.0, 9.0]})
    check([(far, far.typical)], SETUP)  # A draw below 0 is refused when it comes.
