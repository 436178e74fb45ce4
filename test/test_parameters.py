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

"""Declaration and checks of parameters."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.parameters import Config, LEAST, matrix, parameter, PerJoint, Strings
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
import yaml

NAN, INF = math.nan, math.inf
CONFIGS: list[type[Config]] = [PlantConfig, ControllerConfig, ReferenceConfig]


@dataclasses.dataclass(frozen=True)
class Sample(Config):
    """One parameter of every kind."""

    joint_names: Strings = parameter(('a', 'b', 'c'), 'Joints.')
    flag: bool = parameter(True, 'A switch.')
    count: int = parameter(3, 'A count.', maximum=10)
    share: float = parameter(0.5, 'A share.', maximum=1.0)
    some_gain: PerJoint = parameter(
        2.0, 'A gain.', name='some.gain', minimum=LEAST, shape='nn')
    limit: PerJoint = parameter(INF, 'A limit.')
    times: PerJoint = parameter((1.0, 2.0), 'Times.', minimum=-INF, shape='')


REFUSED: list[tuple[type[Config], str, Any, str]] = [
    *((ControllerConfig, *row) for row in (
        ('kP', [1.0, 1.0], 'one of joint_names, model'), ('kp', [1.0] * 3, 'n = 2, got 3 values'),
        ('kp', [], 'got 0 values'), ('ka', [1.0] * 4, 'one per joint'),
        ('kp', [1.0, NAN], 'finite numbers >= 1e-09'), ('kp', [1.0, INF], 'finite numbers'),
        ('kp', [0.0, 1.0], '>= 1e-09'), ('ka', [-1e-9, 1.0], '>= 0'),
        ('kp', [2.0, 1.0, 1.001, 2.0], 'symmetric positive definite'),
        ('kv', [1.0, 1.0, 1.0, 1.0], 'symmetric positive definite'),
        ('kv', [-1.0, 0.0, 0.0, -1.0], 'symmetric positive definite'),
        ('kp', [2.0, -1e10, -1e10, 1e300], 'symmetric'),
        ('lambda', 0.0, 'a finite number >= 1e-09'), ('lambda', '10', 'a finite number'),
        ('lambda', True, 'a finite number'), ('lambda', [10.0], 'a finite number'),
        ('b', 5e-324, '>= 0.001 and <= 1000'), ('b', 1e308, '<= 1000'),
        ('error_limit', [1e10, 1.0], '>= 1e-09 and <= 1e+09, or inf'),
        ('effort_limit', [-INF, 1.0], '>= 1e-09'), ('effort_rate_limit', [NAN, 1.0], '>= 1e-09'),
        ('ka', 'much', 'one for all or one per joint'), ('ka', True, 'a list of'),
        ('kp', ['1', '2'], 'a list of'), ('kp', [[1.0, 0.0], [0.0, 1.0]], 'a list of'),
        ('law', 'pid', 'compensation | chattering'), ('law', 6, 'compensation | chattering'),
        ('joint_names', 'ab', 'a list of strings'), ('joint_names', ['a', 1], 'a list of strings'),
        ('joint_names', ['a', 'a'], 'all different'), ('joint_names', ['a', ''], 'none empty'),
        ('joint_names', [], 'one or more'), ('joint_names', ['a', 'b', 'c'], '2 names'),
        ('control_period', 0.0, '>= 1e-09'), ('control_period', 1.5e-9, 'nanoseconds'))),
    (PlantConfig, 'initial_position', [-1e10, 0.0], '>= -1e+09 and <= 1e+09'),
    (PlantConfig, 'disturbance.amplitude', [INF, 0.0], 'finite'),
    (PlantConfig, 'pacing', 'fast', 'real_time | lockstep'),
    (PlantConfig, 'experiment', 3, 'a string'),
    *((Sample, *row) for row in (
        ('flag', 1, 'a boolean'), ('flag', 'true', 'a boolean'), ('count', 3.0, 'an integer'),
        ('count', True, 'an integer'), ('count', 11, '>= 0 and <= 10'), ('share', 1.01, '<= 1'),
        ('limit', [1.0, 1.0, -1.0], 'one per joint'), ('times', 1.0, 'a list of'),
        ('times', [NAN], 'finite')))]
#: What a careless user or a broken file can hand over.
ODD: list[tuple[type[Config], str, Any]] = [
    (ControllerConfig, 'joint_names', 5), (ControllerConfig, 'gravity', 10 ** 400),
    (ControllerConfig, 'kp', [10 ** 400, 1]), (ControllerConfig, 'kp', np.array(3.0)),
    (ControllerConfig, 'kp', np.eye(2)), (ControllerConfig, 'ka', b'ab'),
    (ControllerConfig, 'ka', {1.0: 2.0, 3.0: 4.0}), (ControllerConfig, 'gravity', 1j),
    (ControllerConfig, 'law', ['chattering']), (ControllerConfig, 'control_period', 1e300),
    (PlantConfig, 'integration_step', 5e-324), (Sample, 'count', 10 ** 400)]


def _refuse(config: type[Config], name: str, value: object) -> ParameterError:
    with pytest.raises(ParameterError) as caught:
        config.from_mapping({name: value})
    error, text = caught.value, str(caught.value)
    assert error.name == name
    assert text.startswith(f'{name}: ')
    assert text.endswith(error.allowed)
    assert '\n' not in text
    assert isinstance(error, (CtcError, ValueError))
    return error


@pytest.mark.parametrize(('config', 'name', 'value', 'allowed'), REFUSED)
def test_refusals(config: type[Config], name: str, value: object, allowed: str) -> None:
    """Check the type of the error, and a line with name, value and what is allowed."""
    error = _refuse(config, name, value)
    assert allowed in error.allowed
    assert repr(value) in str(error)
    with pytest.raises(ParameterError):
        config().changed({name: value})


@pytest.mark.parametrize(('text', 'number'), [
    ('1e-9', '1.0e-9'), ('1e3', '1.0e+3'), ('-2.5E4', '-2.5e+4'), ('.5e-1', '.5e-1'), ('5', '5'),
    (' 5.0 ', '5.0'), ('+1E+2', '+1.0e+2'), ('inf', '.inf'), ('Infinity', '.inf')])
def test_refusal_of_text_shows_the_number_in_yaml_form(
        text: str, number: str) -> None:
    """The judge is PyYAML itself, by which `ros2 param set` reads values."""
    assert isinstance(yaml.safe_load(number), (int, float))
    assert yaml.safe_load(number) == float(text)
    for value in (text, [text, 1.0, 1.0]):
        error = _refuse(Sample, 'limit', value)
        assert error.allowed.endswith(f'; write {number}, because YAML reads {text!r} as text')


@pytest.mark.parametrize(('name', 'value'), [
    ('share', 'much'), ('share', '1e'), ('share', '1,5'), ('share', 'nan'), ('flag', '1'),
    ('count', '1e3'), ('limit', ['1e3x'])])
def test_other_text_gets_no_advice_on_numbers(name: str, value: object) -> None:
    assert 'write' not in _refuse(Sample, name, value).allowed


@pytest.mark.parametrize(('config', 'name', 'value'), ODD, ids=map(str, range(len(ODD))))
def test_odd_values_are_refused_like_any_other(
        config: type[Config], name: str, value: object) -> None:
    """Check that no other exception escapes and the message stays one line."""
    _refuse(config, name, value)


@pytest.mark.parametrize('config', [*CONFIGS, Sample])
def test_defaults(config: type[Config]) -> None:
    """Check that all defaults are allowed, come one per joint, and survive a round trip."""
    made = config()
    values = made.as_mapping()
    assert list(values) == list(config.parameters())
    assert config.from_mapping(values) == made == made.changed({})
    for name, spec in config.parameters().items():
        assert spec.description.endswith('.')
        if spec.shape in ('n', 'nn'):
            assert len(values[name]) == len(values['joint_names'])


def test_integers_and_arrays_become_floats() -> None:
    """Check the types that come out of YAML, ROS and numpy."""
    made = ControllerConfig.from_mapping({
        'lambda': 7, 'kp': [1, np.float32(2.5)], 'kv': np.array([3, 4]), 'ka': (np.int64(0), 1.0)})
    assert (made.lambda_, made.kp, made.kv, made.ka) == (7.0, (1.0, 2.5), (3.0, 4.0), (0.0, 1.0))
    assert {type(x) for x in (made.lambda_, *made.kp, *made.kv, *made.ka)} == {float}
    assert ControllerConfig.from_mapping({'effort_limit': [INF, 5]}).effort_limit == (INF, 5.0)
    assert Sample.from_mapping({'share': 1, 'times': []}).as_mapping()['times'] == ()
    assert type(Sample.from_mapping({'count': np.int64(4)}).count) is int


@pytest.mark.parametrize('value', [12, 12.0, np.float32(12.0), np.int64(12)])
def test_one_number_is_for_all_joints(value: object) -> None:
    """Check vectors and diagonals, new and changed; what is not allowed stays so."""
    for make in (ControllerConfig.from_mapping, ControllerConfig().changed):
        made = make({'ka': value, 'kp': value})
        assert made.ka == made.kp == (12.0, 12.0)
    assert Sample.from_mapping({'limit': INF}).as_mapping()['limit'] == (INF,) * 3
    assert _refuse(ControllerConfig, 'ka', -1.0).value == (-1.0, -1.0)


def test_full_matrices() -> None:
    """Check row-by-row matrices, negative off-diagonals, and rounding-level asymmetry."""
    kp = (2.0, -1.0, -1.0, 3.0)
    assert matrix(ControllerConfig(kp=kp).kp, 2).tolist() == [[2.0, -1.0], [-1.0, 3.0]]
    assert matrix((5.0, 6.0, 7.0), 3).tolist() == [
        [5.0, 0.0, 0.0], [0.0, 6.0, 0.0], [0.0, 0.0, 7.0]]
    assert matrix((5.0,), 1).tolist() == [[5.0]]
    ControllerConfig(kp=(2.0, 0.1, 0.1 * (1 + 1e-15), 3.0))
    barely = (1.0, 1.0 - 1e-9, 1.0 - 1e-9, 1.0)
    assert ControllerConfig(kv=barely).kv == barely


def test_changed_is_a_copy() -> None:
    """Check that a change leaves the rest and the original as they were."""
    made = PlantConfig(duration=3.0)
    other = made.changed({'disturbance.amplitude': [1, 2]})
    assert other.disturbance_amplitude == (1.0, 2.0)
    assert (made.disturbance_amplitude, other.duration) == ((0.0, 0.0), 3.0)


def test_changed_checks_what_concerns_several_parameters() -> None:
    """Check a value that others do not allow, and joints, on which the size of others depends."""
    with pytest.raises(ParameterError, match='motor_inertia'):
        PlantConfig().changed({'joint_stiffness': [1e4, 1e4]})
    three = {'joint_names': ['a', 'b', 'c'], 'model': 'module:Class'}
    with pytest.raises(ParameterError, match='n = 3, got 2 values'):
        ControllerConfig().changed(three)
    gains = {name: [1.0] * 3 for name, spec in ControllerConfig.parameters().items()
             if spec.kind == 'float[]'}
    no_rotors = {'rotor_inertia': [0.0] * 3}  # They are those of a description.
    assert ControllerConfig().changed({**gains, **three, **no_rotors}).kp == (1.0, 1.0, 1.0)


NUMBERS = st.one_of(st.integers(), st.floats(), st.just(10 ** 400), st.floats(1e-6, 1e3))
SCALARS = st.one_of(NUMBERS, st.booleans(), st.text(max_size=5), st.binary(max_size=4),
                    st.complex_numbers(), st.sampled_from(['chattering', 'two_link', 'sign']))
VALUES = st.one_of(
    SCALARS, st.lists(NUMBERS, max_size=5), st.lists(SCALARS, max_size=4),
    st.lists(st.floats(1e-6, 1e3), min_size=2, max_size=2), st.dictionaries(SCALARS, SCALARS),
    st.lists(st.lists(NUMBERS, max_size=2), max_size=2), st.lists(st.text(), max_size=3))


#: Of numbers that are not negative, those that are not 0.
POSITIVE = {
    'kp', 'kv', 'lambda', 'b', 'control_period', 'integration_step', 'boundary_layer',
    'stribeck_velocity', 'inertia_scale', 'velocity_cutoff', 'effort_limit', 'effort_rate_limit',
    'error_limit', 'torque_saturation', 'observer_bandwidth', 'torque_rate_limit',
    'joint_stiffness'}
NOT_NEGATIVE = POSITIVE | {
    'ka', 'coulomb_friction', 'gravity', 'duration', 'frequency', 'viscous_friction',
    'stribeck_friction', 'gravity_scale', 'position_noise', 'velocity_noise', 'fault_damping',
    'encoder_resolution', 'torque_resolution', 'motor_inertia', 'joint_damping', 'actuator_lag',
    'load_friction', 'sample_loss', 'late_samples', 'input_delay', 'noise_seed'}
TYPES = {'bool': bool, 'int': int, 'float': float, 'float[]': float, 'str': str, 'str[]': str}


@settings(max_examples=150)
@given(st.sampled_from(CONFIGS), st.data())
def test_any_mapping_is_allowed_or_a_parameter_error(config: type[Config], data: Any) -> None:
    """Check random names and values: within the ranges, or refused on one line."""
    names = st.sampled_from([*config.parameters(), 'nonsense'])
    values = data.draw(st.dictionaries(names, VALUES, max_size=3))
    try:
        made = config.from_mapping(values).as_mapping()
    except ParameterError as error:
        assert '\n' not in str(error)
        return
    assert 'nonsense' not in values
    for name, value in made.items():
        spec, items = config.parameters()[name], value if isinstance(value, tuple) else (value,)
        assert {type(x) for x in items} <= {TYPES[spec.kind]}
        if name in ('kp', 'kv') and len(items) == 4:
            assert np.linalg.eigvalsh(np.array(items).reshape(2, 2))[0] > 0.0
        elif spec.kind in ('int', 'float', 'float[]'):
            assert all(math.isfinite(x) or (x == INF and spec.infinite) for x in items)
            assert name not in NOT_NEGATIVE or min(items) >= 0.0
            assert name not in POSITIVE or min(items) > 0.0
