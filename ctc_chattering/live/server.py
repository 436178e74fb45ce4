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

"""
The page's server: viser behind a check of every request and message.

`Page` starts it with `serve`. At ``/`` is our page, which frames the scene that viser serves
below ``/view/``. At ``/samples`` is our WebSocket. `Access` decides who may open them.

viser 1.1 has no hook before its handlers: it passes its own ``process_request`` to
`websockets.asyncio.server.serve`. `_guarded` therefore wraps this function while viser starts, and
`_check_closed` proves afterwards that the gate is in force.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
import errno
from functools import partial
from hmac import compare_digest
from http import HTTPStatus
from http.client import HTTPConnection, HTTPException
from io import StringIO
from ipaddress import ip_address
from math import isfinite
from pathlib import Path
from secrets import token_urlsafe
import socket
import tempfile
import time
from typing import Any, NamedTuple
from urllib.parse import parse_qsl
import webbrowser

from ctc_chattering.analysis.markup import fragment
from ctc_chattering.errors import CtcError
from ctc_chattering.live.page_socket import PageSocket
from ctc_chattering.numerics.leaky_bucket import LeakyBucket
from msgspec import Struct
from msgspec.msgpack import decode
from msgspec.structs import astuple
import numpy as np

#: Address and first port by default.
HOST = '127.0.0.1'
FIRST_PORT = 8080
_PORTS_TRIED = 50
#: Paths of viser's page and of our WebSocket.
_VIEW_PATH = '/view/'
_SAMPLES_PATH = '/samples'
#: Addresses that stand for all of this machine, with one that reaches it.
_ALL_ADDRESSES = {'': '127.0.0.1', '0.0.0.0': '127.0.0.1', '::': '::1'}
#: Headers of every answer. No other page frames ours, and its address is told to nobody.
HEADERS = {
    'Cache-Control': 'no-store',
    'Referrer-Policy': 'no-referrer',
    'Content-Security-Policy': "frame-ancestors 'none'; frame-src 'self'; object-src 'none'; "
                               "base-uri 'none'; form-action 'none'"}
#: Headers of viser's view. Our page alone frames it, and it frames nothing.
VIEW_HEADERS = {**HEADERS, 'Content-Security-Policy': HEADERS['Content-Security-Policy'].replace(
    "frame-ancestors 'none'; frame-src 'self'", "frame-ancestors 'self'; frame-src 'none'")}
#: Messages a second that are taken of a page in the long run. A moved slider or camera sends
#: fewer. Others wait in the browser.
MESSAGE_RATE_HZ = 100.0
#: Messages that are taken of a page at once.
MESSAGE_BURST = 100.0


class Access:
    """
    Rule by which a request is answered.

    The browser sends the token of the printed address once. From then on it sends the cookie that
    it gets for it, with handshakes of WebSockets also.

    A browser sends cookies to all ports of a host, and other pages can make it send requests.
    Therefore `Origin` must be this page. Another name may stand for this machine's address.
    Therefore `Host` must be this page.

    Parameters
    ----------
    host : str
        Address that is listened on.
    port : int

    Attributes
    ----------
    url : str
        Address to open, with the token.
    cookie : str
        Cookie for this port alone, until the browser is closed.

    """

    def __init__(self, host: str, port: int) -> None:
        self._token = token_urlsafe(32)
        self._port = port
        self._on_all_addresses = host in _ALL_ADDRESSES
        name = socket.gethostname() if self._on_all_addresses else _bracketed(host)
        self._names = {'localhost', '127.0.0.1', '[::1]', name.lower()}
        self._cookie_name = f'ctc_live_{port}'
        self.url = f'http://{name}:{port}/?token={self._token}'
        self.cookie = f'{self._cookie_name}={self._token}; Path=/; HttpOnly; SameSite=Strict'

    def refusal(self, path: str, headers: Any, local_address: str) -> str:
        """
        Return the reason to refuse a request, or an empty text.

        Parameters
        ----------
        path : str
            Path with the query.
        headers : Headers
            Headers as websockets has them. One name may have several values.
        local_address : str
            This machine's address that the request came to.

        """
        hosts, origins, cookies = map(headers.get_all, ('Host', 'Origin', 'Cookie'))
        if len(hosts) != 1 or hosts[0].lower() not in self._allowed_hosts(local_address):
            return 'the Host header is not an address of this page'
        page = f'http://{hosts[0].lower()}'
        if any(origin.lower() != page for origin in origins):
            return 'the Origin header is another page'
        query = parse_qsl(path.partition('?')[2], keep_blank_values=True)
        # viser's client takes others: `websocket` would connect the page to another server.
        if any(name != 'token' and (name, value) != ('darkMode', '') for name, value in query):
            return 'the address takes no more than the token'
        tokens = [value for name, value in query if name == 'token']
        if not any(map(self._is_token, [*tokens, *self._cookie_values(cookies)])):
            return 'the token is missing: open the address that ctc live has printed'
        return ''

    def _cookie_values(self, headers: list[str]) -> Iterator[str]:
        """Yield the values of our cookie."""
        for cookie in ';'.join(headers).split(';'):
            name, _, value = cookie.strip().partition('=')
            if name == self._cookie_name:
                yield value

    def _allowed_hosts(self, local_address: str) -> set[str]:
        """Return the values that `Host` may have."""
        names = set(self._names)
        if self._on_all_addresses:
            # IPv6 sockets write IPv4 addresses with a prefix.
            address = local_address.lower().removeprefix('::ffff:').partition('%')[0]
            names.add(_bracketed(address))
        hosts = {f'{name}:{self._port}' for name in names}
        return hosts | names if self._port == 80 else hosts

    def _is_token(self, text: str) -> bool:
        return compare_digest(text.encode(errors='replace'), self._token.encode())


def limit_rate(receive: Callable[[], Awaitable[Any]]) -> Callable[[], Awaitable[Any]]:
    """Return a receiver that takes no more than a page sends."""
    bucket = LeakyBucket(MESSAGE_RATE_HZ, MESSAGE_BURST)

    async def receive_in_time() -> Any:
        message = await receive()
        await asyncio.sleep(bucket.fill(1.0, time.monotonic()) / MESSAGE_RATE_HZ)
        return message
    return receive_in_time


class _RequestGate:
    """
    Checks access before viser handles a request or connection.

    Parameters
    ----------
    access : Access
    page : str
        HTML of our page.
    samples : PageSocket
        Server of our WebSocket.

    """

    def __init__(self, access: Access, page: str, samples: PageSocket) -> None:
        self._access = access
        self._page = page
        self._samples = samples

    def process_request(self, viser_response: Any, connection: Any, request: Any) -> Any:
        """Return the answer to a request, or None for a handshake."""
        address = connection.local_address[0]
        reason = self._access.refusal(request.path, request.headers, address)
        is_view = request.path.startswith(_VIEW_PATH)
        if reason:
            response = connection.respond(HTTPStatus.FORBIDDEN, f'ctc live: {reason}\n')
        elif is_view or 'Upgrade' in request.headers:
            if is_view:
                request.path = request.path.replace(_VIEW_PATH, '/', 1)
            response = viser_response(connection, request)
        elif _path(request) == '/':
            response = connection.respond(HTTPStatus.OK, self._page)
            del response.headers['Content-Type']
            response.headers['Content-Type'] = 'text/html; charset=utf-8'
        else:
            response = connection.respond(
                HTTPStatus.NOT_FOUND, 'ctc live: there is no page at this address\n')
        if response is not None:
            if not reason:
                response.headers['Set-Cookie'] = self._access.cookie
            response.headers.update(VIEW_HEADERS if is_view else HEADERS)
        return response

    async def handle_connection(self, viser_handler: Any, connection: Any) -> None:
        """Serve our WebSocket, or let viser serve one that only sends cameras."""
        receive = connection.recv = limit_rate(connection.recv)
        if _path(connection.request) == _SAMPLES_PATH:
            await self._samples.serve(connection)
            return

        async def receive_camera() -> Any:
            while not is_camera(message := await receive()):
                pass
            return message
        connection.recv = receive_camera
        await viser_handler(connection)


class CameraMessage(Struct, tag='ViewerCameraMessage', forbid_unknown_fields=True):
    """Pose of a browser's camera, the only message to viser."""

    wxyz: tuple[float, float, float, float]
    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    up_direction: tuple[float, float, float]
    fov: float
    near: float
    far: float
    image_height: float
    image_width: float


