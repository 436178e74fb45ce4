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

"""
The control step against torques that were computed apart from the package.

`data/control_steps.npz` has the torques of `validation/control_steps.py`, an implementation of the
same equations that imports nothing of the package. Its cases have random models, gains with and
without coupling, the laws of the paper, switchings, limits, delays and model errors, with resets
and changes of parameters in between. Half a dozen values of a sequence would not tell a wrong
filter state from a right one; 30 samples do. ``make validate STUDY=control_steps`` makes the
torques again.
"""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import control_steps
from control_steps import Case, JOINTS
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
import independent_laws
from machine_code import compile_step
import numpy as np
from oracles import Array
import pytest
import urdfs


def model(name: str, gravity: float) -> Model:
    if name == 'two_link':
        return TwoLink(gravity)
    return UrdfModel(control_steps.URDFS[name](), JOINTS[name], gravity)


def play(case: Case, compiled: bool) -> Array:
    """Return the torques of the package, shape (STEPS, n)."""
    name, changes = case.values['model'], case.values['actions']
    config = ControllerConfig.from_mapping({
        **case.values['config'], 'model': 'two_link' if name == 'two_link' else 'urdf',
        'joint_names': list(JOINTS[name]), 'compiled': compiled})
    law, torques = Controller(config, model(name, config.gravity)), []
    states, points = case.motion
    for k, (q, dq) in enumerate(states):
        action = changes.get(str(k), {})
        if 'configure' in action:
            law.configure(law.config.changed(action['configure']))
        if 'reset' in action:
            law.reset(action['reset'], action.get('held'))
        if compiled and (k == 0 or action):
            compile_step(law)
        sample = law.step(q, dq, *points[k], points[k + 1:k + 1 + config.input_delay])
        assert law.compiled == compiled
        torques.append(list(sample.tau))
    return np.array(torques)


def is_rare(case: dict[str, Any]) -> bool:
    """Return whether it has a switching that no other test compiles; `.ci/run` does."""
    text = json.dumps(case)
    return any(f'"switching": "{x}"' in text for x in ('boundary_layer', 'implicit'))


@pytest.mark.parametrize(('name', 'compiled', 'rare'), [
    *((name, False, (False, True)) for name in JOINTS), ('two_link', True, (False,)),
    pytest.param('two_link', True, (True,), marks=pytest.mark.slow)])
@pytest.mark.parametrize('closed', [False, True])
def test_torques_are_those_recorded(name: str, compiled: bool, rare: tuple[bool, ...],
                                    closed: bool) -> None:
    """Check every torque to 1e-9 of the largest term of the law in its sequence."""
    compared = 0
    for case, recorded in control_steps.cases():
        values = case.values
        if (values['model'], values['closed']) != (name, closed) or is_rare(values) not in rare:
            continue
        np.testing.assert_allclose(play(case, compiled), recorded, rtol=0.0,
                                   atol=1e-9 * values['scale'], err_msg=str(values))
        compared += 1
    assert compared >= 5 or (name, closed) == ('swapped', True)


@pytest.mark.parametrize('name', JOINTS)
def test_the_file_has_the_torques_of_the_implementation_beside_it(name: str) -> None:
    """Check a case of every ten; all that the file has was computed by it."""
    cases = [x for x in control_steps.cases() if x[0].values['model'] == name]
    for case, recorded in cases[::10]:
        np.testing.assert_allclose(case.torques(), recorded, rtol=0.0,
                                   atol=1e-11 * case.values['scale'])


@pytest.mark.parametrize('module', [control_steps, independent_laws, urdfs])
def test_the_implementation_imports_nothing_of_the_package(module: Any) -> None:
    tree = ast.parse(Path(module.__file__).read_text(encoding='utf-8'))
    names = [name.name for x in ast.walk(tree) if isinstance(x, ast.Import) for name in x.names]
    names += [x.module or '' for x in ast.walk(tree) if isinstance(x, ast.ImportFrom)]
    assert 'numpy' in names or module is urdfs
    assert not [name for name in names if name.startswith('ctc_chattering')]
