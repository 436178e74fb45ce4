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

"""The page's own controls in a browser: one request on release, and the values in force."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from browser import browser_page
import ctc_chattering.live
from ctc_chattering.live.law_panel import LawPanel
import pytest

WEB = Path(ctc_chattering.live.__file__).parent / 'web'
EVIL = '<img src=x onerror=hacked=1>'
NAMES = (EVIL, *(f'panda_joint{i}' for i in range(2, 8)))
PARAMETERS: dict[str, Any] = {
    'law': 'chattering', 'switching': 'implicit_observer', 'kp': [100.0] * 7, 'kv': [50.0] * 7,
    'lambda': 10.0, 'ka': [8.0, 8.0, 6.0, 6.0, 2.0, 2.0, 1.0]}
RECORD = {'state': 'off', 'path': '/home/lab', 'lasts': 0}


def put(page: Any, panel: LawPanel, **parameters: Any) -> None:
    """Have the page show a state."""
    page.evaluate('state => update(state)', panel.state(
        NAMES, {**PARAMETERS, **parameters}, RECORD))


@pytest.mark.browser
def test_sliders_ask_once_on_release_and_follow_the_values_in_force() -> None:
    panel = LawPanel(lambda *_: None)
    with browser_page() as page:
        page.set_content(
            '<div id="c"></div><iframe></iframe><style>' + (WEB / 'controls.css').read_text()
            + '</style><script>' + (WEB / 'controls.js').read_text()
            + 'window.sent = []; window.update = controls(document.getElementById("c"), '
            'x => sent.push(x), document.querySelector("iframe"));</script>')
        put(page, panel)
        assert page.locator('[aria-pressed=true]').all_inner_texts() == [
            'chattering', 'implicit_observer']
        shown = page.get_by_label('ka as a number')
        assert shown.input_value() == '8'  # The largest of all joints.
        page.get_by_label('gains of', exact=True).select_option(label='panda_joint7')
        assert shown.input_value() == '1'

        slider = page.get_by_label('ka', exact=True)
        box = slider.bounding_box()
        page.mouse.move(box['x'] + box['width'] / 4, box['y'] + box['height'] / 2)
        page.mouse.down()
        for part in (0.3, 0.4, 0.5):
            page.mouse.move(box['x'] + part * box['width'], box['y'] + box['height'] / 2)
            put(page, panel, kp=[90.0 + part] * 7)  # Of others: the slider stays in the hand.
        dragged = float(shown.input_value())
        assert 8.0 < dragged < 12.0  # The middle of 0.1 to 1000, as its logarithm has it.
        assert page.evaluate('sent') == []
        page.mouse.up()
        assert page.evaluate('sent') == [{'gain': {'name': 'ka', 'joint': 6, 'value': dragged}}]

        panel.answer('ka', False, EVIL)  # Refused: it goes back.
        put(page, panel)
        assert shown.input_value() == '1'
        assert EVIL in page.locator('.ctc-answers').inner_text()
        put(page, panel, ka=[3.0] * 7)  # Changed elsewhere: it follows.
        assert shown.input_value() == '3'
        assert float(slider.input_value()) == pytest.approx(0.369, abs=1e-3)
        shown.fill('4.25')
        shown.press('Enter')
        page.get_by_role('button', name='compensation').click()
        page.get_by_role('button', name='● record').click()
        assert page.evaluate('sent').pop(0) is not None
        assert page.evaluate('sent')[1:] == [
            {'gain': {'name': 'ka', 'joint': 6, 'value': 4.25}}, {'law': 'compensation'},
            {'record': ''}]
        put(page, panel, law='compensation')
        assert slider.is_disabled()
        assert page.locator('[aria-pressed=true]').all_inner_texts() == ['compensation']
        assert page.locator('img').count() == 0


AROUND = """<iframe id="v"></iframe><script>{script}
const store = {{ read: () => JSON.parse(localStorage.c || '{{}}'),
                 write: x => localStorage.c = JSON.stringify(x) }};
window.scene = view(document.getElementById('v'), store);</script>"""
CAMERA = '&initialCameraPosition=1.0,-2.500,3&initialCameraFov=0.8'


@pytest.mark.browser
def test_the_browser_keeps_a_camera_that_was_moved_for_this_arm() -> None:
    """Check with a view that prints its camera as that of viser does."""
    script = (WEB / 'view.js').read_text()
    with browser_page(color_scheme='dark') as page:
        page.route('http://ctc.test/**', lambda route: route.fulfill(
            content_type='text/html', body='<canvas></canvas>' if '/view/' in route.request.url
            else AROUND.format(script=script)))

        def opened(scene: str = 'two links') -> Any:
            page.goto('http://ctc.test/')
            page.evaluate('name => scene(name)', scene)
            page.frame_locator('#v').locator('canvas').wait_for()
            return page.frame(url='**/view/**')

        plain = 'http://ctc.test/view/?logCamera&darkMode'
        frame = opened()
        assert frame.url == plain
        frame.evaluate('x => console.log(x)', CAMERA)  # Where the server has put it.
        page.wait_for_timeout(400)
        frame = opened()
        assert frame.url == plain
        frame.locator('canvas').click()
        frame.evaluate('x => console.log(x)', CAMERA)
        page.wait_for_function('() => localStorage.c')
        assert opened().url == plain + CAMERA
        opened('panda')  # Another arm.
        page.wait_for_function('() => !document.getElementById("v").src.includes("Position")')
        page.evaluate('() => localStorage.c = JSON.stringify({camera: {'
                      'scene: "two links", words: "&websocket=ws://evil"}})')
        assert opened().url == plain