def is_camera(message: Any) -> bool:
    """Return whether a browser's message is a `CameraMessage` of finite numbers."""
    with suppress(Exception):  # The bytes are arbitrary.
        return all(map(isfinite, np.hstack(astuple(decode(message, type=CameraMessage)))))
    return False


def _path(request: Any) -> str:
    return str(request.path.partition('?')[0])


class PageServer(NamedTuple):
    """A running ViserServer and the address to open."""

    viser: Any
    url: str

    def stop(self) -> None:
        """Stop serving."""
        with suppress(RuntimeError), redirect_stdout(StringIO()):
            self.viser.stop()


def serve(viser: Any, host: str, port: int, page: str, samples: PageSocket) -> PageServer:
    """
    Start viser's server behind the gate.

    Parameters
    ----------
    viser : module
        The library.
    host : str
        Address to listen on.
    port : int
        A free port.
    page : str
        HTML of the page around viser's scene.
    samples : PageSocket
        Server of our WebSocket.

    Raises
    ------
    CtcError
        If this viser's requests cannot be checked, or the port is taken.

    """
    access = Access(host, port)
    gate = _RequestGate(access, page, samples)
    with _guarded(gate), redirect_stdout(StringIO()):  # It prints.
        server = PageServer(viser.ViserServer(host, port, verbose=False), access.url)
    try:
        if server.viser.get_port() != port:
            raise CtcError(f'{host}, port {port}: another program uses the port. Choose another '
                           'one with --port N.')
        _check_closed(host, port)
    except CtcError:
        server.stop()
        raise
    return server


