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

"""Controls of a graph: their requests and their state, here and in a browser."""

from __future__ import annotations

from collections.abc import Sequence
import json
from math import inf, nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import call, Mock

from browser import browser_page, press, unfold
from ctc_chattering.control.controller import ControllerConfig
import ctc_chattering.live
from ctc_chattering.live.controls import Controls, gain_sliders, GAINS, PLANT_FIELDS
from ctc_chattering.live.page_socket import PageSocket
import pytest

WEB = Path(ctc_chattering.live.__file__).parent / 'web'
CONTROLS = (WEB.parent / 'controls.html').read_text()
STYLE = WEB.parents[1] / 'analysis/web/plots.css'
EVIL = '<img src=x onerror=hacked=1>'
NAMES = ('a', 'b', 'c')
PARAMETERS: dict[str, Any] = {'law': 'chattering', 'switching': 'sign', 'kp': [100.0, 50.0, 20.0],
                              'kv': 50.0, 'lambda': 10, 'ka': [8.0, 4.0, 0.0],
                              'observer_bandwidth': inf}
PLANT: dict[str, Any] = {'pacing': 'lockstep', 'coulomb_friction': [9.9, 9.9, 9.9]}
#: Of a kind that no gain and no name is.
WRONG: tuple[Any, ...] = (True, '5', None, [5.0], {})


def controls(names: Sequence[str] = NAMES, plant: Any = None, reference: Any = None,
             **parameters: Any
             ) -> tuple[Controls, PageSocket, Mock]:
    """Return controls, the socket of a page, and what is asked of a graph and a recorder."""
    asked = Mock()
    asked.shown.return_value = {'state': 'off', 'path': '/home/lab', 'duration': 0}
    reader: Any = SimpleNamespace(
        names=tuple(names), parameters={'controller': {**PARAMETERS, **parameters},
                                        'plant': PLANT if plant is None else plant,
                                        'reference': reference or {'speed_scaling': 1.0}},
        config=ControllerConfig(), latest=1.0)
    socket = PageSocket()
    return Controls(socket, reader, asked, asked), socket, asked


def asked(*messages: Any, **parameters: Any) -> list[Any]:
    """Return the calls after messages of a page."""
    _, socket, calls = controls(**parameters)
    send(socket, *messages)
    return list(calls.mock_calls)


def send(socket: PageSocket, *messages: Any) -> None:
    """Have a page send messages."""
    for message in messages:
        socket.on_message(json.dumps(message))
    socket.poll(tuple)


def gain(name: Any, *values: Any) -> dict[str, Any]:
    return {'gain': {'name': name, 'values': list(values)}}


def is_set(name: str, value: Any) -> list[Any]:
    return [call.set('controller', {name: value})]


def test_a_gain_is_set_for_all_joints_or_for_each() -> None:
    assert asked(gain('ka', 1, 2, 3)) == is_set('ka', [1.0, 2.0, 3.0])
    assert asked(gain('ka', 4.5)) == is_set('ka', [4.5] * 3)
    assert asked(gain('kv', 50, 50, 7)) == is_set('kv', [50.0, 50.0, 7.0])
    assert asked(gain('lambda', 20)) == is_set('lambda', 20.0)
    full = [4.0, 1.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0, 1.0]
    assert asked(gain('kp', 8.0), kp=full) == []


def test_wrong_values_of_a_gain_are_answered_with_the_reason() -> None:
    made, socket, calls = controls()
    send(socket, gain('ka', 1, 2), gain('kp', 0))
    assert not calls.set.called
    assert [x['done'] for x in made.answers] == [False, False]
    of_kp, of_ka = (x['text'] for x in made.answers)
    assert 'got 2 values' in of_ka
    assert 'a list of finite numbers >= 1e-09 and <= 1e+09' in of_kp
    json.dumps([made.state(), *made.answers], allow_nan=False)


