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

"""The WebSocket of samples and requests: greetings, order, slow and hostile pages."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
import json
import time
from typing import Any

from ctc_chattering.live.page_socket import encode_message, PageSocket
from ctc_chattering.live.server import limit_rate, MESSAGE_BURST, MESSAGE_RATE_HZ
import pytest
from stopwatch import PATIENCE
from websockets.asyncio.client import connect
from websockets.asyncio.server import serve
from websockets.exceptions import ConnectionClosed


def check(steps: Callable[[PageSocket, str], Awaitable[None]]) -> None:
    """Run steps against a socket that is served, with its address."""
    async def run() -> None:
        samples = PageSocket()

        async def limited_page(connection: Any) -> None:
            connection.recv = limit_rate(connection.recv)
            await samples.serve(connection)
        async with serve(limited_page, '127.0.0.1', 0, compression=None) as server:
            url = f'ws://127.0.0.1:{server.sockets[0].getsockname()[1]}'
            await asyncio.wait_for(steps(samples, url), PATIENCE)
    asyncio.run(run())


async def until(done: Callable[[], Any]) -> None:
    while not done():
        await asyncio.sleep(0.002)


def test_a_new_page_gets_the_greeting_and_every_page_what_follows() -> None:
    async def steps(samples: PageSocket, url: str) -> None:
        async with connect(url) as first:
            await until(lambda: samples.watched)
            samples.poll(lambda: (encode_message(show=1), b'all'))
            samples.broadcast(b'new')
            async with connect(url) as second:
                await until(lambda: len(samples._connections) == 2)
                samples.poll(lambda: (b'all, later',))
                samples.send(mark=0.5)
                assert [await first.recv() for _ in range(4)] == [
                    '{"show":1}', b'all', b'new', '{"mark":0.5}']
                assert [await second.recv() for _ in range(2)] == [b'all, later', '{"mark":0.5}']
        await until(lambda: not samples.watched)
        samples.broadcast(b'to nobody')
    check(steps)


def test_malformed_requests_are_ignored_and_a_too_long_one_ends_the_connection() -> None:
    async def steps(samples: PageSocket, url: str) -> None:
        heard: list[Any] = []
        samples.on('seek', float, heard.append)
        async with connect(url) as page:
            for data in ('', '{', '[1]', 'null', '"seek"', b'{"seek": 1}', b'\xff', '{"other": 1}',
                         '[' * 9000, '{"seek": NaN}', '{"seek": "1"}', '{"seek": true}',
                         '{"seek": null}', f'{{"seek": {10 ** 400}}}',
                         json.dumps({'seek': 2.5, 'other': {}})):
                await page.send(data)

            def polled() -> bool:
                samples.poll(tuple)
                return 2.5 in heard
            await until(polled)
            assert heard == [2.5]
            await page.send(json.dumps({'seek': 'x' * 10_000}))
            with pytest.raises(ConnectionClosed) as closed:
                await page.recv()
            assert closed.value.rcvd is not None
            assert closed.value.rcvd.code == 1009
        samples.poll(tuple)
        assert heard == [2.5]
    check(steps)


def test_a_page_that_does_not_read_loses_samples_and_holds_up_nobody() -> None:
    async def steps(samples: PageSocket, url: str) -> None:
        async with connect(url, max_queue=1) as slow, connect(url) as other:
            await until(lambda: len(samples._connections) == 2)
            slow.transport.pause_reading()
            for k in range(400):
                samples.broadcast(b'%4d' % k + bytes(100_000))
                assert (await other.recv())[:4] == b'%4d' % k
            slow.transport.resume_reading()
            samples.send(mark=1.0)
            got = 0
            while await slow.recv() != '{"mark":1.0}':
                got += 1
            assert 0 < got < 400
    check(steps)


def test_a_flood_of_one_page_holds_up_no_other() -> None:
    async def steps(samples: PageSocket, url: str) -> None:
        heard: list[Any] = []
        samples.on('seek', float, heard.append)
        begin = time.monotonic()
        async with connect(url) as flooding, connect(url) as other:
            async def flood() -> None:
                for _ in range(round(2.0 * MESSAGE_BURST)):
                    await flooding.send('{"seek": 1.0}')

            task = asyncio.create_task(flood())

            def polled() -> bool:
                samples.poll(tuple)
                return len(heard) > 1.5 * MESSAGE_BURST
            await until(polled)
            await other.send('{"seek": 2.0}')
            while 2.0 not in heard:
                await asyncio.sleep(0.002)
                samples.poll(tuple)
            duration = time.monotonic() - begin
            assert heard.count(1.0) <= MESSAGE_BURST + MESSAGE_RATE_HZ * duration + 1
            await task
    check(steps)
