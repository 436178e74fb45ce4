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

"""Parameter files: what they say, and one line for everything that is wrong with them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.node_parameters import NODES
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.configuration.parameter_file import load_parameters, with_gains
from ctc_chattering.control.recommended_gains import GAINS
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.parameters import LARGEST, LEAST
from hypothesis import given, settings
from hypothesis import strategies as st
from parameter_files import loaded, refused
import pytest
from urdfs import two_links

CONFIG = Path(__file__).parents[2] / 'config'


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / 'a file.yaml'


@pytest.mark.parametrize('path', sorted(CONFIG.glob('*.yaml')), ids=lambda path: path.stem)
def test_every_file_has_limits_of_the_torque_that_is_sent(path: Path) -> None:
    """Its own, or those of its URDF; not above what the simulated drives give."""
    setup = parameter_file.load(path)
    model = model_of(setup.controller, setup.descriptions.get('controller', ''))
    largest = setup.controller.largest_torque(model.effort_limits)
    assert all(0.0 < x <= most for x, most in zip(largest, setup.plant.torque_saturation))
    assert max(largest) < math.inf


@pytest.mark.parametrize(('content', 'word'), [
    (None, 'No such file'), (b'', 'node names'), (b'- a\n- b\n', 'node names'),
    (b'5', 'node names'), (b'a: [1, 2', 'not a YAML file'), (b'\xff\xfe\x00x', 'not a YAML file'),
    (b'a: !what 1', ''), (b'{[a]: 1}', ''), (b'a: *nowhere', ''), (b'a: &a {b: *a}', ''),
    (b'plant:', 'ros__parameters'), (b'plant: {duration: 1.0}', 'ros__parameters'),
    (b'plant: {ros__parameters: [1]}', ''), (b'robot: {ros__parameters: {a: 1}}', 'robot'),
    (b'plant: {ros__parameters: {kp: [1, 1]}}', 'kp'),
    (b'plant: {ros__parameters: {duration: {a: 1}}}', 'duration.a'),
    (b'/**: {ros__parameters: {mass: 1}}', 'mass')])
def test_what_is_no_parameter_file(file: Path, content: bytes | None, word: str) -> None:
    """Check that the line names the file and what is wrong."""
    if content is not None:
        file.write_bytes(content)
    refused(lambda: parameter_file.load(file), str(file), word)


# Of what is allowed: test_parameters.py; here each kind once, as YAML has it.
@pytest.mark.parametrize(('node', 'line', 'value', 'allowed'), [
    ('controller', 'lambda: .nan', 'nan', 'finite'), ('controller', 'lambda: "x"', "'x'", 'numb'),
    ('controller', 'lambda: true', 'True', 'numb'), ('controller', 'lambda:', 'None', 'numb'),
    ('controller', f'lambda: 1{"0" * 400}', '1000', 'number'),
    ('controller', 'kp: [1, null]', 'None', 'list'),
    ('controller', 'kv: [1, 0.5, 0.4, 1]', '0.4', 'symmetric'),
    *((node, f'{name}: [1.0, {value}]', str(float(value.replace('.', ''))), '>= 1e-09')
      for node, name in (('controller', 'effort_limit'), ('controller', 'effort_rate_limit'),
                         ('controller', 'torque_rate_limit'), ('plant', 'torque_saturation'),
                         ('plant', 'torque_rate_limit'), ('controller', 'error_limit'))
      for value in ('-1', '0', '.nan', '-.inf')),
    ('controller', 'law: 5', '5', 'compensation'), ('controller', 'state_decimation: 0', '0', '1'),
    ('plant', 'duration: 2024-01-01', '2024', 'number'),
    ('plant', 'disturbance: {amplitude: [1, 2, 3]}', '1.0', 'n = 2'),
    ('/**', 'control_period: 0.0', '0.0', '>= 1e-09'), ('/**', 'joint_names: [a]', "['a']", '2'),
    ('reference', 'horizon: 0', '0', '0.01'), ('recorder', 'bag: 5', '5', 'string'),
    ('bringup', 'events: [5]', '5', 'list')])
def test_what_is_no_value(file: Path, node: str, line: str, value: str, allowed: str) -> None:
    """Check that the line names parameter, value and what is allowed."""
    name = line.split(':')[0].split('{')[0]
    refused(lambda: loaded(file, (node, line)), name, value, allowed, 'allowed')


def test_simulated_time_contradicts_real_time(file: Path) -> None:
    for node in ('/**', 'plant'):
        refused(lambda: loaded(file, (node, 'use_sim_time: true\npacing: real_time')),
                'use_sim_time', 'real_time')
        assert loaded(file, (node, 'use_sim_time: true\npacing: lockstep'))
    assert loaded(file, ('controller', 'use_sim_time: true'))


def test_values(file: Path) -> None:
    """Check dotted and nested names, integers, 1e-3, and a node's own over /**."""
    setup = loaded(
        file,
        ('controller', 'kp: [1, 2e1]\nlambda: 5\nstate_decimation: 7'),
        ('/**', 'kp: [7, 7]\nkv: [8, 8]\ncontrol_period: 1e-3\nuse_sim_time: true\ngravity: 1E1'),
        ('plant', 'pacing: lockstep\ndisturbance.amplitude: [1, 2]\n'
                  'disturbance: {frequency: [3.0, 4]}'))
    assert setup.controller.kp == (1.0, 20.0)
    assert setup.controller.kv == (8.0, 8.0)
    assert setup.plant.control_period == setup.reference.control_period == 0.001
    assert setup.plant.gravity == 10.0
    assert isinstance(setup.controller.lambda_, float)
    assert setup.plant.disturbance_amplitude == (1.0, 2.0)
    assert setup.plant.disturbance_frequency == (3.0, 4.0)
    assert setup.values['controller']['state_decimation'] == 7
    assert list(setup.values) == list(NODES)


