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

"""The page of bags, and its export, in a real browser."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
import json
from pathlib import Path
import re
import signal
from typing import Any
from xml.etree import ElementTree

from bags import entries, write_bag
from browser import browser_page, ctc_live, eventually, inked, numbers, press, scene
from ctc_chattering.analysis.result import Result, simulate
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.configuration import parameter_file
from ctc_chattering.live.bag_page import RecordedRun, write_export
from ctc_commands import ctc, refused
from made_once import made_once
from markupsafe import escape
import numpy as np
from processes import CONFIG, PATIENCE
import pytest

LAWS = ('chattering', 'compensation')


def result(law: str) -> tuple[Result, Any]:
    setup = parameter_file.load(CONFIG / 'friction.yaml', {
        'controller': {'law': law}, 'plant': {'duration': 0.5}})
    return simulate(setup), setup.plant


@pytest.fixture(scope='module')
def bags(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return [made_once(tmp_path_factory, law, partial(record, law)) for law in LAWS]


def record(law: str, path: Path) -> None:
    write_bag(path, entries(*result(law)))


def shows(page: Any, angles: list[list[str]]) -> bool:
    """Return whether these are the positions and desired positions on the page."""
    return [row[1:3] for row in numbers(page)] == angles


def slide(page: Any, k: int) -> None:
    """Move the slider to a sample."""
    page.locator('#time').evaluate(
        f'slider => {{ slider.value = {k / 1000}; slider.oninput(); }}')


def is_another(pictures: list[Any], now: Any) -> bool:
    """Return whether a picture has arms and ghosts, elsewhere than the last one; keep it then."""
    found = all(part.any() for part in now) and (not pictures or all(
        (new != old).any() for new, old in zip(now, pictures[-1])))
    if found:
        pictures.append(now)
    return found


@pytest.mark.browser
def test_slider_moves_both_arms_to_the_recorded_poses(
        started_browser: Any, bags: list[Path]) -> None:
    runs = [read_bag(bag).run for bag in bags]
    with ctc_live('--port', 0, *bags) as (process, url), browser_page(started_browser) as page:
        sent: list[Any] = []
        page.on('websocket', lambda it: it.on('framesent', lambda x: sent.append(x)))
        page.goto(url)
        page.wait_for_selector('.ctc-numbers')
        pictures: list[Any] = []
        for k in (137, 499):
            slide(page, k)
            wanted = [[f'{a:.4f}', f'{b:.4f}'] for run in runs
                      for a, b in zip(run.q[k], run.q_d[k])]
            eventually(partial(shows, page, wanted), f'sample {k}', page)
            eventually(lambda: is_another(pictures, scene(page)), 'both arms', page)
        with page.expect_download() as saved:
            press(page, 'picture of the arm')
        assert saved.value.suggested_filename.endswith('.png')
        view = page.frame(url=lambda it: '/view/' in it)
        view.locator('canvas').first.dispatch_event('pointerdown')  # A hand turns the camera.
        eventually(lambda: '{"moved":null}' in sent, 'the word of it', page)
        slide(page, 0)
        before = numbers(page)
        press(page, 'play')
        eventually(lambda: numbers(page)[0][1] != before[0][1], 'the arm to move', page)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0


@pytest.fixture(scope='module')
def export(bags: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp('export') / 'page.html'
    done = ctc('live', *bags, '--export', file)
    assert done.returncode == 0, done.stderr
    refused(ctc('live', *bags, '--export', file), 'exists already')
    return file


@pytest.mark.browser
def test_export_works_without_a_network(
        started_browser: Any, bags: list[Path], export: Path) -> None:
    runs = [read_bag(bag).run for bag in bags]
    asked: list[str] = []
    with browser_page(started_browser, offline=True) as page:
        page.on('request', lambda request: asked.append(request.url))
        page.goto(export.as_uri())
        arm = page.locator('#arm')
        before = arm.screenshot()
        k = 234
        slide(page, k)
        q, q_d = (np.concatenate([getattr(run, name)[k] for run in runs])
                  for name in ('q', 'q_d'))
        angles = np.array([row[1:3] for row in numbers(page)], float)
        assert angles == pytest.approx(np.stack((q, q_d), axis=1), abs=6e-5)
        e = np.concatenate([np.sqrt(np.mean((run.q_d[:k + 1] - run.q[:k + 1]) ** 2, axis=0))
                            for run in runs])
        assert [float(row[4]) for row in numbers(page)] == pytest.approx(e, rel=6e-3)
        assert arm.screenshot() != before
        page.locator('#play').click()
        page.wait_for_function(f'() => Number(document.getElementById("time").value) > {k}e-3')
        assert len(inked(page)) == 5
        assert min(inked(page)) > 300
    assert asked == [export.as_uri()]


def values_shown(page: Any) -> dict[str, list[str]]:
    """Return the values at the pointer that stand above each plot, by the plot's title."""
    found: dict[str, list[str]] = page.evaluate(
        '() => Object.fromEntries([...document.querySelectorAll(".ctc-panel")].map(panel => [ '
        'panel.querySelector("b").innerText, '
        '[...panel.querySelectorAll(".ctc-value")].map(x => x.innerText)]))')
    return found


