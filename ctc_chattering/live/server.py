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
viser's server behind checks of every request, of every handshake and of every message.

Whoever has the page's token may open it, under an address of its own (`Access`). At ``/`` is a
page of ours, which frames the scene that viser serves below ``/view/``; ``/samples`` is our
WebSocket.
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
from itertools import chain
from math import isfinite
from pathlib import Path
from secrets import token_urlsafe
import socket
import tempfile
import time
from typing import Any
from urllib.parse import parse_qsl
import webbrowser

from ctc_chattering.analysis.markup import fragment
from ctc_chattering.errors import CtcError
from ctc_chattering.live.page_socket import PageSocket
from ctc_chattering.numerics.leaky_bucket import LeakyBucket
from msgspec import Struct
from msgspec.msgpack import decode
from msgspec.structs import astuple

#: Where the page is by default, and how many ports after it are tried.
HOST, PORT, _TRIED = '127.0.0.1', 8080, 50
#: Patience of the check at the start [s].
_PATIENCE = 10.0
#: Where viser's page is, and our WebSocket.
_VIEW, _SAMPLES = '/view/', '/samples'
#: What a browser opens that must not have the address among its arguments.
_LEADS = ('<!DOCTYPE html><meta charset="utf-8">'
          '<meta http-equiv="refresh" content="0; url={{ url }}">')
#: Addresses that stand for all of this machine.
_ALL = ('', '0.0.0.0', '::')
#: For every answer: no page of others frames this one, and its address is told to nobody.
HEADERS = {
    'Cache-Control': 'no-store', 'Referrer-Policy': 'no-referrer',
    'Content-Security-Policy': "frame-ancestors 'none'; frame-src 'self'; object-src 'none'; "
                               "base-uri 'none'; form-action 'none'"}
#: For viser's view: our page alone frames it, and it frames nothing.
VIEW_HEADERS = {**HEADERS, 'Content-Security-Policy': HEADERS['Content-Security-Policy'].replace(
    "frame-ancestors 'none'; frame-src 'self'", "frame-ancestors 'self'; frame-src 'none'")}


class Access:
    """
    The rule by which a request is answered.

    The browser sends the token of the printed address once, and then the cookie that it gets for
    it, with the handshake of the WebSocket, too. A browser sends cookies to all ports of a host,
    and pages of others can make it send requests: therefore `Origin` must be this page's. A name
    of somebody else's may stand for this machine's address: therefore `Host` must be this page's.

    Parameters
    ----------
    host : str
        Address that is listened on.
    port : int

    Attributes
    ----------
    url : str
        What to open, with the token.
    cookie : str
        What a browser keeps that has opened it: for this port alone, until it is closed.

    """

    def __init__(self, host: str, port: int) -> None:
        self._token = token_urlsafe(32)
        self._port = port
        self._all = host in _ALL
        own = socket.gethostname() if self._all else _bracketed(host)
        self._names = {'localhost', '127.0.0.1', '[::1]', own.lower()}
        self._name = f'ctc_live_{port}'
        self.url = f'http://{own}:{port}/?token={self._token}'
        self.cookie = f'{self._name}={self._token}; Path=/; HttpOnly; SameSite=Strict'

    def refusal(self, path: str, headers: Any, reached: str) -> str:
        """
        Return why a request is not answered, in one line; empty if it is.

        Parameters
        ----------
        path : str
            With its query.
        headers : Headers
            Of websockets: several of one name are several.
        reached : str
            Address of this machine that the request came to.

        """
        host, origin, cookies = (headers.get_all(x) for x in ('Host', 'Origin', 'Cookie'))
        if len(host) != 1 or host[0].lower() not in self._hosts(reached):
            return 'Host is not an address of this page'
        if [x for x in origin if x.lower() != f'http://{host[0].lower()}']:
            return 'Origin is another page'
        query = parse_qsl(path.partition('?')[2], keep_blank_values=True)
        # Others are for the client of viser: `websocket` would connect the page to another server.
        if [x for x in query if x[0] != 'token' and x != ('darkMode', '')]:
            return 'the address takes no more than the token'
        given = [value for name, value in query if name == 'token'] + [
            value for line in cookies for word in line.split(';')
            for name, _, value in [word.strip().partition('=')] if name == self._name]
        if not any(map(self._is_token, given)):
            return 'open the address with the token that ctc live has printed'
        return ''

    def _hosts(self, reached: str) -> set[str]:
        """Return what `Host` may be, for a request that came to an address of this machine."""
        names = self._names | ({_bracketed(_plain(reached))} if self._all else set())
        return {f'{name}:{self._port}' for name in names} | (names if self._port == 80 else set())

    def _is_token(self, text: str) -> bool:
        return compare_digest(text.encode(errors='replace'), self._token.encode())