@pytest.mark.parametrize('text', ['1e-3', '1.e-3', '.001', '+1E-3'])
def test_numbers_as_ros_reads_them(file: Path, text: str) -> None:
    assert loaded(file, ('/**', f'control_period: {text}')).plant.control_period == 0.001


@pytest.mark.parametrize('key', [
    'controller', '/controller', '/robot1/controller', '/a/b/controller', '/**/controller'])
def test_namespaces(file: Path, key: str) -> None:
    """Check that a namespace in front of a node's name does not matter."""
    assert loaded(file, (key, 'lambda: 3.5')).controller.lambda_ == 3.5
    file.write_text('/robot1/controller:\n  ros__parameters: {lambda: 4.5}\n'
                    '/robot1/plant: {ros__parameters: {}}\n/ns/**: {ros__parameters: {b: 2.0}}\n')
    setup = parameter_file.load(file)
    assert (setup.controller.lambda_, setup.controller.b) == (4.5, 2.0)


def test_overrides(file: Path) -> None:
    """Check that they stand above the file, /** for whom it concerns, a node's above that."""
    loaded(file, ('controller', 'lambda: 3.0\nlaw: compensation\nb: 4'))
    setup = parameter_file.load(file, {
        'controller': {'lambda': 2, 'law': 'chattering'},
        '/**': {'control_period': 0.004, 'lambda': 9.0, 'gravity': 1.0}})
    assert (setup.controller.lambda_, setup.controller.law) == (2.0, 'chattering')
    assert setup.controller.b == 4.0
    assert {x.control_period for x in (setup.plant, setup.controller, setup.reference)} == {0.004}
    assert setup.plant.gravity == setup.controller.gravity == 1.0
    refused(lambda: parameter_file.load(file, {'controller': {'law': 'pid'}}),
            'law', 'pid', 'chattering')


def test_a_law_without_gains_takes_those_that_suit_it_and_starts_smoothly() -> None:
    """With gains, or where the file is asked for, it takes what is there; the user is told."""
    law: dict[str, Any] = {'law': 'observer_feedback'}
    friction = find_config('friction')
    over, line = with_gains(friction, {'controller': law})
    assert over['controller'] == {
        **law, 'kp': (1e4, 1e4), 'kv': (200.0, 200.0), 'ka': (65.3, 13.7),
        'estimator_bandwidth': 100.0}
    assert over['reference'] == {'start_duration': 2.0}
    assert line == (
        'law observer_feedback takes recommended gains and a smooth start: kp (10000.0, 10000.0), '
        'kv (200.0, 200.0), ka (65.3, 13.7), estimator_bandwidth 100.0; --gains file keeps the '
        'gains of the file')
    cases: list[tuple[dict[str, Any], str | None]] = [
        (law, 'file'), ({**law, 'ka': 60.0}, None), ({}, None), ({'law': 'compensation'}, None)]
    for values, gains in cases:
        assert with_gains(friction, {'controller': values}, gains) == ({'controller': values}, '')
    mine = {'controller': {**law, 'ka': 60.0}, 'reference': {'start_duration': 0.5}}
    over, _ = with_gains(friction, mine, 'recommended')
    assert (over['controller']['ka'], over['controller']['kp']) == (60.0, (1e4, 1e4))
    assert over['reference'] == {'start_duration': 0.5}
    with pytest.raises(UsageError, match=r'only --law observer_feedback has .* not chattering'):
        with_gains(friction, {}, 'recommended')
    assert load_parameters('friction', {'controller': law}).controller.kv == (200.0, 200.0)
    refused(lambda: load_parameters('friction', gains='mine'), 'gains', 'mine', 'recommended')


def test_events_take_gains_as_a_running_node_does() -> None:
    """What a node adds to the law, the simulation must have; gains that events have stay."""
    (_, _, there), (_, _, back) = events(
        '1 controller law observer_feedback', '2 controller law chattering')
    assert there.keys() - {'law'} == set(GAINS)
    assert (there['kp'], there['ka']) == ((1e4, 1e4), (65.3, 13.7))
    assert (back['kp'], back['ka']) == ((100.0, 100.0), (10.0, 10.0))
    *_, (_, _, given) = events('1 controller kp 400', '1 controller law observer_feedback')
    assert (given['kp'], given['kv'], given['ka']) == ((400.0, 400.0), (50.0, 50.0), (10.0, 10.0))


