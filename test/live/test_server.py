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

"""Addresses of the page, and the checks of token, Host, Origin and messages."""

from __future__ import annotations

from collections.abc import Iterator
import http.client
import math
from pathlib import Path
import re
import socket
import sys
from typing import Any
from urllib.parse import unquote, urlparse
import webbrowser

from browser import browser, browser_page
from ctc_chattering.cli.bringup import main as bringup
from ctc_chattering.errors import CtcError
from ctc_chattering.live import require_viser
from ctc_chattering.live import server as serving
from ctc_chattering.live.page_socket import PageSocket
from ctc_commands import ctc, refused
import msgspec
from processes import wait_for
import pytest
from websockets import Headers
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

HOST = '127.0.0.1:8080'
RIGHT = '/?token=TOKEN'


def refusal(path: str, *headers: tuple[str, str], host: str = '127.0.0.1', port: int = 8080,
            reached: str = '127.0.0.1', access: serving.Access | None = None) -> str:
    access = access or serving.Access(host, port)
    token = access.url.partition('token=')[2]
    given = Headers([(name, value.replace('TOKEN', token)) for name, value in headers])
    return access.refusal(path.replace('TOKEN', token), given, reached)


@pytest.mark.parametrize('host', [HOST, 'localhost:8080', 'LocalHost:8080', '[::1]:8080'])
def test_the_printed_address_opens_the_page_under_the_names_of_this_machine(host: str) -> None:
    for path in (RIGHT, '/any?token=TOKEN'):
        assert refusal(path, ('Host', host)) == ''
        assert refusal(path, ('Host', host), ('Origin', f'http://{host}')) == ''


def test_the_cookie_stands_for_the_token_on_its_own_port_alone() -> None:
    access, other = serving.Access('127.0.0.1', 8080), serving.Access('127.0.0.1', 8081)
    cookie = access.cookie.partition(';')[0]
    assert {'HttpOnly', 'SameSite=Strict', 'Path=/'} < set(access.cookie.split('; '))
    for line in (cookie, f'a=b; {cookie}; c', f'{other.cookie.partition(";")[0]}; {cookie}'):
        assert refusal('/', ('Host', HOST), ('Cookie', line), access=access) == ''
    for line in (cookie.replace('8080', '8081'), cookie[:-1], cookie.upper(), 'ctc_live_8080=',
                 other.cookie.partition(';')[0], '', ';;=;'):
        assert 'token' in refusal('/', ('Host', HOST), ('Cookie', line), access=access)
        assert 'token' in refusal('/', ('Host', '127.0.0.1:8081'), ('Cookie', cookie),
                                  access=other)


#: What is asked for, with which headers, and a word of the refusal.
REFUSED: list[tuple[str, tuple[tuple[str, str], ...], str]] = [
    *((f'/{query}', (('Host', HOST),), 'token') for query in (
        '', '?', '?token', '?token=', '?token=TOKE', '?token=TOKENx', '?token=%00', '?token=é',
        '?token=T&token=', 'view/?darkMode')),
    *((RIGHT, tuple(('Host', host) for host in hosts), 'Host') for hosts in (
        (), ('evil.example:8080',), ('127.0.0.1',), ('localhost:8081',), (HOST, HOST),
        ('127.0.0.1.evil.example:8080',), ('localhost.:8080',), ('',), (HOST, 'evil.example'),
        ('192.168.0.7:8080',))),
    *((RIGHT, (('Host', HOST), ('Origin', origin)), 'Origin') for origin in (
        'http://evil.example', 'http://127.0.0.1:9999', 'http://127.0.0.1', 'null', '', 'file://',
        'https://127.0.0.1:8080', 'http://localhost:8080', f'http://{HOST}.evil.example')),
    # The client of viser takes the server from the address, and renders its HTML.
    *((path, (('Host', HOST),), 'no more') for query in (
        'websocket=ws://evil.example', 'playbackPath=http://x', 'a', 'initialCameraUp=x',
        'darkMode=http://x', 'darkMode&websocket=ws://x', 'xdarkMode=', 'Token=TOKEN')
      for path in (f'{RIGHT}&{query}', f'/?{query}&token=TOKEN'))]


