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

import math
from pathlib import Path
import socket
import sys
from typing import Any
from urllib.parse import unquote, urlparse
import webbrowser

from ctc_chattering.cli.bringup import main as bringup
from ctc_chattering.errors import CtcError
from ctc_chattering.live import require_viser
from ctc_chattering.live.page_socket import PageSocket
from ctc_chattering.live.server import (
    free_port,
    is_camera,
    opened,
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


def test_an_address_of_another_machine_is_refused() -> None:
    for host in ('192.0.2.1', 'no such host', 'a\0b', 'x' * 300, '::1%none'):
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


def test_a_hostile_browser_does_not_disturb_the_next_one() -> None:
    """Check with a number that somebody forgot on the page."""
    viser = require_viser()
    server, url = serve(viser, '127.0.0.1', free_port('127.0.0.1', 0), '', PageSocket())
    number = server.gui.add_number('samples', 1, min=1, max=100_000, step=1)
    protocol: Any = [f'viser-v{viser.__version__}']
    with connect(url.replace('http', 'ws'), subprotocols=protocol) as hostile:
        for value in (7, 1e300, 'x', math.nan):
            hostile.send(msgspec.msgpack.encode({
                'type': 'GuiUpdateMessage', 'uuid': number._impl.uuid,
                'updates': {'value': value}}))
        hostile.send(b'\xc1')
        hostile.send(msgspec.msgpack.encode(CAMERA))
        wait_for(lambda: any(tuple(client.camera.position) == (1.0, 2.0, 3.0)
                             for client in server.get_clients().values()), 'the camera')
        with connect(url.replace('http', 'ws'), subprotocols=protocol) as other:
            assert other.recv(timeout=30.0)
    assert number.value == 1
    stop(server)


class Browser:
    """A browser with a window of its own, that reads what it is given."""

    def __init__(self) -> None:
        self.seen: list[Any] = []

    def open(self, address: str) -> bool:  # noqa: A003
        file = Path(unquote(urlparse(address).path))
        self.seen += [address, file, file.stat().st_mode & file.parent.stat().st_mode & 0o77,
                      file.read_text()]
        return True


def test_the_browser_gets_a_file_that_nobody_else_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its address is not among the arguments of a process; a browser in the terminal is none."""
    url, browser = 'http://127.0.0.1:8080/?token=secret&more="<b>', Browser()
    monkeypatch.setattr(webbrowser, 'get', lambda: browser)
    with opened(url) as done:
        assert done
    address, file, readers, text = browser.seen
    assert 'secret' not in address and readers == 0 and not file.exists()
    assert 'url=http://127.0.0.1:8080/?token=secret&amp;more=&#34;&lt;b&gt;' in text
    monkeypatch.setattr(webbrowser, 'get', lambda: webbrowser.GenericBrowser('lynx %s'))
    with opened(url) as done:
        assert not done