def test_limits_are_the_declared_ones_and_hold_the_values_in_force() -> None:
    kp, kv, pole, ka = gain_sliders({**PARAMETERS, 'kp': [3e4, 0.5, 1.0]}, 3).values()
    assert kp.limits == (0.05, 3e5)  # A factor of ten on both sides.
    assert kv.limits == (1.0, 1e3)
    assert pole.limits == ka.limits == (0.1, 1e3)
    assert [x.shown()['name'] for x in (kp, kv, pole, ka)] == list(GAINS[:4])
    assert ka.shown()['values'] == (8.0, 4.0, 0.0)


@pytest.mark.parametrize('kp', [1e-9, 1e-3, 1.0, 100.0, 1e4, 1e5, 1e9])
def test_a_gain_is_at_no_end_of_its_slider_except_those_of_its_range(kp: float) -> None:
    """Check also the recommended gains, which are large."""
    slider = gain_sliders({**PARAMETERS, 'kp': [kp] * 3}, 3)['kp']
    low, high = slider.limits
    lowest, highest = slider.parameter.bounds
    assert lowest <= low <= kp <= high <= highest
    assert kp >= 10.0 * low or low == lowest or kp == slider.parameter.usual[0]
    assert kp <= 0.101 * high or high == highest


def test_fields_of_the_plant_have_the_units_of_their_parameters() -> None:
    plant = {name: [0.0] * 3 for name in PLANT_FIELDS}
    made, *_ = controls(plant=plant)
    assert [x['title'] for x in made.state()['plant']] == [
        'Coulomb friction [N·m]', 'viscous friction [N·m·s/rad]', 'disturbance [N·m]',
        'disturbance frequency [rad/s]']


PUSH: dict[str, Any] = {'joint': 1, 'torque': 5, 'duration': 0.5}
TIME: dict[str, Any] = {'action': 'step', 'samples': 7}
#: Requests with a value that no page of ours sends.
ODD: dict[str, tuple[Any, ...]] = {
    'push': ({**PUSH, 'joint': -1}, {**PUSH, 'joint': True}, {**PUSH, 'torque': nan},
             {**PUSH, 'torque': 10 ** 400}, {**PUSH, 'duration': '1'}, {}, None),
    'time': ({**TIME, 'action': 'x'}, {**TIME, 'action': []}, {**TIME, 'samples': 0},
             {**TIME, 'samples': 1.5}, {**TIME, 'samples': True}, {}, []),
    'plant': ({'name': 'hold_at', 'values': [1]}, {'name': [], 'values': [1]}, None,
              *({'name': 'coulomb_friction', 'values': x} for x in (1, '1', [], ['1'], [nan])))}


@pytest.mark.parametrize('message', [
    *[gain('kp', value) for value in (*WRONG, nan, inf, -inf, 10 ** 400)],
    *[gain(name, 5.0) for name in ('ki', 'error_limit', '', None, *WRONG)],
    *[{'gain': {'name': 'kp', 'values': values}} for values in ([], 5.0, ['5'], [nan], None)],
    {'gain': {'name': 'kp'}}, {'gain': None}, {'gain': {**gain('kp', 5.0)['gain'], 'node': 'x'}},
    {'law': 'none'}, {'law': ['chattering']}, {'law': {}}, {'switching': None},
    {'record': 5}, {'record': ['x']}, {'record': None}, {'record': 'x'}, {'set': 'x'}, {}, [],
    None, 'law', {'torques': 1}, {'torques': 'on'},
    {'move': 'x'}, {'learning': 'x'}, {'learning': True}, {'guide': 1}, {'speed': 1.5},
    {'speed': True}, {'payload': -1}, {'payload': nan},
    *[{name: value} for name, values in ODD.items() for value in values]])
def test_a_request_that_no_page_of_ours_sends_is_ignored(message: Any) -> None:
    assert asked(message) == []


