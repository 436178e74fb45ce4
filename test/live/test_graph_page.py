"""The page of a running graph in a real browser: what it shows and what its buttons do."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
import os
from pathlib import Path
import re
import signal
from typing import Any

from browser import browser_page, ctc_live, eventually, field, inked, numbers, press, scene
from faults import nodes_of
from processes import bringup, CONFIG, descendants, PATIENCE, Probe, probe, wait_for
import pytest
from rcl_interfaces.msg import ParameterEvent

from ctc_chattering.ros.node import qos

pytestmark = [pytest.mark.ros, pytest.mark.browser]
#: 100 Hz, and patient: the browser draws with the processors that the loop needs. At 100 Hz a ka
#: of 12 N·m is at its bound at every reversal, and the light says so.
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
    switching: implicit_observer
    ka: [25.0, 25.0]
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
        page.goto(url)
        eventually(lambda: page.locator('.ctc-numbers').count() and level(page) == 0,
                   'a green light', page)
        eventually(lambda: min(inked(page), default=0) > 300, 'plots', page)
        for law in ('compensation', 'chattering', 'compensation'):
            _click(graph, laws, page, law)
        eventually(lambda: 'compensation' in said(page), 'the law on the page', page)
        eventually(lambda: rms(page) > 1e-2, 'the error to grow', page)
        _click(graph, laws, page, 'chattering')
        eventually(partial(is_near, page, 2e-3), 'the error to fall', page)

        field(page, 'ka [N·m]').fill('-5')
        press(page, 'set what was edited')
        eventually(lambda: 'refused' in page.locator('.ctc-log').inner_text(), 'a reason', page)
        assert re.search(r'ka.*allowed.*0', page.locator('.ctc-log').inner_text())
        assert graph.get('controller', 'ka') == [25.0, 25.0]

        before = scene(page)
        press(page, 'disable')  # The arm falls, and the ghost goes on.
        eventually(lambda: level(page) > 0, 'the light to change', page)

        def moved() -> bool:
            return all(new.any() and (old != new).any() for old, new in zip(before, scene(page)))
        eventually(moved, 'arm and ghost to move', page)
        press(page, 'enable')
        eventually(lambda: level(page) == 0, 'the light to be green', page)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0
    assert all(child.status is None for child in graph.children)


def _click(graph: Probe, laws: list[str], page: Any, law: str) -> None:
    """Click a law, and see that it is the next one in force."""
    laws.clear()
    press(page, law)
    graph.until(lambda: laws, f'law {law}')
    assert laws[0] == graph.get('controller', 'law') == law


def test_a_push_moves_the_arm_and_ends_by_itself(graph: Probe) -> None:
    with ctc_live('--port', 0) as (_, url), browser_page() as page:
        page.goto(url)
        eventually(lambda: page.locator('.ctc-numbers').count() and rms(page) < 2e-3,
                   'a small error', page)
        field(page, 'torque [N·m]').fill('150')
        field(page, 'torque [N·m]').press('Enter')
        for _ in range(2):  # The same push again is one, too.
            press(page, 'push')
            eventually(lambda: float(numbers(page)[0][4]) > 3e-3, 'joint 1 to move', page)
            eventually(lambda: float(numbers(page)[0][4]) < 1e-3, 'its return', page)
        assert graph.get('plant', 'disturbance.push') == [150.0, 0.0]


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
        page.reload()
        eventually(lambda: page.locator('.ctc-numbers').count() and level(page) == 0,
                   'the page again', page)
        process.kill()  # The page ends, and the graph goes on.
        process.wait()
        assert all(x.status is None for x in graph.children[-2:])


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
            press(page, 'hold')
            eventually(lambda: 'held at' in said(page), 'time to stand', page)
            shown = page.locator('.ctc-time').inner_text()
            press(page, 'step')
            eventually(lambda: page.locator('.ctc-time').inner_text() != shown, 'a step', page)
            after = float(page.locator('.ctc-time').inner_text())
            assert after == pytest.approx(float(shown) + 0.001, abs=0.0105)
            press(page, 'run')
            eventually(lambda: float(page.locator('.ctc-time').inner_text()) > after + 0.1,
                       'time to go on', page)
        page_id = next(pid for pid, text in descendants(process.pid).items() if ' live ' in text)
        os.kill(page_id, signal.SIGKILL)
        wait_for(lambda: page_id not in descendants(process.pid), 'the end of the page')
        assert set(LOOP) <= nodes_of(process.pid).keys()
        process.send_signal(signal.SIGINT)
        assert process.wait(2 * PATIENCE) == 0
