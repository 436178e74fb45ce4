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

"""What law takes which parameters is declared; the torques agree."""

from __future__ import annotations

from functools import cache
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.control.laws.registry import (
    law_class,
    LAWS,
    switching_class,
    SWITCHINGS,
    switchings_of,
)
from ctc_chattering.parameters import Parameter
from laws import inputs
import numpy as np
from oracles import Array
import pytest

PARAMETERS = ControllerConfig.parameters()
#: Values with which every parameter of the law matters, the limits included.
BASE: dict[str, Any] = {
    'effort_limit': [400.0, 15.0], 'friction_level': [3.0, 2.0], 'boundary_layer': 0.5,
    'actuator_lag': [2e-3, 3e-3], 'torque_rate_limit': [1e6, 4e5]}
#: Of the laws that observe, at states from which others would saturate at every sample.
SLOW: dict[str, Any] = {
    'pid_kalman': {'estimator_bandwidth': 1.0},
    'observer_feedback': {'estimator_bandwidth': 10.0, 'kp': 1.0, 'kv': 1.0, 'ka': 300.0,
                          'torque_rate_limit': [1e4, 4e3], 'friction_learning': 200.0},
    'extended_state_observer': {'estimator_bandwidth': 10.0, 'kp': 1.0, 'kv': 1.0,
                                'torque_rate_limit': [1e4, 4e3], 'friction_velocity': 5.0}}
#: Another value where the default times 1.3 is none, or would not matter.
OTHER: dict[str, Any] = {
    'switching': 'boundary_layer', 'anti_windup': False, 'effort_limit': [300.0, 10.0],
    'effort_rate_limit': [2e3, 2e3], 'input_delay': 1, 'friction_lead': 0.01,
    'estimator_slope': False}
#: The switching that a parameter belongs to.
SWITCHING = {'boundary_layer': 'boundary_layer', 'observer_bandwidth': 'implicit_observer'}
#: Parameters without an effect on single torques: what is not the law's, and the period, which
#: laws without memory do not have. Only a described robot has rotors and a payload; gain rules
#: take `resonance`.
OUTSIDE = ('joint_names', 'model', 'description', 'locked', 'law', 'error_limit',
           'control_period', 'compiled', 'rotor_inertia', 'resonance', 'continuous_joints',
           'payload_mass', 'payload_center', 'state_decimation')


def torques(law: str, values: dict[str, Any]) -> Array:
    """Return the torques at states that are the same for all."""
    rng = np.random.default_rng(3)
    config = ControllerConfig.from_mapping({**BASE, **SLOW.get(law, {}), 'law': law, **values})
    controller = Controller(config)
    rows = [inputs(rng, 0.1 if k % 2 else 1e-3) for k in range(31)]
    return np.array([controller.step(*rows[k], [rows[k + 1][2:]] * config.input_delay).tau
                     for k in range(30)])


@cache
def usual(law: str, switching: str) -> Array:
    return torques(law, {'switching': switching})


def another(spec: Parameter) -> Any:
    """Return another value of a parameter."""
    value = BASE.get(spec.name, spec.default_for(2))
    if spec.name in OTHER:
        return OTHER[spec.name]
    return [1.3 * x for x in value] if isinstance(value, (list, tuple)) else 1.3 * value


@pytest.mark.parametrize('name', [name for name in PARAMETERS if name not in OUTSIDE])
def test_a_parameter_changes_the_torque_of_the_laws_that_take_it(name: str) -> None:
    """And of these only."""
    spec = PARAMETERS[name]
    assert set(spec.laws) <= set(LAWS)
    switching = SWITCHING.get(name, 'sign')
    for law in LAWS:
        before = usual(law, switching)
        after = torques(law, {'switching': switching, name: another(spec)})
        gap = np.abs(before - after).max()
        if not spec.laws or law in spec.laws:
            assert gap > 1e-6, law
        else:
            assert gap == 0.0, law
        assert ControllerConfig(law=law).takes(name) == (not spec.laws or law in spec.laws)


def test_names_lead_to_classes_in_camel_case() -> None:
    names = [law_class(name).__name__ for name in LAWS]
    names += [switching_class(name).__name__ for name in SWITCHINGS]
    assert [name.lower() for name in names] == [
        name.replace('_', '') for name in (*LAWS, *SWITCHINGS)]
    assert all(name[0].isupper() for name in names)


def test_only_law_6_has_switchings() -> None:
    assert [law for law in LAWS if switchings_of(law)] == ['chattering']
    assert switchings_of('chattering') == SWITCHINGS