#: Messages per second that are taken of a page in the long run: more than a slider or a camera
#: that is moved sends. Others wait in the browser.
RATE = 100.0
#: Messages that are taken of a page at once.
BURST = 100.0


def paced(receive: Callable[[], Awaitable[Any]]) -> Callable[[], Awaitable[Any]]:
    """Return a function that receives messages, but no more of them than a page sends."""
    bucket = LeakyBucket(RATE, BURST)

    async def received() -> Any:
        data = await receive()
        await asyncio.sleep(bucket.fill(1.0, time.monotonic()) / RATE)
        return data
    return received


class _Front:
    """Stands before viser's handlers of requests and of connections."""

    def __init__(self, access: Access, page: str, samples: PageSocket) -> None:
        self._access, self._page, self._samples = access, page, samples

    def request(self, answer: Any, connection: Any, request: Any) -> Any:
        """Refuse a request, or answer it as viser does or with our page; None for a handshake."""
        reason = self._access.refusal(request.path, request.headers, connection.local_address[0])
        view = request.path.startswith(_VIEW)
        if reason:
            response = connection.respond(HTTPStatus.FORBIDDEN, f'ctc live: {reason}\n')
        elif 'Upgrade' in request.headers or view:
            request.path = request.path.replace(_VIEW, '/', int(view))
            response = answer(connection, request)
        elif _path(request) == '/':
            response = connection.respond(HTTPStatus.OK, self._page)
            del response.headers['Content-Type']
            response.headers['Content-Type'] = 'text/html; charset=utf-8'
        else:
            response = connection.respond(HTTPStatus.NOT_FOUND, 'ctc live: no such page\n')
        if response is not None:
            if not reason:
                response.headers['Set-Cookie'] = self._access.cookie
            response.headers.update(VIEW_HEADERS if view else HEADERS)
        return response

    async def connection(self, handle: Any, connection: Any) -> None:
        """Serve a connection to us, or have viser serve one that only says where its camera is."""
        receive = connection.recv = paced(connection.recv)
        if _path(connection.request) == _SAMPLES:
            await self._samples.serve(connection)
            return

        async def camera() -> Any:
            while not is_camera(data := await receive()):
                pass
            return data
        connection.recv = camera
        await handle(connection)


class CameraMessage(Struct, tag='ViewerCameraMessage', forbid_unknown_fields=True):
    """All that a browser may say to viser: where its camera is."""

    wxyz: tuple[float, float, float, float]
    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    up_direction: tuple[float, float, float]
    fov: float
    near: float
    far: float
    image_height: float
    image_width: float


def is_camera(data: Any) -> bool:
    """Return whether a message of a browser is a `CameraMessage` of finite numbers."""
    with suppress(Exception):  # Of arbitrary bytes.
        parts = astuple(decode(data, type=CameraMessage))
        return all(map(isfinite, chain.from_iterable(
            x if isinstance(x, tuple) else (x,) for x in parts)))
    return False


def _path(request: Any) -> str:
    return str(request.path.partition('?')[0])


def serve(viser: Any, host: str, port: int, page: str, samples: PageSocket) -> tuple[Any, str]:
    """
    Start viser's server.

    Parameters
    ----------
    viser : module
        Of the library.
    host : str
        Address to listen on.
    port : int
        A free port.
    page : str
        HTML of the page around its scene.
    samples : PageSocket
        Who serves our WebSocket.

    Returns
    -------
    (ViserServer, str)
        The server, and the address to open.

    Raises
    ------
    CtcError
        If the requests of this viser cannot be checked, or the port is taken.

    """
    access = Access(host, port)
    with _behind(_Front(access, page, samples)), redirect_stdout(StringIO()):  # It prints.
        server = viser.ViserServer(host, port, verbose=False)
    try:
        if server.get_port() != port:
            raise CtcError(f'{host}, port {port}: taken; --port N takes another one')
        _check_closed(host, port)
    except CtcError:
        stop(server)
        raise
    return server, access.url


