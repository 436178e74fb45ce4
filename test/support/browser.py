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

"""A real Chromium without a screen, for tests of pages."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import io
import os
import shutil
import subprocess
import sys
import time
from typing import Any

import numpy as np
from PIL import Image
from stopwatch import PATIENCE

#: Names of browsers that Playwright drives, installed by the system.
_NAMES = ('chromium', 'chromium-browser', 'google-chrome')
#: It asks for nothing but the page.
_NO_NETWORK = ('--disable-background-networking', '--disable-component-update', '--disable-sync',
               '--no-first-run', '--disable-quic')
#: Pages are slow where the processor draws them; less so if they are small.
SIZE = {'width': 1250, 'height': 520}
#: The scene is drawn by the processor: five times a second instead of sixty.
_FEW_FRAMES = """(() => {
    const draw = window.requestAnimationFrame.bind(window);
    window.requestAnimationFrame = done => setTimeout(() => draw(done), 400);
    window.cancelAnimationFrame = clearTimeout;
})()"""
#: Columns of the scene, between plots and panel.
SCENE = slice(515, 850)


def chromium() -> str | None:
    """Return the path of the browser: what CHROMIUM says, or the system's; None for neither."""
    return os.environ.get('CHROMIUM') or next(filter(None, map(shutil.which, _NAMES)), None)


@contextmanager
def browser(*arguments: str) -> Iterator[Any]:
    """Yield a browser with `arguments`."""
    from playwright.sync_api import sync_playwright
    with sync_playwright() as playwright:
        it = playwright.chromium.launch(
            executable_path=chromium(),
            args=['--enable-unsafe-swiftshader', '--no-sandbox', '--disable-dev-shm-usage',
                  *_NO_NETWORK, *arguments])
        yield it
        it.close()


@contextmanager
def browser_page(it: Any, **options: Any) -> Iterator[Any]:
    """Yield an empty page of a browser, with its own cookies; it must have had no error."""
    context = it.new_context(**{'viewport': SIZE, **options})
    context.add_init_script(_FEW_FRAMES)
    context.set_default_timeout(1e3 * PATIENCE)
    page = context.new_page()
    errors: list[str] = []
    page.on('pageerror', lambda error: errors.append(str(error)))
    try:
        yield page
    finally:
        context.close()
    assert not errors, errors


@contextmanager
def ctc_live(*arguments: object) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Start `ctc live`; yield the process and the address of its page."""
    process = subprocess.Popen(
        [sys.executable, '-u', '-m', 'ctc_chattering.cli.ctc', 'live', *map(str, arguments)],
        text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    assert process.stdout is not None
    said = []
    try:
        for line in process.stdout:
            said.append(line)
            if line.startswith('open http'):
                yield process, line.split()[1]
                break
        else:
            raise AssertionError(f'no page: {said}')
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def eventually(done: Callable[[], Any], what: str, page: Any) -> None:
    """Wait until `done` says so, and let the page go on meanwhile."""
    deadline = time.monotonic() + PATIENCE
    while not done():
        assert time.monotonic() < deadline, (
            f'waited in vain for {what}: {page.locator("body").inner_text()[:4000]}')
        page.wait_for_timeout(50)


def scene(page: Any) -> tuple[Any, Any]:
    """Return where the scene of a page is blue, as arms are, and orange, as ghosts."""
    view = page.frame(url=lambda it: '/view/' in it)
    for button in view.locator('.mantine-Notification-closeButton').all():
        button.dispatch_event('click')
    view.wait_for_function('() => !document.querySelector(".mantine-Notification-root")')
    image = Image.open(io.BytesIO(page.screenshot())).convert('RGB')
    picture = np.array(image, int)[:, SCENE]
    difference = picture[..., 2] - picture[..., 0]
    return difference > 25, difference < -25


def press(page: Any, name: str) -> None:
    """Click a button once it is enabled; without waiting for the page to stand still."""
    page.get_by_role('button', name=name, exact=True, disabled=False).dispatch_event('click')


def unfold(page: Any, title: str) -> None:
    """Show what is folded under a title."""
    page.locator('summary', has_text=title).dispatch_event('click')


def numbers(page: Any) -> list[list[str]]:
    """Return the cells of the tables of numbers, row by row."""
    rows: list[list[str]] = page.evaluate(
        '() => [...document.querySelectorAll(".ctc-numbers tr")].map('
        'row => [...row.querySelectorAll("td")].map(cell => cell.innerText))')
    return [row for row in rows if row]


def inked(page: Any) -> list[int]:
    """Return how many pixels each plot has that are not empty."""
    found: list[int] = page.evaluate(
        '() => [...document.querySelectorAll(".uplot canvas")].map(canvas => { '
        'const data = canvas.getContext("2d").getImageData('
        '0, 0, canvas.width, canvas.height).data; '
        'let count = 0; for (let i = 3; i < data.length; i += 4) count += data[i] > 0; '
        'return count; })')
    return found