def test_every_other_request_is_one_call() -> None:
    assert asked({'law': 'compensation'}, {'switching': 'sign'}, {'record': True},
                 {'record': False}, {'torques': True}, {'torques': False}) == [
        *is_set('law', 'compensation'), *is_set('switching', 'sign'),
        call.start(), call.stop(), call.torques(True), call.torques(False)]
    assert asked({'move': 'stop'}, {'move': 'home'}, {'guide': True}, {'guide': False},
                 {'learning': 'freeze'}, {'learning': 'resume'}, {'learning': 'reset'},
                 {'speed': 0.5}, {'payload': 1.2}) == [
        call.move('stop'), call.move('home'), call.guide(True), call.guide(False),
        call.learning('freeze'), call.learning('resume'), call.learning('reset'),
        call.set('reference', {'speed_scaling': 0.5}), *is_set('payload_mass', 1.2)]
    fields = [{'plant': {'name': 'coulomb_friction', 'values': x}} for x in ([1, 2, 3], [5])]
    values: tuple[Any, ...] = ([1.0, 2.0, 3.0], [5.0] * 3)
    assert asked(*fields) == [
        call.set('plant', {'coulomb_friction': value}) for value in values]
    assert asked({'push': PUSH}) == [call.set(
        'plant', {'disturbance.push_duration': 0.5}, {'disturbance.push': [0.0] * 3},
        {'disturbance.push': [0.0, 5.0, 0.0]})]
    assert [asked({'time': {**TIME, 'action': x}})[0].args[1]['hold_at'] for x in (
        'hold', 'step', 'run')] == [1.001, 1.007, 0.0]


@pytest.mark.parametrize(
    'value, shown', [(True, True), (False, False), (None, False), ('x', False)])
def test_learning_has_buttons_only_where_something_learns(value: Any, shown: bool) -> None:
    page = controls(reference={'learning': value})[0]
    assert page.state()['learning'] is shown


def test_a_gain_without_effect_has_no_slider() -> None:
    assert asked(gain('ka', 5.0), law='compensation') == []
    assert 'ka' not in gain_sliders({**PARAMETERS, 'law': 'compensation'}, 3)
    hostile = {'law': {}, 'kp': ['x'], 'kv': [nan] * 3, 'lambda': 'x', 'ka': [1.0] * 9}
    assert gain_sliders(hostile, 3) == gain_sliders({}, 3) == {}


