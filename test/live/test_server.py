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

"""Where the page listens, what a browser may say to viser, and how the browser is opened."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import json
import math
import os
from pathlib import Path
import socket
import subprocess
import sys
from typing import Any

from ctc_chattering.cli.bringup import main as bringup
from ctc_chattering.errors import CtcError
from ctc_chattering.live import require_viser
from ctc_chattering.live.page_socket import PageSocket
from ctc_chattering.live.server import (
    free_port,
    is_camera,
    PORT,
    serve,
    stop,
    warning_of,
)
from ctc_commands import ctc, refused
import msgspec
from processes import wait_for
import pytest
from websockets.sync.client import connect

CAMERA = {'type': 'ViewerCameraMessage', 'wxyz': [1.0, 0, 0, 0], 'fov': 1, 'near': 0.1,
          'far': 10, 'image_height': 500, 'image_width': 400, 'position': [1.0, 2, 3],
          'look_at': [0, 0, 0], 'up_direction': [0, 0, 1.0]}


def test_takes_the_first_free_port_or_the_one_asked_for() -> None:
    assert PORT <= free_port('127.0.0.1', None) < PORT + 50
    assert free_port('127.0.0.1', 0) > 0
    with socket.socket() as other:
        other.bind(('127.0.0.1', 0))
        other.listen()
        taken = other.getsockname()[1]
        with pytest.raises(CtcError, match=f'port {taken}: Address already in use; --port'):
            free_port('127.0.0.1', taken)


@pytest.mark.parametrize('host', ['192.0.2.1', 'no such host', 'a\0b', 'x' * 300, '::1%none'])
def test_an_address_of_another_machine_is_refused(host: str) -> None:
    with pytest.raises(CtcError) as refusal:
        free_port(host, None)
    assert str(refusal.value).startswith(host)


def test_says_who_can_see_the_page() -> None:
    assert warning_of('127.0.0.1') == warning_of('localhost') == warning_of('::1') == ''
    for host in ('0.0.0.0', '::', '', '127.evil.example', '127.1.evil'):
        assert 'everyone' in warning_of(host)


def test_without_viser_one_line_says_what_to_install(
        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, 'viser', None)
    refused(ctc('live'), 'viser', 'pip install viser')
    assert bringup(['--live']) == 2
    assert 'pip install' in capsys.readouterr().err


def test_only_a_camera_is_a_message_to_viser() -> None:
    """Check what viser would pass on to all browsers, and what no later one could decode."""
    def allowed(message: Any) -> bool:
        return is_camera(msgspec.msgpack.encode(message))
    assert allowed(CAMERA)
    for wrong in (math.nan, math.inf, 'x', [math.nan] * 3, [1] * 5, [[1]], None, 1.0, [1, 2],
                  [True, 1, 1]):
        assert not allowed({**CAMERA, 'position': wrong})
    others: tuple[Any, ...] = (
        {**CAMERA, 'more': 1}, {k: v for k, v in CAMERA.items() if k != 'far'},
        *({**CAMERA, 'type': x} for x in ('GuiUpdateMessage', 'ShareUrlRequest', 1, None)),
        {'type': 'GuiUpdateMessage', 'uuid': 'x', 'updates': {'value': 1}}, None, 1, [], {})
    assert [x for x in others if allowed(x)] == []
    assert [x for x in (b'', b'\xc1', b'\x91' * 100_000, 'text') if is_camera(x)] == []


@pytest.fixture
def page() -> Iterator[tuple[Any, Callable[[], Any]]]:
    """Yield viser's server with a number that somebody forgot there, and what connects to it."""
    viser = require_viser()
    server, url = serve(viser, '127.0.0.1', free_port('127.0.0.1', 0), '', PageSocket())
    number = server.gui.add_number('samples', 1, min=1, max=100_000, step=1)
    protocol: Any = [f'viser-v{viser.__version__}']
    yield number, lambda: connect(url.replace('http', 'ws'), subprotocols=protocol)
    stop(server)


def test_a_hostile_browser_does_not_disturb_the_next_one(page: Any) -> None:
    number, opened = page
    with opened() as hostile:
        for value in (7, 1e300, 'x', math.nan):
            hostile.send(msgspec.msgpack.encode({
                'type': 'GuiUpdateMessage', 'uuid': number._impl.uuid,
                'updates': {'value': value}}))
        hostile.send(b'\xc1')
        hostile.send(msgspec.msgpack.encode(CAMERA))
        server = number._impl.gui_api._owner
        wait_for(lambda: any(tuple(client.camera.position) == (1.0, 2.0, 3.0)
                             for client in server.get_clients().values()), 'the camera')
        with opened() as other:
            assert other.recv(timeout=30.0)
    assert number.value == 1


URL = 'http://127.0.0.1:8080/?token=secret&more="<b>'
OPEN = (f'from ctc_chattering.live.server import opened\n'
        f'with opened({URL!r}) as done:\n'
        '    print(done, flush=True)\n'
        '    input()\n')
BROWSER = """#!{python}
import json, sys, time
from pathlib import Path
from urllib.parse import unquote, urlparse
file = Path(unquote(urlparse(sys.argv[1]).path))
made = Path({out!r} + '.part')
made.write_text(json.dumps([sys.argv[1], file.stat().st_mode & 0o77, file.read_text(),
                            file.parent.stat().st_mode & 0o77]))
made.rename({out!r})
while file.exists():  # Its window stays open: one that is gone at once counts as none.
    time.sleep(0.02)
"""


@pytest.mark.parametrize('window', [True, False])
def test_the_browser_gets_a_file_that_nobody_else_reads(tmp_path: Path, window: bool) -> None:
    """Check it with a browser of a window, which ends with "&", and one that takes a terminal."""
    out, browser = tmp_path / 'seen.json', tmp_path / 'browser'
    browser.write_text(BROWSER.format(python=sys.executable, out=str(out)))
    browser.chmod(0o755)
    started = subprocess.Popen(
        [sys.executable, '-c', OPEN], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        env={**os.environ, 'TMPDIR': str(tmp_path), 'BROWSER': f'{browser} %s' + ' &' * window})
    assert started.stdout is not None
    assert started.stdout.readline() == f'{window}\n'
    if window:
        wait_for(out.exists, 'the browser')
        argument, _, text, readers = json.loads(out.read_text())
        assert 'secret' not in argument
        assert readers == 0
        assert 'url=http://127.0.0.1:8080/?token=secret&amp;more=&#34;&lt;b&gt;' in text
    started.communicate('\n')
    assert started.returncode == 0
    assert not list(tmp_path.rglob('page.html'))
    assert out.exists() == window
