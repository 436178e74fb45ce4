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

At ``/`` is a page of ours, which frames the scene that viser serves below ``/view/``; ``/samples``
is our WebSocket.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
import errno
from functools import partial
from http import HTTPStatus
from http.client import HTTPConnection, HTTPException
from io import StringIO
from itertools import chain
from math import isfinite
from pathlib import Path
import socket
import tempfile
from typing import Any
import webbrowser

from ctc_chattering.analysis.markup import fragment
from ctc_chattering.errors import CtcError
from ctc_chattering.live.access import Access, HEADERS, is_local, VIEW_HEADERS
from ctc_chattering.live.page_socket import PageSocket
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
        if _path(connection.request) == _SAMPLES:
            await self._samples.serve(connection)
            return
        receive = connection.recv

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