@pytest.mark.browser
def test_sliders_ask_once_on_release_and_follow_the_values_in_force(started_browser: Any) -> None:
    names = (EVIL, *(f'panda_joint{i}' for i in range(2, 8)))
    given = {'switching': 'implicit_observer', 'kp': [100.0] * 7, 'kv': [50.0] * 7,
             'ka': [8.0, 8.0, 6.0, 6.0, 2.0, 2.0, 1.0]}
    scripts = ''.join(f'<script>{(WEB / name).read_text()}</script>'
                      for name in ('numbers.js', 'controls.js', 'status.js'))
    answers: list[Any] = []
    with browser_page(started_browser) as page:
        page.set_content(
            f'<div id="panel"><div id="c">{CONTROLS}</div><div id="log"></div></div><style>'
            f'{STYLE.read_text()}{(WEB / "live.css").read_text()}</style>{scripts}<script>'
            'window.sent = []; window.update = ctcControls(document.getElementById("c"), '
            'x => sent.push(x)); window.log = ctcStatus(null, null, '
            'document.getElementById("log"));</script>')

        def put(**parameters: Any) -> None:
            """Show a state."""
            made, *_ = controls(names, {**PLANT, 'pacing': 'real_time'}, **{**given, **parameters})
            for answer in answers:
                made.answer(*answer)
            page.evaluate('([state, answers]) => { update(state); log.answers(answers); }',
                          [made.state(), list(made.answers)])
        put()
        unfold(page, 'gains')
        shown = page.get_by_label('ka as a number')
        assert shown.input_value() == '8, 8, 6, 6, 2, 2, 1'  # That of each joint.
        assert page.get_by_label('kp as a number').input_value() == '100'  # Of all joints.
        shown.fill('8, 8, 6')
        assert 'Enter one number, or 7 numbers.' in page.locator('label', has=shown).inner_text()
        shown.fill('8, 8, 6, 6, 2, 2, 1.5')
        shown.press('Enter')
        assert page.evaluate('sent') == [
            gain('ka', 8, 8, 6, 6, 2, 2, 1.5)]
        page.evaluate('() => { sent.length = 0; }')
        answers.append(('ka', True, 'done'))
        put()
        page.get_by_label('gains of', exact=True).select_option(label='panda_joint7')
        assert shown.input_value() == '1'

        slider = page.get_by_label('ka', exact=True)
        box = slider.bounding_box()
        page.mouse.move(box['x'] + box['width'] / 4, box['y'] + box['height'] / 2)
        page.mouse.down()
        for part in (0.3, 0.5):
            page.mouse.move(box['x'] + part * box['width'], box['y'] + box['height'] / 2)
            put(kp=[90.0 + part] * 7)  # Of others: the slider stays in the hand.
        dragged = float(shown.input_value())
        assert 8.0 < dragged < 12.0  # The middle of 0.1 to 1000, as its logarithm has it.
        assert page.evaluate('sent') == []
        page.mouse.up()
        assert page.evaluate('sent') == [gain('ka', 8, 8, 6, 6, 2, 2, dragged)]

        answers.append(('ka', False, EVIL))  # Refused: it goes back.
        put()
        assert shown.input_value() == '1'
        assert EVIL in page.locator('#log').inner_text()
        put(ka=[3.0] * 7)  # Changed elsewhere: it follows.
        assert shown.input_value() == '3'
        for text, reason in (('x', 'x is not a number.'), ('-1', 'The range is 0 to')):
            shown.fill(text)
            assert reason in page.locator('label', has=shown).locator('.ctc-wrong').inner_text()
            shown.press('Enter')
        shown.fill('4.25')
        shown.press('Enter')
        page.get_by_role('button', name='compensation').click()
        page.get_by_role('button', name='● record').click()
        assert page.evaluate('sent')[1:] == [
            gain('ka', *[3] * 6, 4.25), {'law': 'compensation'}, {'record': True}]
        # Of all joints the slider shows the largest value, and keeps the ratios.
        answers.append(('ka', True, 'done'))
        put()
        page.get_by_label('gains of', exact=True).select_option(label='all joints')
        slider.evaluate('it => { it.value = 0.75; it.onchange(); }')
        assert page.evaluate('sent')[-1] == gain('ka', 100, 100, 75, 75, 25, 25, 12.5)
        page.evaluate('() => { sent.length = 0; }')
        for label in ('stop', 'home', 'guide by hand', 'hold'):
            page.get_by_role('button', name=label, exact=True).first.click()
        speed = page.get_by_label('speed', exact=True)
        assert speed.input_value() == '1'
        speed.evaluate('it => { it.value = 0.25; it.onchange(); }')
        assert page.evaluate('sent') == [
            {'move': 'stop'}, {'move': 'home'}, {'guide': True}, {'guide': False}, {'speed': 0.25}]
        assert not page.get_by_label('payload', exact=True).is_visible()  # Without a URDF.
        put(model='urdf', payload_mass=1.5)
        payload = page.get_by_label('payload', exact=True)
        assert payload.input_value() == '1.5'
        payload.fill('2')
        payload.press('Enter')
        assert page.evaluate('sent')[-1] == {'payload': 2}
        page.evaluate('() => { sent.length = 0; }')
        unfold(page, 'push')
        press(page, 'push')
        page.get_by_label('duration').fill('11')
        press(page, 'push')  # The browser refuses it.
        assert page.evaluate('sent') == [{'push': {'joint': 0, 'torque': 50, 'duration': 0.2}}]
        put(law='compensation')
        assert not slider.is_visible()
        assert page.locator('[aria-pressed=true]').all_inner_texts() == ['compensation']
        assert page.locator('img').count() == 0


