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

"""What the public functions and classes do with arguments that are wrong."""

from __future__ import annotations

from collections.abc import Callable
import inspect
from pathlib import Path
import random
from typing import Any
from unittest.mock import Mock

import ctc_chattering
from ctc_chattering import (
    Controller,
    ControllerConfig,
    CtcError,
    Event,
    load_parameters,
    Model,
    Plant,
    PlantConfig,
    RecordedMotion,
    Recording,
    ReferenceConfig,
    Result,
    Run,
    Setup,
    Sinusoid,
    TwoLink,
    UrdfModel,
    Waypoints,
)
from ctc_chattering.arguments import checked
from ctc_chattering.errors import ParameterError
from ctc_chattering.runs import study as cases
from ctc_chattering.runs.score import over_simulation
import numpy as np
import pytest

REST = [0.0, 0.0]
POINT = (REST, REST, REST)
URDF = (Path(ctc_chattering.__file__).parents[1] / 'config' / 'two_link.urdf').read_text('utf-8')
RUN = Run(np.array([0.0, 1.0]), *[np.zeros((2, 2))] * 7)
CONFIG = ControllerConfig()
SETUP = Setup(PlantConfig(duration=0.002), CONFIG, ReferenceConfig())


def no_line(_line: str) -> None:
    """Show nothing."""


RECORDING = Recording('run', ('joint1', 'joint2'), np.arange(3.0), np.zeros((3, 2)),
                      effort=np.zeros((3, 2)))
RESULT = Result('', [(0.0, CONFIG)], RUN)
#: Of every public function and class: arguments that are right.
RIGHT: dict[str, dict[str, Any]] = {
    'Result': {'experiment': '', 'configs': [(0.0, CONFIG)], 'run': RUN, 'computed': None,
               'description': '', 'source': '', 'window': (0.0, 1.0)},
    'read_bag': {'path': 'bag', 'model': '', 'law': '', 'switching': ''},
    'repair': {'bag': 'bag'}, 'laws': {},
    'check_dynamics': {'model': TwoLink(), 'seed': 0, 'samples': 1},
    'export': {'result': RESULT, 'path': 'run.csv'},
    'read_motion': {'path': 'bag', 'joints': (), 'description': '', 'states': 'joint_states',
                    'commands': 'commands', 'model': ''},
    'Recording': dict(vars(RECORDING)),
    'RecordedMotion': {'recording': RECORDING, 'description': '', 'controller': None,
                       'notes': ()},
    'excite': {'setup': SETUP, 'request': {'duration': 0.01}, 'friction': None, 'evaluations': 1,
               'seed': 0, 'srdf': '', 'floor': None, 'joints': ()},
    'identify': {'motions': [RecordedMotion(RECORDING)], 'validation': None, 'model': 'two_link',
                 'urdf': '', 'gravity': None, 'torque': '', 'side': 'current', 'torque_rate': (),
                 'gear_ratio': None, 'torque_constant': [1.0, 2.0], 'payloads': ()},
    'tune': {'spec': 'none.yaml', 'trials': 1, 'percentile': 95.0, 'identified': None, 'jobs': 1,
             'show': no_line, 'progress': None},
    'compute_map': {'spec': 'none.yaml', 'out': 'map', 'jobs': 1, 'scheduler': None,
                    'overwrite': False, 'show': no_line, 'progress': None, 'extra': 'svg',
                    'command': ''},
    'compare': {'files': ['none.yaml'], 'laws': ['chattering'], 'conditions': (),
                'gains': 'file', 'held_out': 0, 'seed': 0, 'jobs': 1,
                'runner': over_simulation, 'show': no_line, 'progress': None},
    'study': {'laws': False, 'groups': (), 'jobs': 1, 'show': no_line, 'progress': None},
    'replay': {'bag': 'bag', 'rate': 1.0, 'delay': 0.0},
    'compile_setup': {'setup': SETUP.changed({'plant': {'compiled': False}, 'controller': {
        'compiled': False}}), 'every': False, 'show': no_line},
    'stability': {'setup': Setup(SETUP.plant, ControllerConfig(law='compensation'),
                                 ReferenceConfig())},
    'save_figures': {'results': [], 'directory': 'figures', 'extra': 'svg'},
    'Controller': {'config': CONFIG, 'model': None},
    'ControllerConfig': dict(vars(CONFIG)),
    'TwoLink': {'gravity': 9.81},
    'UrdfModel': {'urdf': URDF, 'joint_names': ('joint1', 'joint2'), 'gravity': 9.81,
                  'locked': {}},
    'Event': {'time': 0.0, 'node': 'plant', 'values': {}},
    'Run': dict(vars(RUN)),
    'simulate': {'setup': SETUP, 'progress': None, 'truth': False, 'robot': None, 'model': None},
    'Setup': {'plant': SETUP.plant, 'controller': CONFIG, 'reference': ReferenceConfig(),
              'events': (), 'values': {}, 'route': None, 'descriptions': {}},
    'load_parameters': {'path': 'friction', 'overrides': {'plant': {'duration': 1.0}},
                        'gains': 'file'},
    'Plant': {'config': PlantConfig(), 'model': None},
    'PlantConfig': dict(vars(PlantConfig())),
    'ReferenceConfig': dict(vars(ReferenceConfig())),
    'Sinusoid': {'config': ReferenceConfig()},
    'Waypoints': {'times': [0, 1], 'points': [POINT, POINT], 'start': None}}