@contextmanager
def _guarded(gate: _RequestGate) -> Iterator[None]:
    """Put a gate before the servers that viser starts meanwhile."""
    from websockets.asyncio import server as library
    start = library.serve

    def start_guarded(
        handler: Any, *arguments: Any, process_request: Any = None, **options: Any
    ) -> Any:
        return start(
            partial(gate.handle_connection, handler),
            *arguments,
            process_request=partial(gate.process_request, process_request),
            **options)
    setattr(library, 'serve', start_guarded)  # noqa: B010
    try:
        yield
    finally:
        setattr(library, 'serve', start)  # noqa: B010


def _check_closed(host: str, port: int) -> None:
    """Raise unless page and WebSocket are refused without the token."""
    handshake = {
        'Upgrade': 'websocket',
        'Connection': 'Upgrade',
        'Sec-WebSocket-Version': '13',
        'Sec-WebSocket-Key': 'AAAAAAAAAAAAAAAAAAAAAA=='}
    for headers in ({}, handshake):
        connection = HTTPConnection(_ALL_ADDRESSES.get(host, host), port, timeout=10.0)
        try:
            connection.request('GET', '/', headers=headers)
            status = connection.getresponse().status
        except (OSError, HTTPException) as error:
            raise CtcError(f'{host}, port {port}: {error}') from None
        finally:
            connection.close()
        if status != HTTPStatus.FORBIDDEN:
            import viser
            raise CtcError(
                f'access to viser {viser.__version__} cannot be checked (status {status} without '
                'the token), so the page is not served. Install a version that can be checked: '
                "pip install 'viser>=1.1,<1.2'")


def free_port(host: str, port: int | None) -> int:
    """
    Return the port to listen on.

    Raises
    ------
    CtcError
        If the chosen port is taken, or none is free.

    """
    family = socket.AF_INET6 if ':' in host else socket.AF_INET
    last_port = FIRST_PORT + _PORTS_TRIED - 1
    for number in range(FIRST_PORT, last_port + 1) if port is None else [port]:
        with socket.socket(family) as listener:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                listener.bind((host, number))
                return int(listener.getsockname()[1])
            except (OSError, TypeError, ValueError) as error:  # Odd names raise the latter two.
                reason = getattr(error, 'strerror', None) or str(error)
                if getattr(error, 'errno', None) not in (errno.EADDRINUSE, errno.EACCES):
                    break  # No port of this address is better.
    ports = f'{FIRST_PORT} to {last_port}' if port is None else str(port)
    raise CtcError(f'{host}, port {ports}: {reason}. Choose another one with --port N.')


def is_local(host: str) -> bool:
    """Return whether only this machine reaches an address."""
    with suppress(ValueError):  # It is a name, which may stand for any address.
        return ip_address(host).is_loopback
    return host == 'localhost'


def _bracketed(host: str) -> str:
    """Return an address as URLs have it."""
    return f'[{host}]' if ':' in host else host


def exposure_warning(host: str) -> str:
    """Return a warning if other machines reach an address."""
    if is_local(host):
        return ''
    return (f'the page listens on {host}. The network carries its address with the token without '
            'encryption. Everyone who has it sees the page and, unless --read-only is given, can '
            'change the law and stop the torques.')


@contextmanager
def open_browser(url: str) -> Iterator[bool]:
    """
    Open an address in a browser that has a window.

    Yields whether there is one.

    The browser is given a file that leads to the address. Other users of this machine can read
    the arguments of its process, but not the file, which is removed at the end.
    """
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        browser = None
    # Browsers of this class take the terminal.
    if browser is None or type(browser) is webbrowser.GenericBrowser:
        yield False
        return
    redirect = ('<!DOCTYPE html><meta charset="utf-8">'
                '<meta http-equiv="refresh" content="0; url={{ url }}">')
    with tempfile.TemporaryDirectory(prefix='ctc_live_') as folder:
        page = Path(folder) / 'page.html'
        page.write_text(str(fragment(redirect, url=url)), encoding='utf-8')
        yield browser.open(page.as_uri())