@pytest.mark.browser
def test_the_light_shows_all_its_lines_and_nothing_below_it_moves_up_under_the_pointer(
        started_browser: Any) -> None:
    """It grows with its text, and shrinks when the pointer is elsewhere."""
    with browser_page(started_browser) as page:
        page.set_content(
            '<div id="panel"><div id="light" class="ctc-light"></div><p id="below">x</p></div>'
            f'<style>{STYLE.read_text()}{(WEB / "live.css").read_text()}</style>'
            f'<script>{(WEB / "numbers.js").read_text()}{(WEB / "status.js").read_text()}'
            '</script><script>window.show = ctcStatus('
            'document.getElementById("light"), null, null).light;</script>')

        def put(count: int) -> tuple[bool, float]:
            """Return whether the last of some lines is in sight, and where the light ends."""
            page.evaluate('lines => show({level: 2, title: "■ error", law: "law", lines})',
                          [f'node {k}: {"what is wrong with it " * 4}' for k in range(count)])
            bounds: list[float] = page.evaluate(
                '() => { const light = document.getElementById("light"); return ['
                'light.lastElementChild.getBoundingClientRect().bottom, '
                'light.getBoundingClientRect().bottom, light.scrollHeight - light.clientHeight, '
                'document.getElementById("below").getBoundingClientRect().top]; }')
            last, end, hidden, below = bounds
            return last <= end + 1 and hidden <= 1 and end <= below, end
        few, many = put(2), put(12)
        page.mouse.move(20, 20)
        under_the_pointer = put(2)
        page.mouse.move(800, 20)
        elsewhere = put(2)
        assert [x[0] for x in (few, many, under_the_pointer, elsewhere)] == [True] * 4
        assert few[1] == elsewhere[1] < many[1] == under_the_pointer[1]


@pytest.mark.browser
def test_passes_of_a_reference_that_learns_have_a_line_and_their_history(started_browser: Any
                                                                         ) -> None:
    """Nothing is shown where nothing learns, and a reset begins a new history."""
    with browser_page(started_browser) as page:
        page.set_content(
            '<div id="panel"><div id="light"></div><div id="passes" class="ctc-passes" hidden>'
            f'</div></div><style>{STYLE.read_text()}{(WEB / "live.css").read_text()}</style>'
            f'<script>{(WEB / "numbers.js").read_text()}{(WEB / "status.js").read_text()}'
            '</script><script>window.show = ctcStatus(document.getElementById("light"), null, '
            'null, document.getElementById("passes")).passes;</script>')
        line = page.locator('#passes')
        svg = page.locator('#passes polyline')

        def put(**values: Any) -> str:
            page.evaluate('values => show(values)', {
                name.replace('_', ' '): str(value) for name, value in values.items()})
            return str(line.inner_text())

        put(time='real')
        assert not line.is_visible()
        put(**{'learning': 'waiting for a motion that is repeated', 'pass': 0})
        assert line.inner_text() == 'pass 1 · waiting for a motion that is repeated'
        for number, error in ((1, 0.0021), (2, 2.1e-4), (2, 2.1e-4), (3, '2.1e-05')):
            text = put(**{'learning': 'learning', 'pass': number, 'pass error': error})
        assert text.strip() == 'pass 3: 2.1e-5 rad · learning'
        points = svg.get_attribute('points').split()
        assert points == ['2.0,2.0', '100.0,15.0', '198.0,28.0']
        put(**{'learning': 'learning', 'pass': 0})
        assert svg.count() == 0
        text = put(**{'learning': EVIL, 'pass': EVIL, 'pass error': EVIL})
        assert EVIL in text
        assert page.locator('#passes img').count() == 0
        put(time='real')
        assert not line.is_visible()