@pytest.mark.parametrize(('path', 'headers', 'word'), REFUSED)
def test_nothing_is_answered_without_token_host_and_origin_of_the_page(
        path: str, headers: tuple[tuple[str, str], ...], word: str) -> None:
    assert word in refusal(path, *headers)
    assert refusal('/view/?darkMode&token=TOKEN', ('Host', HOST)) == ''


def test_on_all_addresses_the_name_and_the_address_asked_for_are_allowed() -> None:
    name = socket.gethostname()
    assert serving.Access('0.0.0.0', 8080).url.startswith(f'http://{name}:8080/')
    for host, reached in ((f'{name}:8080', '10.0.0.5'), ('10.0.0.5:8080', '10.0.0.5'),
                          ('10.0.0.5:8080', '::ffff:10.0.0.5'), (HOST, '127.0.0.1'),
                          ('[fe80::1]:8080', 'fe80::1%eth0')):
        assert refusal(RIGHT, ('Host', host), host='0.0.0.0', reached=reached) == ''
    for host in ('10.0.0.6:8080', 'evil.example:8080'):
        assert refusal(RIGHT, ('Host', host), host='0.0.0.0', reached='10.0.0.5')
    assert refusal(RIGHT, ('Host', '127.0.0.1'), port=80) == ''
    assert refusal(RIGHT, ('Host', 'robot.local:8080'), host='robot.local') == ''


def test_every_page_has_a_token_of_its_own() -> None:
    tokens = {serving.Access('127.0.0.1', 8080).url.partition('token=')[2] for _ in range(20)}
    assert len(tokens) == 20
    assert all(re.fullmatch('[-_A-Za-z0-9]{43}', token) for token in tokens)


def started(text: str = '') -> serving.PageServer:
    """Return a server of a page."""
    return serving.serve(require_viser(), '127.0.0.1', serving.free_port('127.0.0.1', 0), text,
                         PageSocket())


@pytest.fixture(scope='module')
def served() -> Iterator[str]:
    """Yield the address of a page."""
    server = started('<!doctype html><iframe src="/view/"></iframe>')
    server.viser.gui.add_html('content of the page')
    yield server.url
    server.stop()


def ask(url: str, path: str, **headers: str) -> tuple[http.client.HTTPResponse, bytes]:
    asked = http.client.HTTPConnection(url.split('/')[2], timeout=30.0)
    asked.request('GET', path, headers=headers)
    answer = asked.getresponse()
    return answer, answer.read()


def test_without_the_token_one_plain_line_is_shown(served: str) -> None:
    query = f'/?{served.partition("?")[2]}'
    evil = {'Origin': 'http://evil.example'}
    for path, headers in (('/', {}), ('/index.html', {}), ('/?token=wrong', {}), ('/view/', {}),
                          ('/samples', {}), (f'/view{query}', evil), (query, evil),
                          (query, {'Host': 'evil.example'})):
        answer, text = ask(served, path, **headers)
        assert answer.status == 403
        assert answer.getheader('Content-Type') == 'text/plain; charset=utf-8'
        assert re.fullmatch(rb'ctc live: [^\n<]+\n', text)
        assert answer.getheader('Set-Cookie') is None
    for path, wanted in ((query, serving.HEADERS), (f'/view{query}', serving.VIEW_HEADERS)):
        answer, text = ask(served, path)
        assert answer.status == 200
        assert b'<!doctype html>' in text[:100].lower()
        assert all(answer.getheader(name) == value for name, value in wanted.items())
    assert "frame-ancestors 'none'" in serving.HEADERS['Content-Security-Policy']
    assert "frame-ancestors 'self'" in serving.VIEW_HEADERS['Content-Security-Policy']
    for path in ('/index.html', '/viewer/', '/view/../setup.py', '/view/%2e%2e/%2e%2e/x'):
        assert ask(served, path + query[1:])[0].status == 404
    cookie = str(answer.getheader('Set-Cookie')).partition(';')[0]
    assert ask(served, '/', Cookie=cookie)[0].status == 200


