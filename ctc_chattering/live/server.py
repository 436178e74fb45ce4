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
viser's server behind a door: every request and every message of a browser is checked.

At ``/`` is a page of ours, which frames what viser serves below ``/view/``; ``/samples`` is our
WebSocket.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from http import HTTPStatus
from http.client import HTTPConnection, HTTPException
import inspect
from io import StringIO
from typing import Any

from ctc_chattering.errors import CtcError
from ctc_chattering.live.access import Access, HEADERS, VIEW_HEADERS
from ctc_chattering.live.client_messages import is_allowed
from ctc_chattering.live.samples_socket import SamplesSocket

#: Patience of the check at the start [s].
_PATIENCE = 10.0
#: Where viser's page is, and our WebSocket.
_VIEW, _SAMPLES = '/view/', '/samples'


class _Door:
    """What is put around viser's handlers of requests and of connections."""

    def __init__(self, access: Access, page: str, samples: SamplesSocket) -> None:
        self._access, self._page, self._samples = access, page, samples
        #: The page's inputs by their identifiers; none before there is a page.
        self.widgets: Callable[[], Any] = dict

    def request(self, answer: Callable[..., Any] | None) -> Callable[..., Awaitable[Any]]:
        """Return a `process_request` that refuses, or answers as viser does."""
        async def checked(connection: Any, request: Any) -> Any:
            reason = self._access.refusal(
                request.path, request.headers, connection.local_address[0])
            view = request.path.startswith(_VIEW)
            if reason:
                response = connection.respond(HTTPStatus.FORBIDDEN, f'ctc live: {reason}\n')
            elif 'Upgrade' in request.headers or view:
                request.path = request.path.replace(_VIEW, '/', int(view))
                response = answer(connection, request) if answer is not None else None
                if inspect.isawaitable(response):
                    response = await response
            else:
                response = self._own(connection, request)
            if response is not None:
                if not reason:
                    response.headers['Set-Cookie'] = self._access.cookie
                response.headers.update(VIEW_HEADERS if view else HEADERS)
            return response
        return checked

    def connection(self, handle: Callable[[Any], Awaitable[None]]
                   ) -> Callable[[Any], Awaitable[None]]:
        """Return a handler of connections that receives messages only that are allowed."""
        async def checked(connection: Any) -> None:
            if _path(connection.request) == _SAMPLES:
                await self._samples.serve(connection)
                return
            receive = connection.recv

            async def allowed() -> Any:
                while True:
                    data = await receive()
                    if self._is_allowed(data):
                        return data
            connection.recv = allowed
            await handle(connection)
        return checked

    def _own(self, connection: Any, request: Any) -> Any:
        """Return the page around viser's view; nothing else is ours."""
        if _path(request) != '/':
            return connection.respond(HTTPStatus.NOT_FOUND, 'ctc live: no such page\n')
        response = connection.respond(HTTPStatus.OK, self._page)
        del response.headers['Content-Type']
        response.headers['Content-Type'] = 'text/html; charset=utf-8'
        return response

    def _is_allowed(self, data: Any) -> bool:
        from msgspec.msgpack import decode
        with suppress(Exception):  # Of arbitrary bytes.
            return is_allowed(decode(data), self.widgets())
        return False


def _path(request: Any) -> str:
    return str(request.path.partition('?')[0])


def serve(viser: Any, host: str, port: int, title: str, page: str = '',
          samples: SamplesSocket | None = None) -> tuple[Any, str]:
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
    title : str
        Of viser's view.
    page : str
        HTML of the page around it.
    samples : SamplesSocket, optional
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
    door = _Door(access, page, samples or SamplesSocket())
    with _behind(door), redirect_stdout(StringIO()):  # It prints its address in a frame.
        server = viser.ViserServer(host, port, label=title, verbose=False)
    try:
        if server.get_port() != port:
            raise CtcError(f'{host}, port {port}: taken; --port N takes another one')
        _check_closed(host, port)
        inputs = server.gui._gui_input_handle_from_uuid
    except (AttributeError, CtcError) as error:
        stop(server)
        if isinstance(error, CtcError):
            raise
        raise CtcError(_not_checked(str(error))) from None
    door.widgets = lambda: inputs
    return server, access.url


def stop(server: Any) -> None:
    """Stop serving."""
    with suppress(RuntimeError), redirect_stdout(StringIO()):
        server.stop()


@contextmanager
def _behind(door: _Door) -> Iterator[None]:
    """Have what viser starts meanwhile stand behind a door."""
    from websockets.asyncio import server as library
    start = library.serve

    def guarded(handler: Any, *arguments: Any, **options: Any) -> Any:
        options['process_request'] = door.request(options.get('process_request'))
        return start(door.connection(handler), *arguments, **options)
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
            raise CtcError(_not_checked(f'status {status} without the token'))


def _not_checked(what: str) -> str:
    import viser
    return (f'the requests of viser {viser.__version__} cannot be checked ({what}), and the page '
            "is not served to everyone: pip install 'viser>=1.1,<1.2'")
