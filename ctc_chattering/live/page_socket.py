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
WebSocket between this process and our pages in browsers.

`server.py` hands each connection to a `PageSocket`. `Page`, `GraphPage`, `BagPage` and `Controls`
send through it, and receive what users ask for.

Samples are binary messages of `analysis.signals.packed`. Everything else is a JSON object as text.
Each key is a subject with a receiver of its own.

To the page (live/web/page.js):

- ``show``: joints, units, runs, note, time range and options of new plots
- ``mark``: the time at which recorded arms are shown [s]
- ``silent``: the time since the graph's last message [s], at which numbers are updated
- ``light``, ``reports``, ``answers``: see web/status.js
- ``controls``: `Controls.state`
- ``scene``: other arms are shown, and the page answers with the shape of its view
- ``ended``: a line on the graph's end, or an empty one

From the page:

- the requests that `Controls` registers
- ``seek``: the time to show [s]
- ``magnify``: the factor on the error with which the ghost is drawn
- ``fit``: cameras are to show the arms
- ``aspect``: width over height of the view
- ``moved``: the user moved the camera
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
import json
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from msgspec import convert, MsgspecError, ValidationError
from msgspec.json import decode

Message = str | bytes
Item = TypeVar('Item')
#: Longest message that a page may send [characters].
_MAX_LENGTH = 10_000
#: Samples for a page are dropped while more than this waits for it [bytes]. Its lines have gaps.
_MAX_WAITING_BYTES = 4_000_000


class PageSocket:
    """
    Connections of all open pages.

    The server calls `serve` in its own thread. All other methods are for the thread of the page.
    """

    def __init__(self) -> None:
        self._connections: set[Any] = set()
        self._joined: SimpleQueue[Any] = SimpleQueue()
        self._requests: SimpleQueue[Mapping[str, Any]] = SimpleQueue()
        self._receivers: dict[str, tuple[Any, Callable[[Any], None]]] = {}
        #: The last message about each subject.
        self._last_sent: dict[str, str] = {}
        self._loop: Any = None

    @property
    def watched(self) -> bool:
        """Return whether a page is open."""
        return bool(self._connections)

    async def serve(self, connection: Any) -> None:
        """Serve a page until it is closed."""
        from websockets.exceptions import ConnectionClosed
        from websockets.frames import CloseCode

        self._loop = asyncio.get_running_loop()
        self._connections.add(connection)
        self._joined.put(connection)
        try:
            async for message in connection:
                if len(message) > _MAX_LENGTH:
                    reason = f'more than {_MAX_LENGTH} characters'
                    await connection.close(CloseCode.MESSAGE_TOO_BIG, reason)
                    break
                self.on_message(message)
        except ConnectionClosed:
            pass
        finally:
            self._connections.discard(connection)

    def on_message(self, message: Message) -> None:
        """Keep a message for `poll` if it is an object in JSON."""
        if isinstance(message, str):
            with suppress(MsgspecError, RecursionError, UnicodeError):
                self._requests.put(decode(message, type=dict[str, Any]))

    def on(self, subject: str, value_type: Any, receive: Callable[[Any], None]) -> None:
        """
        Register the receiver of a subject.

        `poll` calls it with values of `value_type`, which msgspec checks. Anybody with the token
        can send them, so the receiver checks what a type cannot express.
        """
        self._receivers[subject] = value_type, receive

    def poll(self, greet: Callable[[], Iterable[Message]]) -> None:
        """Send new pages what `greet` returns, and pass on requests."""
        for connection in _taken(self._joined):
            for message in (*greet(), *self._last_sent.values()):
                self._transmit([connection], message)
        for request in _taken(self._requests):
            for subject in request.keys() & self._receivers.keys():
                value_type, receive = self._receivers[subject]
                try:
                    value = convert(request[subject], value_type)
                except ValidationError:
                    continue  # It is not one of our pages.
                receive(value)

    def send(self, **values: Any) -> None:
        """Send values by subject to all pages, also to later ones."""
        for subject, value in values.items():
            message = encode_message(**{subject: value})
            if self._last_sent.get(subject) != message:
                self._last_sent[subject] = message
                self.broadcast(message)

    def broadcast(self, message: Message) -> None:
        """
        Send a message to the open pages.

        Slow ones do not get samples.
        """
        self._transmit(tuple(self._connections), message, skip_slow=isinstance(message, bytes))

    def _transmit(
        self, connections: Iterable[Any], message: Message, skip_slow: bool = False
    ) -> None:
        """Send a message in the server's thread."""
        if self._loop is not None:
            with suppress(RuntimeError):  # The server has stopped.
                self._loop.call_soon_threadsafe(_write, connections, message, skip_slow)


def _write(connections: Iterable[Any], message: Message, skip_slow: bool) -> None:
    """Write a message to connections, none of which waits for another."""
    from websockets.asyncio.server import broadcast

    broadcast([
        connection
        for connection in connections
        if not (skip_slow and _waiting_bytes(connection) > _MAX_WAITING_BYTES)
    ], message)


def _waiting_bytes(connection: Any) -> int:
    return int(connection.transport.get_write_buffer_size())


def _taken(queue: SimpleQueue[Item]) -> Iterator[Item]:
    """Yield the items that wait in a queue."""
    with suppress(Empty):
        while True:
            yield queue.get_nowait()


def encode_message(**values: Any) -> str:
    """Return values by subject as a message."""
    return json.dumps(values, allow_nan=False, separators=(',', ':'))
