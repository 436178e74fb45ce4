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
from math import inf
import os
from pathlib import Path
import re
import signal
import time
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
from ctc_chattering.ros.node import qos
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from faults import nodes_of
from processes import bringup, CONFIG, descendants, PATIENCE, Probe, probe, wait_for
import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterEvent, ParameterValue
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import String

pytestmark = [pytest.mark.ros, pytest.mark.browser]
#: 100 Hz, and patient: the browser draws with the processors that the loop needs. The law has no
#: chattering term, which late torques of a busy computer have at its bound: the light says so.
#: Torques 0.1 s late make the loop unstable; with a limit it comes back when they are in time.
PARAMETERS = """/**:
  ros__parameters:
    control_period: 0.01
plant:
  ros__parameters:
    pacing: real_time
    duration: 0.0
    command_timeout: 1.0
controller:
  ros__parameters:
    law: compensation
    switching: implicit_observer
    ka: [25.0, 25.0]
    effort_limit: [600.0, 600.0]
    state_timeout: 1.0
    reference_timeout: 1.0
    state_decimation: 1
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


def said(page: Any) -> str:
    return str(page.locator('.ctc-light').inner_text())


def rms(page: Any) -> float:
    """Return the RMS error of joint 2 over the last second, as shown [rad]."""
    return float(numbers(page)[1][4])


def is_near(page: Any, other: float) -> bool:
    return rms(page) < other


def mentions(page: Any, text: str) -> bool:
    return text in said(page)


def test_shows_the_graph_and_changes_it(graph: Probe) -> None:
    laws: list[str] = []

    def note(event: Any) -> None:
        laws.extend(item.value.string_value for item in (
            *event.new_parameters, *event.changed_parameters) if item.name == 'law')
    graph.node.create_subscription(
        ParameterEvent, 'controller/parameters', note, qos(100, latched=True))
    graph.until(lambda: laws, 'the law at the start')
    with ctc_live('--port', 0) as (process, url), browser_page() as page:
        own, token = url.split('?')
        assert re.fullmatch(r'http://127\.0\.0\.1:\d+/ token=[-\w]{43}', f'{own} {token}')
        assert page.request.get(own).status == 403
        page.goto(url)
        eventually(lambda: page.locator('.ctc-numbers').count() and level(page) == 0,
                   'a green light', page)
        eventually(lambda: min(inked(page), default=0) > 300, 'plots', page)
        assert page.url == own
        for law in ('chattering', 'compensation'):
            _click(graph, laws, page, law)
        eventually(lambda: 'compensation' in said(page), 'the law on the page', page)
        assert page.locator('#controls [aria-pressed=true]').all_inner_texts() == ['compensation']
        eventually(lambda: rms(page) > 1e-2, 'the error to grow', page)
        _click(graph, laws, page, 'chattering')
        eventually(partial(is_near, page, 2e-3), 'the error to fall', page)

        unfold(page, 'gains')
        ka = page.get_by_label('ka as a number')
        eventually(lambda: ka.input_value() == '25', 'the value in force', page)
        ka.fill('-5')
        assert page.locator('.ctc-wrong', has_text='allowed: 0 to').count() == 1
        ka.press('Enter')
        ka.fill('2600')
        ka.press('Enter')  # The first request that is sent.
        eventually(lambda: 'a factor of at most 100' in page.locator('#log').inner_text(),
                   'the refusal', page)
        assert graph.get('controller', 'ka') == [25.0] * 2
        eventually(lambda: ka.input_value() == '25', 'the value in force', page)
        press(page, 'chattering')
        eventually(lambda: 'law = chattering: done' in page.locator('#log').inner_text(),
                   'the answer', page)
        graph.set('controller', 'ka', [25.0, 30.0])
        eventually(lambda: ka.input_value() == '30', 'a change made elsewhere', page)
        page.get_by_label('gains of', exact=True).select_option(label='joint2')
        page.get_by_label('ka', exact=True).press('ArrowRight')
        graph.until(lambda: graph.get('controller', 'ka')[1] > 30.0, 'the slider')
        assert graph.get('controller', 'ka')[0] == 25.0

        before = scene(page)
        press(page, 'disable')  # The arm falls, and the ghost goes on.
        eventually(lambda: level(page) > 0 and mentions(page, 'disabled'), 'the light to change',
                   page)

        def moved() -> bool:
            return all(new.any() and (old != new).any() for old, new in zip(before, scene(page)))
        eventually(moved, 'arm and ghost to move', page)
        eventually(lambda: 's old' in page.locator('#numbers').inner_text(),
                   'the last numbers of the law to be old', page)
        press(page, 'reset and enable')
        _click(graph, laws, page, 'compensation')
        eventually(lambda: level(page) == 0, 'the light to be green', page)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0
    assert all(child.status is None for child in graph.children)


def _click(graph: Probe, laws: list[str], page: Any, law: str) -> None:
    """Click a law, again where the page had no answer in time, and see it in force."""
    laws.clear()
    pressed = -inf

    def in_force() -> bool:
        nonlocal pressed
        if time.monotonic() - pressed > 10.0:
            press(page, law)
            pressed = time.monotonic()
        return laws[-1:] == [law]
    graph.until(in_force, f'law {law}')
    assert graph.get('controller', 'law') == law


@pytest.mark.slow
def test_a_push_moves_the_arm_and_ends_by_itself(graph: Probe) -> None:
    """Check by the controller's errors: a browser that draws slowly may not show the peak."""
    errors: list[float] = []
    graph.node.create_subscription(JointState, 'controller/tracking', lambda state: errors.append(
        abs(state.position[list(state.name).index('joint1/error')])), 10)

    assert graph.set('controller', 'law', 'chattering').successful

    def rests() -> bool:
        return len(errors) > 50 and max(errors[-50:]) < 1e-3
    with ctc_live('--port', 0) as (_, url), browser_page() as page:
        page.goto(url)
        eventually(lambda: page.locator('.ctc-numbers').count() and rms(page) < 2e-3,
                   'a small error', page)
        unfold(page, 'push')
        page.get_by_label('torque [N·m]').fill('150')
        for _ in range(2):  # The same push again is one, too.
            graph.until(rests, 'joint 1 to rest')
            errors.clear()
            press(page, 'push')
            graph.until(lambda: max(errors, default=0.0) > 3e-3, 'joint 1 to move')
            graph.until(rests, 'its return')
        assert graph.get('plant', 'disturbance.push') == [150.0, 0.0]