#: Made by the package, or marks and parts of a user's law.
GIVEN = {'__version__', 'Applied', 'CtcError', 'dot', 'IdentifiedRobot', 'law', 'Model', 'record',
         'Sample', 'State', 'switching', 'Terms'}
#: Write what other functions return; called with that where these are tested.
WRITERS = {'write_comparison', 'write_excitation', 'write_identified', 'write_runs', 'write_study',
           'write_tuning'}
#: Starts nodes for any directory; called where it is tested.
OVER_ROS = {'reproduce'}
#: Raise with arguments that are right, since there is no such file, or too little to be found.
WITHOUT_FILES = {'read_bag', 'repair', 'read_motion', 'excite', 'identify', 'tune', 'compute_map',
                 'compare', 'replay', 'compile_setup'}
#: Arguments that are called.
CALLED = {'show', 'progress', 'runner'}
WRONG: list[Any] = [
    5, -1, 1.5, np.nan, np.inf, 10 ** 400, True, None, 'nonsense', '', b'x', [], [None],
    ['a', 'b', 'c'], [[[]]], {}, {'a': None}, {1: 2}, {'plant': 5}, object(), object, len,
    np.zeros(3), np.array('x'), 1j, range(3), CONFIG, ReferenceConfig(), TwoLink(), RUN, Path()]
#: Methods that take arguments, with objects to call them on.
METHODS: list[tuple[Callable[..., Any], int]] = [
    (Controller(CONFIG).step, 5), (Controller(CONFIG).try_step, 5), (Controller(CONFIG).reset, 2),
    (Controller(CONFIG).configure, 1), (Controller(CONFIG).lyapunov, 2),
    (Plant(PlantConfig()).step, 1), (Plant(PlantConfig()).configure, 1),
    (Sinusoid(ReferenceConfig()).at, 1), (Waypoints([0], [POINT]).at, 1),
    (CONFIG.changed, 1), (ControllerConfig.from_mapping, 1)]


def refused(function: Callable[..., Any], *args: Any, **more: Any) -> CtcError | None:
    """Return the error of a call, which must be one of the package, in one line; or None."""
    try:
        function(*args, **more)
    except CtcError as error:
        assert len(str(error).splitlines()) == 1 and len(str(error)) < 3000
        return error
    return None


def test_every_public_name_is_tested() -> None:
    assert set(RIGHT) | GIVEN | WRITERS | OVER_ROS == set(ctc_chattering.__all__)


