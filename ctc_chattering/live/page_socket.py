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
The WebSocket between the page around viser's view and this process: samples and words.

Samples are binary messages, as `analysis/signals.py` packs them, whose head names their
run (``run``) and whether they begin a new one (``fresh``). Words are JSON objects as text; each
key is a subject of its own with its receiver.

To the page (live/web/page.js):

- ``show``: {``joints``, ``units``, ``runs``: [{``name``, ``laws``: [[time, law], ...]}, ...],
  ``options`` of plots.js, ``time``: first and last one of bags [s], ``note``: what is drawn}; the
  plots are made anew
- ``mark``: time of the arm that is shown [s], of bags
- ``silent``: for how long nothing was heard of a graph [s]; the numbers are shown anew
- ``light``, ``reports``, ``answers``: see web/status.js
- ``controls``: what `Controls.state` returns
- ``scene``: other arms are shown: the page answers with the shape of its view
- ``ended``: how the graph has ended; empty while it has not

From the page:

- what `Controls` takes, by its subjects
- ``seek``: time to show [s]
- ``magnify``: what errors are multiplied by where the ghost is drawn
- ``fit``: have the cameras show the arms
- ``aspect``: width of the view as a part of its height; ``moved``: its camera was moved by hand
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
import json
from queue import Empty, SimpleQueue
from typing import Any

from msgspec import convert, MsgspecError, ValidationError
from msgspec.json import decode

Message = str | bytes
#: Longest message from a page [characters].
_LONGEST = 10_000
#: Messages that wait for a slow page; samples beyond are not sent, and the lines have gaps.
_WAITING = 200
#: Reason of the end for a message that is too long, as the standard has it.
_TOO_LONG = 1009


class _Client:
    """One open page."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._queue: asyncio.Queue[Iterable[Message]] = asyncio.Queue()

    def put(self, messages: Iterable[Message]) -> None:
        """Have messages sent, from any thread."""
        with suppress(RuntimeError):  # The loop has ended.
            self._loop.call_soon_threadsafe(self._queue.put_nowait, messages)

    @property
    def slow(self) -> bool:
        """Whether many messages wait."""
        return self._queue.qsize() > _WAITING

    async def send_to(self, connection: Any) -> None:
        while True:
            for message in await self._queue.get():
                await connection.send(message)


class PageSocket:
    """
    All open pages.

    The server calls `serve` in its own thread. Everything else is for the thread of the page,
    which calls `poll` now and then.
    """

    def __init__(self) -> None:
        self._clients: set[_Client] = set()
        self._joined: SimpleQueue[_Client] = SimpleQueue()
        self._heard: SimpleQueue[Mapping[str, Any]] = SimpleQueue()
        self._receivers: dict[str, tuple[Any, Callable[[Any], None]]] = {}
        #: The last words of each subject.
        self._told: dict[str, str] = {}

    @property
    def watched(self) -> bool:
        """Whether a page is open."""
        return bool(self._clients)

    async def serve(self, connection: Any) -> None:
        """Serve one page until it is closed."""
        from websockets.exceptions import ConnectionClosed
        client = _Client()
        self._clients.add(client)
        self._joined.put(client)
        sender = asyncio.create_task(client.send_to(connection))
        try:
            async for data in connection:
                if len(data) > _LONGEST:
                    await connection.close(_TOO_LONG, f'more than {_LONGEST} characters')
                    break
                self.hear(data)
        except ConnectionClosed:
            pass
        finally:
            self._clients.discard(client)
            sender.cancel()
            await asyncio.gather(sender, return_exceptions=True)

    def hear(self, data: Message) -> None:
        """Keep a message for `poll` if it can be one of the page."""
        with suppress(MsgspecError, RecursionError, UnicodeError):
            self._heard.put(decode(data if isinstance(data, str) else '', type=dict[str, Any]))

    def on(self, subject: str, kind: Any, receive: Callable[[Any], None]) -> None:
        """
        Have words of a subject received, in `poll`, if they are of a type, as msgspec has it.

        Anybody who has the token can send them: whoever receives checks all that is no type.
        """
        self._receivers[subject] = kind, receive

    def poll(self, greeting: Callable[[], Iterable[Message]]) -> None:
        """
        Pass on what has come, and send new pages what `greeting` returns.

        What it yields, if it is a generator, it yields in the thread of the server.
        """
        with suppress(Empty):
            while True:
                self._joined.get_nowait().put((*greeting(), *self._told.values()))
        with suppress(Empty):
            while True:
                heard = self._heard.get_nowait()
                for subject in heard.keys() & self._receivers.keys():
                    kind, receive = self._receivers[subject]
                    try:
                        value = convert(heard[subject], kind)
                    except ValidationError:
                        continue  # Of no page of ours.
                    receive(value)

    def tell(self, **words: Any) -> None:
        """Send words to all pages, each by its subject, and to new ones; the same only once."""
        for subject, value in words.items():
            message = word(**{subject: value})
            if self._told.get(subject) != message:
                self._told[subject] = message
                self.send(message)

    def send(self, message: Message) -> None:
        """Send a message to all pages."""
        for client in tuple(self._clients):
            if isinstance(message, str) or not client.slow:
                client.put((message,))


def word(**words: Any) -> str:
    """Return words as a message."""
    return json.dumps(words, allow_nan=False, separators=(',', ':'))
