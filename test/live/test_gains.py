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

"""A slider says one joint's value, or that of all with their ratios; nothing beyond its limits."""

from __future__ import annotations

import json
from math import inf, nan
from typing import Any

from ctc_chattering.live.gains import ALL, GAINS, gains_of
from ctc_chattering.live.law_panel import LawPanel
import pytest

NAMES = ('a', 'b', 'c')
PARAMETERS: dict[str, Any] = {'law': 'chattering', 'switching': 'sign', 'kp': [100.0, 50.0, 20.0],
                              'kv': 50.0, 'lambda': 10, 'ka': [8.0, 4.0, 0.0]}
#: Of a kind that no gain and no name is.
WRONG: tuple[Any, ...] = (True, '5', None, [5.0], {})
OFF = {'state': 'off', 'path': '/bags', 'lasts': 0}


def asked(*messages: Any, **parameters: Any) -> list[tuple[Any, ...]]:
    """Return what the panel asks for after messages of a page."""
    found: list[tuple[Any, ...]] = []
    panel = LawPanel(lambda *words: found.append(words))
    panel.state(NAMES, {**PARAMETERS, **parameters}, OFF)
    for message in messages:
        panel.receive(message)
    return found


def gain(name: Any, joint: Any, value: Any) -> dict[str, Any]:
    return {'gain': {'name': name, 'joint': joint, 'value': value}}


def test_one_release_is_one_request_with_the_values_of_all_joints() -> None:
    assert asked(gain('kp', 1, 60)) == [('gain', 'kp', [100.0, 60.0, 20.0])]
    assert asked(gain('ka', ALL, 16.0)) == [('gain', 'ka', [16.0, 8.0, 0.0])]
    assert asked(gain('ka', ALL, 3.0), ka=[0.0] * 3) == [('gain', 'ka', [3.0] * 3)]
    assert asked(gain('kv', 2, 7.0)) == [('gain', 'kv', [50.0, 50.0, 7.0])]
    assert asked(gain('lambda', ALL, 20)) == [('gain', 'lambda', 20.0)]
    full = [4.0, 1.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0, 1.0]
    assert asked(gain('kp', ALL, 8.0), kp=full) == [('gain', 'kp', [2.0 * x for x in full])]
    assert asked(gain('kp', 0, 8.0), kp=full) == []


def test_limits_are_the_declared_ones_and_hold_the_values_in_force() -> None:
    kp, kv, pole, ka = gains_of({**PARAMETERS, 'kp': [3e4, 0.5, 1.0]}, NAMES)
    assert kp.limits == (0.5, 3e4)
    assert kv.limits == (1.0, 1e3)
    assert pole.limits == ka.limits == (0.1, 1e3)
    assert [x.shown()['name'] for x in (kp, kv, pole, ka)] == list(GAINS)
    assert ka.shown()['values'] == (8.0, 4.0, 0.0)


@pytest.mark.parametrize('message', [
    *[gain('kp', 0, value) for value in WRONG],
    *[gain('kp', joint, 5.0) for joint in (-2, 3, 0.0, True, None, '0')],
    *[gain(name, 0, 5.0) for name in ('ki', 'error_limit', '', None, *WRONG)],
    {'gain': {'name': 'kp', 'value': 5.0}}, {'gain': {**gain('kp', 0, 5.0)['gain'], 'node': 'x'}},
    {'gain': None}, {'law': 'none'}, {'law': ['chattering']}, {'law': {}}, {'switching': None},
    {'record': 5}, {'record': ['x']}, {'record': True}, {'set': 'x'}, {}, [], None, 'law',
    {'law': 'chattering', 'switching': 'sign'}])
def test_what_no_page_of_ours_sends_is_passed_over(message: Any) -> None:
    assert asked(message) == []


@pytest.mark.parametrize('value', [-1, 0, 1e10, nan, inf, -inf, 10**400])
def test_a_value_that_is_not_allowed_is_refused_with_the_reason(value: Any) -> None:
    panel = LawPanel(lambda *words: pytest.fail(str(words)))
    panel.state(NAMES, PARAMETERS, OFF)
    panel.receive(gain('kp', 1, value))
    state = panel.state(NAMES, PARAMETERS, OFF)
    assert state['answered'] == 1
    assert not state['answers'][0]['done']
    assert 'kp: [' in state['answers'][0]['text']
    assert 'a list of finite numbers >= 1e-09 and <= 1e+09' in state['answers'][0]['text']
    json.dumps(state, allow_nan=False)


def test_choices_and_recording_are_asked_for() -> None:
    assert asked({'law': 'compensation'}, {'switching': 'implicit'}, {'record': ''},
                 {'record': None}) == [
        ('set', 'controller', 'law', 'compensation'),
        ('set', 'controller', 'switching', 'implicit'), ('record', ''), ('record', None)]


def test_a_gain_without_effect_has_no_slider_to_move() -> None:
    assert asked(gain('ka', 0, 5.0), law='compensation') == []
    (ka,) = (x for x in gains_of({**PARAMETERS, 'law': 'compensation'}, NAMES)
             if x.spec.name == 'ka')
    assert ka.shown()['off'] == 'the law compensation does not take it'
    hostile = {'law': {}, 'kp': ['x'], 'kv': [nan] * 3, 'lambda': 'x', 'ka': [1.0] * 9}
    assert gains_of(hostile, NAMES) == gains_of({}, NAMES) == []
