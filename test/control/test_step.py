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
The control step against recorded torques.

`data/control_steps.npz` has what an independent implementation of the same equations, in scalar
products, sent: random models, gains with and without coupling, laws, switchings, limits, delays
and model errors, with resets and changes of parameters in between. Half a dozen values of each
sequence would not tell a wrong filter state from a right one; 30 samples do.
"""

from __future__ import annotations

from functools import cache
import json
import math
from pathlib import Path
import random
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from machine_code import compile_step
import numpy as np
from oracles import Array
import pytest
from urdfs import PANDA, panda, two_links, UR5, ur5

STEPS = 30
JOINTS = {'two_link': ('joint1', 'joint2'), 'swapped': ('b', 'a'), 'panda': PANDA, 'ur5': UR5}
Point = tuple[list[float], list[float], list[float]]
State = tuple[list[float], list[float]]


@cache
def recorded() -> tuple[list[dict[str, Any]], Array, Array]:
    """Return cases, torques and states, the latter one after the other."""
    data = np.load(Path(__file__).parents[1] / 'data' / 'control_steps.npz')
    return json.loads(data['cases'].tobytes()), data['torques'], data['states'].astype(float)


def model(name: str, gravity: float) -> Model:
    if name == 'two_link':
        return TwoLink(gravity)
    text = {'swapped': two_links, 'panda': panda, 'ur5': ur5}[name]()
    return UrdfModel(text, JOINTS[name], gravity)


def random_motion(case: dict[str, Any], n: int) -> tuple[list[State], list[Point]]:
    """Return states around a reference that is different at every sample."""
    dice = random.Random(case['seed'])

    def near(row: list[float], span: float) -> list[float]:
        return [x + span * dice.uniform(-1.0, 1.0) for x in row]

    points: list[Point] = [
        (near([0.0] * n, 3.0), near([0.0] * n, 3.0), near([0.0] * n, 20.0))
        for _ in range(STEPS + 5)]
    size = case['size']
    return [(near(q, size), near(dq, size)) for q, dq, _ in points[:STEPS]], points


def smooth_motion(case: dict[str, Any], n: int) -> list[Point]:
    """Return the reference of a recorded closed loop."""
    h, w, center = case['config']['control_period'], [3.0 + i for i in range(n)], case['center']
    return [([c + 0.2 * (1.0 - math.cos(x * k * h)) for c, x in zip(center, w)],
             [0.2 * x * math.sin(x * k * h) for x in w],
             [0.2 * x ** 2 * math.cos(x * k * h) for x in w]) for k in range(STEPS + 5)]


def play(case: dict[str, Any], states: list[State], points: list[Point], compiled: bool) -> Array:
    """Return the torques, shape (STEPS, n)."""
    name, changes = case['model'], case['actions']
    config = ControllerConfig.from_mapping({
        **case['config'], 'model': 'two_link' if name == 'two_link' else 'urdf',
        'joint_names': list(JOINTS[name]), 'compiled': compiled})
    law, torques = Controller(config, model(name, config.gravity)), []
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
    cases, torques, measured = recorded()
    at = since = compared = 0
    for case in cases:
        n = len(JOINTS[case['model']])
        wanted, at = torques[at:at + STEPS * n].reshape(STEPS, n), at + STEPS * n
        states = None
        if case['closed']:
            rows, since = measured[since:since + STEPS * 2 * n], since + STEPS * 2 * n
            states = [(q, dq) for q, dq in rows.reshape(STEPS, 2, n).tolist()]
        if (case['model'], case['closed']) != (name, closed) or is_rare(case) not in rare:
            continue
        if states is None:
            made = play(case, *random_motion(case, n), compiled)
        else:
            made = play(case, states, smooth_motion(case, n), compiled)
        np.testing.assert_allclose(made, wanted, rtol=0.0, atol=1e-9 * case['scale'],
                                   err_msg=str(case))
        compared += 1
    assert compared >= 5 or (name, closed) == ('swapped', True)
