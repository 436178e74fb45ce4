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

"""The page of a running graph in a real browser: what it shows and what its buttons do."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
import os
from pathlib import Path
import re
import signal
from typing import Any

from browser import (
    browser_page,
    ctc_live,
    eventually,
    inked,
    numbers,
    press,
    scene,
    unfold,
)
from ctc_chattering.ros.subscription import qos
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from faults import nodes_of
from processes import bringup, CONFIG, descendants, PATIENCE, Probe, probe, wait_for
import pytest
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from std_msgs.msg import String

pytestmark = [pytest.mark.ros, pytest.mark.browser]
#: 100 Hz, and patient: the browser draws with the processors that the loop needs. The law has no
#: chattering term, which late torques of a busy computer have at its bound: the light says so.
#: Torques 0.1 s late make the loop unstable; with a limit it comes back when they are in time.
PARAMETERS = """
/**: {ros__parameters: {control_period: 0.01}}
plant: {ros__parameters: {pacing: real_time, duration: 0.0, command_timeout: 1.0}}
controller: {ros__parameters: {
  law: compensation, switching: implicit_observer, ka: [25.0, 25.0], effort_limit: [600.0, 600.0],
  state_timeout: 1.0, reference_timeout: 1.0, state_decimation: 1}}
"""
LOOP = ('plant', 'controller', 'reference')


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Probe]:
    """Yield a graph in real time."""
    file = tmp_path / 'parameters.yaml'
    file.write_text(PARAMETERS)
    with probe() as it:
        for name in LOOP:
            it.start(name, '--params-file', str(file))
        yield it


def level(page: Any) -> int:
    return int(page.locator('.ctc-light').get_attribute('data-level', timeout=1e3 * PATIENCE))


def rms(page: Any) -> float:
    """Return the RMS error of joint 2 over the last second, as shown [rad]."""
    return float(numbers(page)[1][4])


def mentions(page: Any, text: str) -> bool:
    """Return whether the light says so."""
    return text in page.locator('.ctc-light').inner_text()


def shows_numbers(page: Any) -> bool:
    """Return whether a page has numbers and a green light."""
    return bool(page.locator('.ctc-numbers').count()) and level(page) == 0


def test_shows_the_graph_and_changes_it(started_browser: Any, graph: Probe) -> None:
    with ctc_live('--port', 0) as (process, url), browser_page(started_browser) as page:
        # Without the arm, which takes a processor to draw: the test of bags has it.
        page.route('**/view/**', lambda route: route.fulfill(body='<head></head>'))
        page.goto(url)
        eventually(partial(shows_numbers, page), 'a green light', page)
        eventually(lambda: min(inked(page), default=0) > 300, 'plots', page)
        assert page.url == url.partition('?')[0]
        click(graph, page, 'chattering')
        eventually(lambda: rms(page) < 2e-3, 'the error to fall', page)

        unfold(page, 'gains')
        ka = page.get_by_label('ka as a number')
        eventually(lambda: ka.input_value() == '25', 'the value in force', page)
        ka.fill('2600')
        ka.press('Enter')
        eventually(lambda: 'a factor of at most 100' in page.locator('#log').inner_text(),
                   'the refusal', page)
        assert graph.get('controller', 'ka') == [25.0] * 2
        graph.set('controller', 'ka', [25.0, 30.0])
        eventually(lambda: ka.input_value() == '25, 30', 'a change made elsewhere', page)
        for joint, wanted in (('joint2', [25.0, 40.0]), ('all joints', [20.0, 40.0])):
            page.get_by_label('gains of', exact=True).select_option(label=joint)
            ka.fill(str(wanted[1:] if joint == 'joint2' else wanted).strip('[]'))
            ka.press('Enter')
            eventually(lambda: graph.get('controller', 'ka') == wanted,
                       f'another gain of {joint}', page)

        press(page, 'disable')
        eventually(lambda: level(page) > 0 and mentions(page, 'disabled'), 'the light to change',
                   page)
        press(page, 'reset and enable')
        click(graph, page, 'compensation')
        eventually(lambda: level(page) == 0, 'the light to be green', page)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0
    assert all(child.status is None for child in graph.children)


def click(graph: Probe, page: Any, law: str) -> None:
    """Click a law until it is in force: a request has no answer where the controller is late."""
    for _ in range(20):
        press(page, law)
        page.wait_for_timeout(500)
        if graph.get('controller', 'law') == law:
            return
    raise AssertionError(law)


@pytest.mark.slow
def test_shows_which_node_has_ended_and_which_is_back(
        started_browser: Any, graph: Probe) -> None:
    with (ctc_live('--port', 0, '--read-only') as (process, url),
          browser_page(started_browser) as page):
        page.goto(url)
        eventually(partial(shows_numbers, page), 'a green light', page)
        assert page.get_by_role('button', name='chattering').count() == 0
        assert page.get_by_role('button', name='push').count() == 0
        for name, topic in (('controller', 'controller/tracking'), ('reference', 'reference')):
            (child,) = (x for x in graph.children if x.name == name and x.status is None)
            child.process.send_signal(signal.SIGKILL)
            eventually(partial(mentions, page, f'{topic}: silent for'),
                       f'the end of {name}', page)
            assert level(page) == 2
            argv: Any = child.process.args
            graph.start(name, *argv[argv.index('--ros-args') + 1:])
            eventually(lambda: level(page) == 0, f'{name} again', page)
        page.goto(url)
        eventually(partial(shows_numbers, page), 'the page again', page)
        for child in graph.children:
            child.process.send_signal(signal.SIGINT)
        eventually(lambda: 'plant: ended at' in page.locator('#ended').inner_text(),
                   'how the graph has ended', page)
        assert re.search('controller: ended at .*: SIGINT', page.locator('#ended').inner_text())
        assert level(page) == 4
        process.kill()
        process.wait()
        eventually(lambda: 'ctc live has ended' in page.locator('#note').inner_text(),
                   'the end of the page', page)


@pytest.mark.slow
def test_bringup_shows_its_graph_and_outlives_the_page(started_browser: Any) -> None:
    with bringup('--params-file', str(CONFIG / 'friction.yaml'), '--duration', '0',
                 '--live') as process:
        assert process.stdout is not None
        line = next(line for line in process.stdout if '[live] open http' in line)
        with browser_page(started_browser) as page:
            page.goto(line.split()[2])
            eventually(partial(shows_numbers, page), 'a green light', page)
            before = scene(page)

            def moved() -> bool:
                return all(x.any() and (y != x).any() for x, y in zip(scene(page), before))
            eventually(moved, 'arm and ghost to move', page)
            # Simulated time stands while it is held, and goes on by steps.
            unfold(page, 'simulated time')
            press(page, 'hold')
            eventually(lambda: mentions(page, 'held at'), 'time to stand', page)
            shown = page.locator('.ctc-now').inner_text()
            press(page, 'step')
            eventually(lambda: page.locator('.ctc-now').inner_text() != shown, 'a step', page)
            after = float(page.locator('.ctc-now').inner_text())
            assert after == pytest.approx(float(shown) + 0.001, abs=0.0105)
            press(page, 'run')
            eventually(lambda: float(page.locator('.ctc-now').inner_text()) > after + 0.1,
                       'time to go on', page)
        page_id = next(pid for pid, text in descendants(process.pid).items() if ' live ' in text)
        os.kill(page_id, signal.SIGKILL)
        wait_for(lambda: page_id not in descendants(process.pid), 'the end of the page')
        assert set(LOOP) <= nodes_of(process.pid).keys()
        process.send_signal(signal.SIGINT)
        assert process.wait(2 * PATIENCE) == 0


EVIL = '<iframe srcdoc="<script>parent.hacked = 1</script>"></iframe><img src=x onerror=hacked=1>'


@pytest.mark.slow
def test_a_hostile_graph_neither_runs_a_script_nor_ends_the_page(started_browser: Any) -> None:
    """Check with a controller that never tracks, too: it waits, or is disabled."""
    with (probe() as it, ctc_live('--port', 0) as (process, url),
          browser_page(started_browser) as page):
        page.goto(url)
        eventually(lambda: mentions(page, 'waiting for a graph'), 'the page without one', page)
        values: dict[str, dict[str, Any]] = {
            'controller': {'joint_names': [EVIL, 'b'], 'model': 'urdf', 'law': 'chattering',
                           'ka': [1.0, 2.0]},
            'plant': {'pacing': EVIL, 'hold_at': ['x'], 'coulomb_friction': ['x', 'y'],
                      'viscous_friction': 'x', 'disturbance.amplitude': [True, False]},
            'reference': {'horizon': 'long', EVIL: EVIL}}
        for name in LOOP:
            it.node.create_publisher(
                ParameterEvent, f'{name}/parameters', qos(100, latched=True)).publish(
                ParameterEvent(new_parameters=[Parameter(key, value=value).to_parameter_msg()
                                               for key, value in values[name].items()]))
        it.node.create_publisher(
            String, 'controller/robot_description', qos(1, latched=True)).publish(
            String(data=f'<robot name="{"x" * 9}"><link/></robot>'))
        diagnostics = it.node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        said = [KeyValue(key=key, value=value) for key, value in (
            (EVIL, EVIL), ('deadline misses', 'many'), ('x: refused', '9' * 5000), ('|', '|'))]
        status = [DiagnosticStatus(name=f'/{name}', level=b'\x7f', message=EVIL, values=said)
                  for name in (*LOOP, 'recorder')]

        def shown() -> bool:
            diagnostics.publish(DiagnosticArray(status=status))
            it.executor.spin_once(timeout_sec=0.0)
            return mentions(page, EVIL)
        eventually(shown, 'what the nodes say, as text', page)
        eventually(lambda: page.locator('#reports td', has_text=EVIL).count() == 8,
                   'the reports', page)
        eventually(lambda: f'pacing: {EVIL}' in page.locator('.ctc-reason').text_content(),
                   'why time cannot be held', page)
        assert page.locator('button', has_text='hold').is_disabled()
        assert page.locator('iframe').count() == 1
        assert page.locator('img[onerror]').count() == 0
        assert not page.evaluate('() => window.hacked')
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0
        assert process.stdout is not None
        assert 'Traceback' not in process.stdout.read()