@pytest.mark.parametrize('path', ['view', 'samples'])
def test_a_web_socket_opens_with_token_and_origin_of_the_page_alone(
        served: str, path: str) -> None:
    own = served.partition('/?')[0]
    address = served.replace('http://', 'ws://').replace('/?', f'/{path}?')
    protocol: Any = [f'viser-v{require_viser().__version__}']

    def open_it(url: str, **given: str) -> Any:
        ip, port = own.split('/')[2].split(':')
        return connect(url, sock=socket.create_connection((ip, int(port))),
                       subprotocols=protocol, additional_headers=given)
    with open_it(address) as it, open_it(address, Origin=own):
        if path == 'view':
            assert it.recv(timeout=30.0)
    wrong = address.partition('?')[0] + '?token=wrong'
    for url, headers in ((wrong, {}), (wrong, {'Origin': own}), (address, {'Origin': 'null'}),
                         (address, {'Origin': 'http://127.0.0.1:1'}),
                         (address.replace('127.0.0.1', 'evil.example'), {})):
        with pytest.raises(InvalidStatus) as refused:
            open_it(url, **headers)
        assert refused.value.response.status_code == 403


def test_a_viser_whose_requests_cannot_be_checked_is_not_started(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """Check a stand-in for one that starts its server by other means."""
    import websockets.asyncio.server as library

    viser = require_viser()
    start = library.serve

    class Other(viser.ViserServer):  # type: ignore[misc, name-defined]

        def __init__(self, *arguments: Any, **options: Any) -> None:
            with monkeypatch.context() as patch:
                patch.setattr(library, 'serve', start)
                super().__init__(*arguments, **options)
    monkeypatch.setattr(viser, 'ViserServer', Other)
    port = serving.free_port('127.0.0.1', 0)
    with pytest.raises(CtcError, match=r'cannot be checked \(status 200 without the token\)'):
        serving.serve(viser, '127.0.0.1', port, '', PageSocket())
    with pytest.raises(OSError, match='refused'):
        socket.create_connection(('127.0.0.1', port))


@pytest.mark.slow
@pytest.mark.browser
def test_a_page_of_somebody_else_reaches_nothing_in_a_browser_that_has_the_cookie(
        served: str, tmp_path: Path) -> None:
    """Check one on another port of this machine, to which the browser sends the cookie, too."""
    own, token = served.split('?')
    file = tmp_path / 'evil.html'
    file.write_text('<!doctype html>')
    elsewhere = 'http://127.0.0.1:9/'
    with (browser('--host-resolver-rules=MAP evil.example 127.0.0.1') as it,
          browser_page(it) as page):
        page.route(f'{elsewhere}**', lambda route: route.fulfill(
            content_type='text/html', body='<!doctype html>'))
        view = page.frame_locator('iframe')
        for address in (served, own):  # The cookie stands for the token.
            page.goto(address)
            view.get_by_text('content of the page').wait_for()
        assert _reached(page, own) == [True, True, True]
        for other in (elsewhere, file.as_uri()):
            page.goto(other)
            assert _reached(page, own) == [False, False, False]
            for framed in (own, f'{own}view/'):
                page.evaluate('x => { document.body.innerHTML = `<iframe src="${x}">`; }', framed)
                page.wait_for_function('() => frames.length')
                page.frames[1].wait_for_load_state()
                assert page.frames[1].get_by_text('content of the page').count() == 0
                assert not page.frames[1].url.startswith('http')
        for query in (f'?{token}', ''):  # As if the name of its server now stood for this machine.
            answer = page.goto(own.replace('127.0.0.1', 'evil.example') + query)
            assert answer.status == 403
            assert _reached(page, page.url.partition('?')[0]) == [False, False, False]


def _reached(page: Any, own: str) -> list[bool]:
    """Return whether a script of the page opens the WebSockets there, and reads what is there."""
    script = """([own, protocol]) => Promise.all([
        ...[['view', [protocol]], ['samples', []]].map(([path, protocols]) => new Promise(done => {
            const it = new WebSocket(own.replace('http', 'ws') + path, protocols);
            it.onopen = () => done(true); it.onerror = () => done(false); })),
        fetch(own, {credentials: 'include'}).then(it => it.ok, () => false)])"""
    found: list[bool] = page.evaluate(script, [own, f'viser-v{require_viser().__version__}'])
    return found


CAMERA = {'type': 'ViewerCameraMessage', 'wxyz': [1.0, 0, 0, 0], 'fov': 1, 'near': 0.1,
          'far': 10, 'image_height': 500, 'image_width': 400, 'position': [1.0, 2, 3],
          'look_at': [0, 0, 0], 'up_direction': [0, 0, 1.0]}


def test_takes_the_first_free_port_or_the_one_asked_for() -> None:
    assert serving.FIRST_PORT <= serving.free_port('127.0.0.1', None) < serving.FIRST_PORT + 50
    assert serving.free_port('127.0.0.1', 0) > 0
    with socket.socket() as other:
        other.bind(('127.0.0.1', 0))
        other.listen()
        taken = other.getsockname()[1]
        with pytest.raises(CtcError, match=f'port {taken}: Address already in use. Choose'):
            serving.free_port('127.0.0.1', taken)


def test_an_address_of_another_machine_is_refused() -> None:
    for host in ('192.0.2.1', 'no such host', 'a\0b', 'x' * 300, '::1%none'):
        with pytest.raises(CtcError) as refusal:
            serving.free_port(host, None)
        assert str(refusal.value).startswith(host)


def test_says_who_can_see_the_page() -> None:
    assert [serving.exposure_warning(x) for x in ('127.0.0.1', 'localhost', '::1')] == [''] * 3
    for host in ('0.0.0.0', '::', '', '127.evil.example', '127.1.evil'):
        assert 'Everyone' in serving.exposure_warning(host)


def test_without_viser_one_line_says_what_to_install(
        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, 'viser', None)
    refused(ctc('live'), 'viser', 'pip install viser')
    assert bringup(['--live']) == 2
    assert 'pip install' in capsys.readouterr().err


def test_only_a_camera_is_a_message_to_viser() -> None:
    """Check what viser would pass on to all browsers, and what no later one could decode."""
    def allowed(message: Any) -> bool:
        return serving.is_camera(msgspec.msgpack.encode(message))
    assert allowed(CAMERA)
    for wrong in (math.nan, math.inf, 'x', [math.nan] * 3, [1] * 5, [[1]], None, 1.0, [1, 2],
                  [True, 1, 1]):
        assert not allowed({**CAMERA, 'position': wrong})
    others: tuple[Any, ...] = (
        {**CAMERA, 'more': 1}, {k: v for k, v in CAMERA.items() if k != 'far'},
        *({**CAMERA, 'type': x} for x in ('GuiUpdateMessage', 'ShareUrlRequest', 1, None)),
        {'type': 'GuiUpdateMessage', 'uuid': 'x', 'updates': {'value': 1}}, None, 1, [], {})
    assert [x for x in others if allowed(x)] == []
    assert [x for x in (b'', b'\xc1', b'\x91' * 100_000, 'text') if serving.is_camera(x)] == []


def test_a_hostile_browser_does_not_disturb_the_next_one() -> None:
    """Check with a number that somebody forgot on the page."""
    server = started()
    url = server.url
    number = server.viser.gui.add_number('samples', 1, min=1, max=100_000, step=1)
    protocol: Any = [f'viser-v{require_viser().__version__}']
    with connect(url.replace('http', 'ws'), subprotocols=protocol) as hostile:
        for value in (7, 1e300, 'x', math.nan):
            hostile.send(msgspec.msgpack.encode({
                'type': 'GuiUpdateMessage', 'uuid': number._impl.uuid,
                'updates': {'value': value}}))
        hostile.send(b'\xc1')
        hostile.send(msgspec.msgpack.encode(CAMERA))
        wait_for(lambda: any(tuple(client.camera.position) == (1.0, 2.0, 3.0)
                             for client in server.viser.get_clients().values()), 'the camera')
        with connect(url.replace('http', 'ws'), subprotocols=protocol) as other:
            assert other.recv(timeout=30.0)
    assert number.value == 1
    server.stop()


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
    with serving.open_browser(url) as done:
        assert done
    address, file, readers, text = browser.seen
    assert 'secret' not in address and readers == 0 and not file.exists()
    assert 'url=http://127.0.0.1:8080/?token=secret&amp;more=&#34;&lt;b&gt;' in text
    monkeypatch.setattr(webbrowser, 'get', lambda: webbrowser.GenericBrowser('lynx %s'))
    with serving.open_browser(url) as done:
        assert not done