@pytest.mark.slow
def test_shows_which_node_has_ended_and_which_is_back(graph: Probe) -> None:
    with ctc_live('--port', 0, '--read-only') as (process, url), browser_page() as page:
        page.goto(url)
        eventually(lambda: page.locator('.ctc-numbers').count() and level(page) == 0,
                   'a green light', page)
        assert page.get_by_role('button', name='chattering').count() == 0
        assert page.get_by_role('button', name='push').count() == 0
        for name, topic in (('controller', 'controller/tracking'), ('reference', 'reference')):
            (child,) = (x for x in graph.children if x.name == name and x.status is None)
            child.signal(signal.SIGKILL)
            eventually(partial(mentions, page, f'{topic}: silent for'),
                       f'the end of {name}', page)
            assert level(page) == 2
            argv: Any = child.process.args
            graph.start(name, *argv[argv.index('--ros-args') + 1:])
            eventually(lambda: level(page) == 0, f'{name} again', page)
        page.goto(url)
        eventually(lambda: page.locator('.ctc-numbers').count() and level(page) == 0,
                   'the page again', page)
        for child in graph.children:
            child.signal(signal.SIGINT)
        eventually(lambda: 'plant: ended at' in page.locator('#ended').inner_text(),
                   'how the graph has ended', page)
        assert re.search('controller: ended at .*: SIGINT', page.locator('#ended').inner_text())
        assert level(page) == 4
        process.kill()
        process.wait()
        eventually(lambda: 'ctc live has ended' in page.locator('#note').inner_text(),
                   'the end of the page', page)


@pytest.mark.slow
def test_bringup_shows_its_graph_and_outlives_the_page() -> None:
    with bringup('--params-file', str(CONFIG / 'friction.yaml'), '--duration', '0',
                 '--live') as process:
        assert process.stdout is not None
        line = next(line for line in process.stdout if '[live] open http' in line)
        with browser_page() as page:
            page.goto(line.split()[2])
            eventually(lambda: page.locator('.ctc-numbers').count() and level(page) == 0,
                       'a green light', page)
            # Simulated time stands while it is held, and goes on by steps.
            unfold(page, 'simulated time')
            press(page, 'hold')
            eventually(lambda: 'held at' in said(page), 'time to stand', page)
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


def test_a_hostile_graph_neither_runs_a_script_nor_ends_the_page() -> None:
    """Check with a controller that never tracks, too: it waits, or is disabled."""
    with probe() as it, ctc_live('--port', 0) as (process, url), browser_page() as page:
        page.goto(url)
        eventually(lambda: mentions(page, 'waiting for a graph'), 'the page without one', page)
        said_by = {name: it.node.create_publisher(
            ParameterEvent, f'{name}/parameters', qos(100, latched=True)) for name in LOOP}
        description = it.node.create_publisher(
            String, 'controller/robot_description', qos(1, latched=True))
        diagnostics = it.node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        values: dict[str, dict[str, Any]] = {
            'controller': {'joint_names': [EVIL, 'b'], 'model': 'urdf', 'law': 'chattering',
                           'ka': [1.0, 2.0]},
            'plant': {'pacing': EVIL, 'hold_at': ['x'], 'coulomb_friction': ['x', 'y'],
                      'viscous_friction': 'x', 'disturbance.amplitude': [True, False]},
            'reference': {'horizon': 'long'}}
        for name, publisher in said_by.items():
            publisher.publish(ParameterEvent(new_parameters=[
                Parameter(key, value=value).to_parameter_msg()
                for key, value in values[name].items()] + [
                    ParameterMessage(name=EVIL, value=ParameterValue(type=4, string_value=EVIL))]))
            publisher.publish(ParameterEvent(changed_parameters=[
                ParameterMessage(name='law', value=ParameterValue(type=99))]))
        description.publish(String(data=f'<robot name="{"x" * 9}"><link/></robot>'))
        status = [DiagnosticStatus(
            name=f'/{name}', level=b'\x7f', message=EVIL, values=[
                KeyValue(key=key, value=value) for key, value in (
                    (EVIL, EVIL), ('deadline misses', 'many'), ('x: refused', '9' * 5000),
                    ('y: refused', '-1'), ('|', '|'))]) for name in (*LOOP, 'recorder')]

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