def events(*lines: str) -> list[tuple[float, str, dict[str, Any]]]:
    setup = parameter_file.load(None, {'bringup': {'events': list(lines)}})
    return [(e.time, e.node, dict(e.values)) for e in setup.events]


def test_events() -> None:
    """Check order, types, matrices and empty lines."""
    assert events('', '5 controller law compensation', '1.5 plant disturbance.amplitude [1, 2]',
                  '1e-1 controller kp [4, 1, 1, 4]', ' 5.0  controller   lambda  1e1 ') == [
        (0.1, 'controller', {'kp': (4.0, 1.0, 1.0, 4.0)}),
        (1.5, 'plant', {'disturbance.amplitude': (1.0, 2.0)}),
        (5.0, 'controller', {'law': 'compensation'}), (5.0, 'controller', {'lambda': 10.0})]
    assert events() == []
    assert len(events('1 controller lambda 1e3', '1 controller lambda 1e5')) == 2


@pytest.mark.parametrize(('line', 'word'), [
    ('5 controller law', 'time node parameter value'), ('x controller law pid', 'time node'),
    ('5 robot law chattering', 'plant | controller'), ('-1 controller b 2', '>= 0'),
    ('nan controller b 2', '>= 0'), ('5 controller law pid', 'compensation'),
    ('5 controller mass 1', 'mass'), ('5 controller lambda 1e6', 'factor of at most 100'),
    ('5 plant gravity 1', 'change'), ('5 controller kp [1, 2', 'kp'), ('5 controller b # 2', 'b'),
    ('5 controller b {a: 1}', 'b')])
def test_bad_events(line: str, word: str) -> None:
    """Check that each kind of mistake is named."""
    refused(lambda: events(line), word, 'allowed')


def test_events_are_checked_in_their_order() -> None:
    """Check a value that a later event makes right again, and one that an earlier one does."""
    assert len(events('2 controller ka [0, 0]', '1 controller ka [5, 5]')) == 2
    refused(lambda: events('3 controller b 1', '2 controller b -1'), '-1')


gains = st.floats(LEAST, LARGEST)
rows = st.lists(gains, min_size=2, max_size=2)
#: Strings that YAML could take for something else.
WORDS = ['yes', 'null', '1e3', '1.5', '~', '5', 'a: b', '#', 'é', '', ' x ', '.inf', '2024-01-01',
         '0x1F', '1_000', "it's", '"', 'a\nb', '=', '<<', '%', '-']


@settings(max_examples=25)
@given(kp=rows, ka=rows, b=st.floats(1e-3, 1e3), position=st.lists(
    st.floats(-LARGEST, LARGEST), min_size=2, max_size=2))
def test_dump_and_load(tmp_path_factory: pytest.TempPathFactory, kp: list[float], ka: list[float],
                       b: float, position: list[float]) -> None:
    """Check that every number comes back, to the last bit."""
    setup = parameter_file.load(CONFIG / 'switch.yaml', {
        'controller': {'kp': kp, 'ka': ka, 'b': b}, 'plant': {'initial_position': position}})
    file = tmp_path_factory.getbasetemp() / 'dumped.yaml'
    parameter_file.dump(setup.values, file)
    again = parameter_file.load(file)
    assert again == setup
    assert str(again.plant.initial_position) == str(tuple(position))


@pytest.mark.parametrize('word', WORDS)
def test_dump_and_load_of_words(file: Path, word: str) -> None:
    """Check that a string stays one."""
    setup = parameter_file.load(None, {'recorder': {'bag': word}, 'plant': {'experiment': word}})
    parameter_file.dump(setup.values, file)
    assert parameter_file.load(file).values == setup.values


def test_what_is_beyond_the_limits_of_the_urdf_is_refused_at_load(tmp_path: Path) -> None:
    """The motion, its start, and that of the builtin plant, by name and amount."""
    robot, file = tmp_path / 'arm.urdf', tmp_path / 'params.yaml'
    robot.write_text(two_links())
    file.write_text(f"""
/**:
  ros__parameters: {{joint_names: [a, b], model: urdf, description: {robot}}}
reference:
  ros__parameters: {{center: [1.0, 0.0], amplitude: [0.5, 0.5], frequency: [0.4, 0.4],
                    start_duration: 2.0}}
""")
    assert parameter_file.load(file).reference.model == 'urdf'
    for node, values, message in (
            ('reference', {'center': [2.7, 0.0]}, 'the motion is beyond the limits of '
             'the description: a: position 3.2 rad, 0.2 above its upper limit of 3'),
            ('plant', {'initial_position': [-2.1, 0.0]},
             'the start of the plant .* a: position -2.1 rad, 0.1 below'),
            ('plant', {'initial_velocity': [0.0, 2.0]}, 'b: velocity 2 rad/s, 0.5 above')):
        with pytest.raises(CtcError, match=message):
            parameter_file.load(file, {node: values})