@pytest.mark.parametrize('name', RIGHT)
def test_wrong_arguments_are_refused_with_their_name(
        name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Check every argument with every wrong value; some of these are right, but never raise."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cases, 'CASES', ())  # No study takes long.
    function, right = getattr(ctc_chattering, name), RIGHT[name]
    assert set(right) == set(inspect.signature(function).parameters)
    assert name in WITHOUT_FILES or refused(function, **right) is None
    for key in right:
        # What a function that is called now and then raises is its own; an empty spec is right.
        errors = [error for value in WRONG if not (key in CALLED and callable(value))
                  and not (key == 'spec' and isinstance(value, dict) and not value)
                  if (error := refused(function, **right | {key: value})) is not None]
        assert len(errors) > len(WRONG) // 2, key
        assert any(isinstance(x, ParameterError) and key.rstrip('_').partition('_')[0] in x.name
                   for x in errors), key
    assert 'a value of type int' in str(ParameterError('x', 10 ** 5000, ''))
    assert 'nonsense' in str(refused(function, **right, nonsense=1))
    assert refused(function, *[None] * 99) is not None


@pytest.mark.parametrize('method, count', METHODS)
def test_wrong_arguments_of_methods(method: Callable[..., Any], count: int) -> None:
    dice = random.Random(1)
    for value in WRONG:
        refused(method, *[value] * count)
        row = [REST] * count
        row[dice.randrange(count)] = value
        refused(method, *row)


def test_wrong_values_inside() -> None:
    for times, points in (([0, 'a'], [POINT] * 2), ([0, 1.5], [POINT] * 2), ([1, 0], [POINT] * 2),
                          ([0], [5]), ([0], [(REST, REST)]), ([0], [('ab', REST, REST)]),
                          ([0, 1], [POINT, ([0.0],) * 3])):
        with pytest.raises(ParameterError):
            Waypoints(times, points)  # type: ignore[arg-type]
    right = RIGHT['Setup']
    for change in ({'events': [5]}, {'events': [Event(0.0, 'controller', {'law': 5})]},
                   {'events': [Event(0.0, 'plant', {5: 5})]},  # type: ignore[dict-item]
                   {'reference': ReferenceConfig(joint_names=('a', 'b'))},
                   {'controller': ControllerConfig(control_period=2e-3)},
                   {'controller': ControllerConfig(joint_names=('joint2', 'joint1'))}):
        with pytest.raises(ParameterError):
            ctc_chattering.simulate(Setup(**right | change))
    with pytest.raises(ParameterError, match=r'^node: .*plant \| controller'):
        Event(0.0, 'recorder', {})
    with pytest.raises(CtcError, match=r'tau: an array of shape \(3, 2\)'):
        Run(**vars(RUN) | {'tau': np.zeros((3, 2))})
    with pytest.raises(CtcError, match='a model of 1 joints'):
        Controller(CONFIG, One())
    with pytest.raises(ParameterError, match='window'):
        Result('', [(0.0, CONFIG)], RUN, window=(2.0, 1.0)).metrics()
    with pytest.raises(ParameterError, match=r"'plan' .*plant \| "):
        SETUP.changed({'plan': {}})
    with pytest.raises(ParameterError, match=r'controller: kp: \[-1'):
        SETUP.changed({'controller': {'kp': -1}})
    with pytest.raises(ParameterError, match=r'npz or \.csv'):
        ctc_chattering.export(RESULT, 'run.parquet')
    with pytest.raises(ParameterError, match=r'results\[0\]: 5'):
        ctc_chattering.save_figures([5], 'figures')  # type: ignore[list-item]
    with pytest.raises(ParameterError, match='configs'):
        Result('', [], RUN)
    with pytest.raises(ParameterError, match=r'joint_names\[1\]: 5'):
        UrdfModel(URDF, ['joint1', 5])  # type: ignore[list-item]
    with pytest.raises(ParameterError, match=r"overrides: 'plan' .*plant \| "):
        load_parameters('friction', {'plan': {}})


class One(Model):
    """A model of one joint."""

    n = 1
    mass_matrix = coriolis_matrix = gravity_torque = potential_energy = Mock()


@pytest.mark.parametrize('name', sorted(WRITERS))
def test_writers_refuse_what_no_function_has_returned(name: str, tmp_path: Path) -> None:
    write = getattr(ctc_chattering, name)
    for value in WRONG:
        given = (value, SETUP, tmp_path / 'out') if name == 'write_excitation' else (
            value, tmp_path / 'out')
        assert refused(write, *given) is not None
    assert not (tmp_path / 'out').exists()


def test_a_bag_and_a_file_are_named_by_a_string(tmp_path: Path) -> None:
    with pytest.raises(CtcError, match='no such bag'):
        ctc_chattering.read_bag(str(tmp_path / 'bag'))
    file = tmp_path / 'mine.yaml'
    file.write_text('controller:\n  ros__parameters: {law: compensation}\n')
    for path in (file, str(file)):
        assert load_parameters(path).controller.law == 'compensation'
    with pytest.raises(CtcError, match='fricton'):
        load_parameters('fricton')


def test_what_is_checked_stays_the_class_or_function_that_it_was() -> None:
    @checked(x=int)
    def double(x: int) -> int:
        """Return it twice."""
        return 2 * x
    assert (double(2), double.__name__, double.__doc__) == (4, 'double', 'Return it twice.')
    assert list(inspect.signature(double).parameters) == ['x']
    with pytest.raises(CtcError, match='double: missing a required argument'):
        double()  # type: ignore[call-arg]
    assert inspect.isclass(Run) and list(inspect.signature(Run).parameters) == list(vars(RUN))