@pytest.mark.browser
def test_the_pointer_in_a_plot_shows_the_values_of_all_plots_and_of_the_table(
        started_browser: Any, bags: list[Path], export: Path) -> None:
    """Those of the time under it; in a spectrum, those of its frequency in all spectra."""
    runs = [read_bag(bag).run for bag in bags]
    with browser_page(started_browser, offline=True,
                      viewport={'width': 1250, 'height': 2000}) as page:
        page.goto(export.as_uri())
        for chip in ('spectrum of error', 'spectrum of torque'):
            page.get_by_text(chip, exact=True).click()
        page.wait_for_function('() => plots.panels.length === 9 && plots.panels.every('
                               'x => x.lines[0].t?.length && x.title.textContent)')
        slide(page, 5)
        before = numbers(page)

        def point(panel: str) -> None:
            box = page.locator('.ctc-panel', has_text=panel).first.locator(
                '.u-over').bounding_box()
            page.mouse.move(box['x'] + 0.4 * box['width'], box['y'] + 0.5 * box['height'])
        point('error of joint1')
        page.wait_for_function('() => plots.cursor !== null')
        assert 'at the pointer' in page.locator('#numbers').inner_text()
        t = page.evaluate('() => plots.cursor')
        assert t == pytest.approx(0.2, abs=0.002)
        k = int(np.searchsorted(runs[0].t, t + 5e-7, side='right')) - 1
        assert [row[1:3] for row in numbers(page)] == [
            [f'{a:.4f}', f'{b:.4f}'] for run in runs for a, b in zip(run.q[k], run.q_d[k])]
        above = values_shown(page)
        assert all(all(values) == ('spectrum' not in title) for title, values in above.items())
        point('spectrum of torque of joint2')
        page.wait_for_function('() => plots.frequency !== null && plots.cursor === null')
        assert all(map(all, values_shown(page).values()))  # Others have those of the slider.
        assert numbers(page) == before
        assert 'at the pointer' not in page.locator('#numbers').inner_text()


@pytest.mark.browser
def test_of_a_running_graph_the_time_under_a_resting_pointer_goes_on(
        started_browser: Any, export: Path) -> None:
    with browser_page(started_browser, offline=True) as page:
        page.goto(export.as_uri())
        page.evaluate("""() => {
            document.body.innerHTML = '<div id="here" style="width:600px"></div>';
            const t = from => Array.from({length: 1001}, (_, k) => from + k / 100);
            window.seen = [];
            window.made = ctcPlots.mount(document.getElementById('here'), {
                joints: ['a'], runs: [{t: t(0), signals: {e: [t(0)]}}]},
                {signals: ['e'], window: 10, onPoint: x => seen.push(x)});
            window.later = () => {
                Object.assign(made.runs[0].tracks[0], { t: t(3), signals: { e: [t(3)] } });
                made.redraw();
            };
        }""")
        page.wait_for_function('() => made.panels[0].lines[0].t?.length')
        box = page.locator('.u-over').bounding_box()
        page.mouse.move(box['x'] + 0.5 * box['width'], box['y'] + 30)
        page.wait_for_function('() => seen.length > 0')
        before = page.evaluate('made.cursor')
        assert before == pytest.approx(5.0, abs=0.1)
        page.evaluate('later()')
        page.wait_for_function('before => made.cursor !== before', arg=before)
        assert page.evaluate('made.cursor') == pytest.approx(before + 3.0, abs=1e-6)
        (value,) = values_shown(page)['error of a [rad]']
        assert float(value) == pytest.approx(before + 3.0, abs=6e-3)
        assert page.evaluate('seen') == pytest.approx([before, before + 3.0])