def stop(server: Any) -> None:
    """Stop serving."""
    with suppress(RuntimeError), redirect_stdout(StringIO()):
        server.stop()


@contextmanager
def _behind(front: _Front) -> Iterator[None]:
    """Put a front before what viser starts meanwhile: it has no argument for one."""
    from websockets.asyncio import server as library
    start = library.serve

    def guarded(handle: Any, *arguments: Any, process_request: Any = None, **options: Any) -> Any:
        return start(partial(front.connection, handle), *arguments,
                     process_request=partial(front.request, process_request), **options)
    setattr(library, 'serve', guarded)  # noqa: B010
    try:
        yield
    finally:
        setattr(library, 'serve', start)  # noqa: B010


def _check_closed(host: str, port: int) -> None:
    """Raise unless requests without the token are refused, for the page and for a WebSocket."""
    handshake = {'Upgrade': 'websocket', 'Connection': 'Upgrade', 'Sec-WebSocket-Version': '13',
                 'Sec-WebSocket-Key': 'AAAAAAAAAAAAAAAAAAAAAA=='}
    address = {'0.0.0.0': '127.0.0.1', '': '127.0.0.1', '::': '::1'}.get(host, host)
    for headers in ({}, handshake):
        asked = HTTPConnection(address, port, timeout=_PATIENCE)
        try:
            asked.request('GET', '/', headers=headers)
            status = asked.getresponse().status
        except (OSError, HTTPException) as error:
            raise CtcError(f'{host}, port {port}: {error}') from None
        finally:
            asked.close()
        if status != HTTPStatus.FORBIDDEN:
            import viser
            raise CtcError(
                f'the requests of viser {viser.__version__} cannot be checked (status {status} '
                'without the token), and the page is not served to everyone: '
                "pip install 'viser>=1.1,<1.2'")


def free_port(host: str, port: int | None) -> int:
    """
    Return the port to listen on.

    Raises
    ------
    CtcError
        If the port asked for is taken, or none is free; with the reason.

    """
    for number in [port] if port is not None else range(PORT, PORT + _TRIED):
        with socket.socket(socket.AF_INET6 if ':' in host else socket.AF_INET) as it:
            it.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                it.bind((host, number))
                return int(it.getsockname()[1])
            except (OSError, TypeError, ValueError) as error:  # The latter of odd names.
                reason = getattr(error, 'strerror', None) or str(error)
                if getattr(error, 'errno', errno.EADDRNOTAVAIL) in (
                        errno.EADDRNOTAVAIL, socket.EAI_NONAME):
                    break
    raise CtcError(f'{host}, port {port or f"{PORT} to {PORT + _TRIED - 1}"}: {reason}; '
                   '--port N takes another one')


def is_local(host: str) -> bool:
    """Return whether only this machine reaches an address."""
    with suppress(ValueError):  # A name, that stands for any address.
        return ip_address(host).is_loopback
    return host == 'localhost'


def _bracketed(host: str) -> str:
    return f'[{host}]' if ':' in host else host


def _plain(address: str) -> str:
    """Return an address of IPv4 that comes as one of IPv6 as it is written in a URL."""
    return address.lower().removeprefix('::ffff:').partition('%')[0]


def warning_of(host: str) -> str:
    """Return what it means to listen on an address; empty for this machine's own."""
    if is_local(host):
        return ''
    return (f'listening on {host}: everyone who has the address with its token, which the network '
            'carries without encryption, sees the page and, unless --read-only is given, can '
            'change the law and stop the torques')


@contextmanager
def opened(url: str) -> Iterator[bool]:
    """
    Open an address in a browser with a window of its own; yield whether there is one.

    The browser is given a file that leads to the address: other users of this machine can read
    the arguments of its process, but not the file, which is removed at the end.
    """
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        browser = None
    # The browsers of this class take the terminal.
    if browser is None or type(browser) is webbrowser.GenericBrowser:
        yield False
        return
    with tempfile.TemporaryDirectory(prefix='ctc_live_') as folder:
        page = Path(folder) / 'page.html'
        page.write_text(str(fragment(_LEADS, url=url)), encoding='utf-8')
        yield browser.open(page.as_uri())
