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

"""Who may open the page: whoever has its token, under an address of its own."""

from __future__ import annotations

from contextlib import suppress
from hmac import compare_digest
from ipaddress import ip_address
import re
from secrets import token_urlsafe
import socket
from typing import Any
from urllib.parse import parse_qsl

#: Addresses that stand for all of this machine.
_ALL = ('', '0.0.0.0', '::')
#: What the client of viser takes from its address that shows nothing but the arm: view.js.
_VIEW = re.compile('darkMode|logCamera|initialCamera(Position|LookAt|Up|Fov|Near|Far)')
_NUMBERS = re.compile('[-+.,e0-9]{0,80}')
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
        if [name for name, value in query if name != 'token' and not (
                _VIEW.fullmatch(name) and _NUMBERS.fullmatch(value))]:
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