@pytest.mark.browser
def test_plots_show_known_samples(started_browser: Any, export: Path) -> None:
    """Draw 50 s at 1 kHz of an error, an expression of the time t."""
    with browser_page(started_browser, offline=True) as page:
        page.goto(export.as_uri())

        def shown(values: str, *signals: str) -> Any:
            page.evaluate("""([values, signals]) => {
                document.body.innerHTML = '<div id="here" style="width:600px"></div>';
                const t = Array.from({length: 50001}, (_, k) => k / 1000);
                const e = [t.map(new Function('t', `return ${values}`))];
                window.made = ctcPlots.mount(document.getElementById('here'), {
                    joints: ['a'], runs: [{t, signals: {e}}]}, {signals, wheel: 'always'});
            }""", [values, signals])
            page.wait_for_function('() => made.panels.every(x => x.lines[0].t?.length)')
            return page.evaluate_handle('() => made.panels[0]')

        for values, unit in (('2', ' [rad]'), ('0.5234567 + 1e-9 * t', ' [10⁻⁹ rad]')):
            panel = shown(values, 'e')
            page.wait_for_function('panel => panel.u.axes[1]._values?.length', arg=panel)
            *labels, title = panel.evaluate(
                'it => [...it.u.axes[1]._values, it.title.textContent]')
            assert len(set(labels)) == len(labels) > 2, labels
            assert not {'-0', '−0', '−0.0'} & set(labels) and max(map(len, labels)) < 8
            assert title.startswith('error of a') and title.endswith(unit)
        # A single sample is seen among 50 000, and alone after zooming to it.
        panel = shown('Math.abs(t - 20) < 1e-6 ? 1 : 0', 'e')
        with page.expect_download() as saved:
            page.get_by_role('button', name='SVG').click()
        drawing = ElementTree.parse(saved.value.path())
        (path,) = (x for x in drawing.findall('.//{*}path') if x.get('d'))
        points = np.array(re.findall(r'[ML](\S+?) ([^ML]+)', str(path.get('d'))), float)
        width, height = map(float, drawing.findall('.//{*}svg')[0].get('viewBox', '').split()[2:])
        peak = points[np.argmin(points[:, 1])]
        assert peak[0] / width == pytest.approx(0.4, abs=1e-3)
        assert np.median(points[:, 1]) - peak[1] > 0.8 * height
        assert 'error of a [rad]' in [x.text for x in drawing.findall('.//{*}text')]
        box = page.locator('.u-over').bounding_box()
        for _ in range(12):
            page.mouse.move(box['x'] + 0.4 * box['width'], box['y'] + 30)
            page.mouse.wheel(0, -120)
        page.wait_for_function('() => made.view && made.view[1] - made.view[0] < 0.5')
        low, high = page.evaluate('() => made.view')
        assert low < 20 < high
        page.mouse.dblclick(box['x'] + 9, box['y'] + 30)
        page.wait_for_function('() => made.view === null')
        panel = shown('0.3 * Math.sin(2 * Math.PI * 50 * t) + 5', 'spectrum_e')
        frequency, amplitude = panel.evaluate("""it => { const {t, at} = it.lines[0];
            let best = 0; t.forEach((_, i) => { if (at(i) > at(best)) best = i; });
            return [t[best], at(best)]; }""")
        assert frequency == pytest.approx(50.0, abs=0.1)
        assert 10 ** amplitude == pytest.approx(0.3, rel=0.2)  # Between two lines of it.


def test_nothing_of_a_bag_is_html_in_its_pages(tmp_path: Path) -> None:
    evil = '</script><iframe srcdoc="<script>hacked=1</script>"></iframe>\udcff'
    made, _ = result('chattering')
    run = RecordedRun(replace(
        made, source=evil, law_terms=made.terms, description='<robot><link/></robot>',
        configs=[(0.0, replace(made.config, model='urdf'))]))
    assert run.remark == 'the arm cannot be drawn: URDF: a link is not named'
    for t in (0.2, 0.2004):  # The page shows the last sample before a time.
        assert np.array_equal(run.positions(t), (made.run.q[200], made.run.q_d[200]))
    write_export([run], tmp_path / 'page.html')
    text = (tmp_path / 'page.html').read_text(encoding='utf-8')
    assert text.count('</script>') == 6
    assert '<iframe' not in text
    title = evil.replace('\udcff', '?')
    assert text.count(str(escape(title))) == 2
    data = json.loads(text.partition('application/json">')[2].partition('</script>')[0])
    assert data['runs'][0]['name'] == title
    assert data['runs'][0]['bodies'] == []
