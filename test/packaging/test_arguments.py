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
from contextlib import suppress
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import ctc_chattering as ctc
from ctc_chattering.errors import ParameterError
import numpy as np
import pytest

REST = [0.0, 0.0]
POINT = (REST, REST, REST)
URDF = (Path(ctc.__file__).parents[1] / 'config' / 'two_link.urdf').read_text('utf-8')
RUN = ctc.Run(np.array([0.0, 1.0]), *[np.zeros((2, 2))] * 7)
CONFIG = ctc.ControllerConfig()
SETUP = ctc.Setup(ctc.PlantConfig(duration=0.002), CONFIG, ctc.ReferenceConfig())


RESULT = ctc.Result('', [(0.0, CONFIG)], RUN)
LAW = ctc.Controller(CONFIG)
METHODS: list[tuple[Callable[..., Any], int]] = [
    (LAW.step, 5), (LAW.try_step, 5), (LAW.reset, 2), (LAW.lyapunov, 2)]


@pytest.mark.parametrize('method, count', METHODS)
def test_what_is_no_sample_is_refused_in_one_line(method: Callable[..., Any], count: int) -> None:
    for value in (5j, 'nonsense'):
        with pytest.raises(ctc.CtcError, match=r'^[^\n]*$'):
            method(*[value] * count)
    values: list[Any] = [
        np.nan, 10 ** 400, None, [], ['a', 'b', 'c'], {}, np.zeros(3), range(3), Path()]
    for wrong in values:
        with suppress(ctc.CtcError):  # Nothing else is raised; what is not used may be wrong.
            method(*[wrong] + [REST] * (count - 1))


def test_wrong_values_inside() -> None:
    for times, points in (([0, 'a'], [POINT] * 2), ([0, 1.5], [POINT] * 2), ([1, 0], [POINT] * 2),
                          ([0], [('ab', REST, REST)]), ([0, 1], [POINT, ([0.0],) * 3])):
        with pytest.raises(ParameterError):
            ctc.Waypoints(times, points)  # type: ignore[arg-type]
    right = vars(SETUP)
    for change in ({'events': [ctc.Event(0.0, 'controller', {'law': 5})]},
                   {'events': [ctc.Event(0.0, 'plant', {5: 5})]}):  # type: ignore[dict-item]
        with pytest.raises(ParameterError):
            ctc.simulate(ctc.Setup(**right | change))
    for other in ({'reference': ctc.ReferenceConfig(joint_names=('a', 'b'))},
                  {'controller': ctc.ControllerConfig(control_period=2e-3)},
                  {'controller': ctc.ControllerConfig(joint_names=('joint2', 'joint1'))}):
        with pytest.raises(ctc.CtcError, match='contradicts'):
            ctc.simulate(ctc.Setup(**right | other))
    with pytest.raises(ctc.CtcError, match='a model of 1 joints'):
        ctc.Controller(CONFIG, One())
    with pytest.raises(ParameterError, match=r'controller: kp: \[-1'):
        SETUP.changed({'controller': {'kp': -1}})
    with pytest.raises(ParameterError, match=r'npz or \.csv'):
        ctc.export(RESULT, 'run.parquet')
    with pytest.raises(ParameterError, match="locked: 'joint2: nan'"):
        ctc.UrdfModel(URDF, ['joint1'], locked={'joint2': np.nan})
    with pytest.raises(ctc.CtcError, match='no node is called plan; allowed: plant, '):
        ctc.load_parameters('friction', {'plan': {}})


class One(ctc.Model):
    """A model of one joint."""

    n = 1
    mass_matrix = coriolis_matrix = gravity_torque = potential_energy = Mock()


def test_a_bag_and_a_file_are_named_by_a_string(tmp_path: Path) -> None:
    with pytest.raises(ctc.CtcError, match='no such bag'):
        ctc.read_bag(str(tmp_path / 'bag'))
    file = tmp_path / 'mine.yaml'
    file.write_text('controller:\n  ros__parameters: {law: compensation}\n')
    for path in (file, str(file)):
        assert ctc.load_parameters(path).controller.law == 'compensation'
