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

"""The light; signals of the last seconds; the WebSocket of samples and words."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
import dataclasses
import json
import time
from typing import Any

from ctc_chattering.live.graph_reader import Track
from ctc_chattering.live.health import Light, light, NodeReport, SIGNALS, SIGNS
from ctc_chattering.live.page_socket import PageSocket, word
from ctc_chattering.live.server import BURST, paced, RATE
import numpy as np
import pytest
from stopwatch import PATIENCE
from websockets.asyncio.client import connect
from websockets.asyncio.server import serve
from websockets.exceptions import ConnectionClosed

#: Levels of the light.
OK, WARN, ERROR, UNKNOWN, ENDED = range(5)
REPORTS = {node: NodeReport(OK, 'running', 0.4) for node in SIGNALS}
HEARD = dict.fromkeys(SIGNALS.values(), 0.05)


def test_green_when_all_three_run_and_are_heard() -> None:
    assert light(REPORTS, HEARD).level == OK
    assert light({}, {}).level == UNKNOWN
    assert len({sign[0] for sign in SIGNS}) == 5, 'levels are told apart without colour'


@pytest.mark.parametrize('node', SIGNALS)
def test_not_green_without_one_of_them(node: str) -> None:
    less = {name: report for name, report in REPORTS.items() if name != node}
    assert light(less, HEARD).level == UNKNOWN
    assert f'{node}: not heard yet' in light(less, HEARD).lines
    other = next(name for name in SIGNALS if name != node)
    assert light(less | {other: NodeReport(ERROR, 'why', 0.4)}, HEARD).level == ERROR
    for level in (WARN, ERROR, 3):
        found = light(REPORTS | {node: NodeReport(level, 'why', 0.4)}, HEARD)
        assert found.level == min(level, ERROR)
        assert f'{node}: why' in found.lines
    old = dataclasses.replace(REPORTS[node], age=3.0)
    assert light(REPORTS | {node: old}, HEARD).level == ERROR


@pytest.mark.parametrize('topic', SIGNALS.values())
def test_not_green_when_a_topic_falls_silent(topic: str) -> None:
    """Check that it is seen within a second, long before the next report is overdue."""
    found = light(REPORTS, HEARD | {topic: 0.6})
    assert found.level == ERROR
    assert any(topic in line and '0.6 s' in line for line in found.lines)
    never = {name: age for name, age in HEARD.items() if name != topic}
    assert light(REPORTS, never).level == UNKNOWN
    assert light(REPORTS, HEARD | {topic: 0.6}, patience={topic: 1.0}).level == OK


def test_simulated_time_may_stand_still() -> None:
    assert light(REPORTS, dict.fromkeys(HEARD, 60.0), lockstep=True).level == WARN


def test_says_what_ended_and_why() -> None:
    """Check one node, all of them, by their own words or by silence, and what bringup says."""
    def ended(why: str, age: float) -> NodeReport:
        return NodeReport(OK, f'ended: {why}', age, {'ended': why})
    now = time.mktime((2026, 1, 2, 12, 0, 10, 0, 0, -1))
    one = light(REPORTS | {'controller': ended('SIGINT', 1.0)}, HEARD, now=now)
    assert one.level == ERROR
    assert 'controller: ended at 12:00:09: SIGINT' in one.lines
    dead = {node: dataclasses.replace(report, age=age)
            for (node, report), age in zip(REPORTS.items(), (4.2, 6.0, 4.9))}
    quiet = dict(zip(HEARD, (4.0, 5.0, 4.5)))
    assert light(dead, quiet, now=now) == Light(ENDED, (
        'controller: silent since 12:00:05', 'reference: silent since 12:00:05',
        'plant: silent since 12:00:06'))
    over = light(dead | {'plant': ended('the experiment has ended', 3.0)}, quiet, now=now)
    assert over.lines[-1] == 'plant: ended at 12:00:07: the experiment has ended'
    whole = light(REPORTS | {'bringup': ended('stopped by SIGINT', 0.1)}, HEARD, now=now)
    assert whole == Light(ENDED, ('bringup: stopped by SIGINT',))


def unpacked(message: bytes) -> tuple[dict[str, Any], dict[str, list[list[float]]]]:
    """Return head and columns of a message as plots.js reads it."""
    size = int.from_bytes(message[:4], 'little')
    head = json.loads(message[4:4 + size])
    at = -(-(4 + size) // 8) * 8
    columns: dict[str, list[list[float]]] = {}
    for name, _, length in head['columns']:
        values = np.frombuffer(message, f'<f{length}', head['count'], at)
        columns.setdefault(name, []).append(values.tolist())
        at += -(-length * head['count'] // 8) * 8
    assert at == len(message)
    return head, columns


def test_pages_get_each_sample_once_and_all_where_time_begins_again() -> None:
    track, got = Track(q=2, e=1), []
    for k in range(25):
        track.add(1e9 + k / 1000, np.array([k, 3.0 + 1e-9 * k, 1e-9 * k]))
        track.add(1e9 + k / 1000, np.full(3, 9.0))  # The same sample again.
        if k % 10 == 4:
            head, columns = unpacked(track.packed(1e9))
            assert head['fresh'] == (k == 4)
            got += columns['t'][0]
            assert columns['q'][1][-1] == 3.0 + 1e-9 * k
            assert columns['e'][0][-1] == pytest.approx(1e-9 * k, rel=1e-6)
            assert track.packed(1e9) == b''
    assert got == pytest.approx(np.arange(25) / 1000, abs=2e-7)
    assert unpacked(track.packed(1e9 - 5.0))[0] == {
        'count': 25, 'columns': [['t', 0, 8], ['q', 0, 8], ['q', 1, 8], ['e', 0, 4]], 'run': 0,
        'fresh': True}


def test_keeps_no_more_rows_than_it_may_and_begins_again_where_time_does() -> None:
    track = Track(most=100, q=1)
    assert track.packed(0.0) == b''
    for k in range(12345):
        track.add(k, np.array([float(k)]))
    expected = list(map(float, range(12245, 12345)))
    for fresh in (False, True):  # Pages that missed some, and a new one.
        assert unpacked(track.packed(0.0, fresh))[1] == {'t': [expected], 'q': [expected]}
    track.clear()
    assert track.packed(0.0) == b''
    for t in (5.0, 6.0, 0.0, 0.5):
        track.add(t, np.array([t]))
    head, columns = unpacked(track.packed(0.0))
    assert head['fresh']
    assert columns['t'] == [[0.0, 0.5]]


def check(steps: Callable[[PageSocket, str], Awaitable[None]]) -> None:
    """Run steps against a socket that is served, with its address."""
    async def run() -> None:
        samples = PageSocket()

        async def paced_page(connection: Any) -> None:
            connection.recv = paced(connection.recv)
            await samples.serve(connection)
        async with serve(paced_page, '127.0.0.1', 0, compression=None) as server:
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
            samples.poll(lambda: (word(show=1), b'all'))
            samples.send(b'new')
            async with connect(url) as second:
                await until(lambda: len(samples._clients) == 2)
                samples.poll(lambda: (b'all, later',))
                samples.tell(mark=0.5)
                assert [await first.recv() for _ in range(4)] == [
                    '{"show":1}', b'all', b'new', '{"mark":0.5}']
                assert [await second.recv() for _ in range(2)] == [b'all, later', '{"mark":0.5}']
        await until(lambda: not samples.watched)
        samples.send(b'to nobody')
    check(steps)


def test_what_is_no_word_of_a_subject_is_ignored_and_too_much_of_it_ends_the_connection() -> None:
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
            await until(lambda: len(samples._clients) == 2)
            slow.transport.pause_reading()
            for k in range(400):
                samples.send(b'%4d' % k + bytes(100_000))
                assert (await other.recv())[:4] == b'%4d' % k
            slow.transport.resume_reading()
            samples.tell(mark=1.0)
            got = 0
            while await slow.recv() != '{"mark":1.0}':
                got += 1
            assert 0 < got < 400
    check(steps)


def test_no_more_is_taken_of_a_page_than_a_user_sends() -> None:
    async def steps(samples: PageSocket, url: str) -> None:
        heard: list[Any] = []
        samples.on('seek', float, heard.append)
        begin = time.monotonic()
        async with connect(url) as flooding, connect(url) as other:
            async def flood() -> None:
                for _ in range(round(2.0 * BURST)):
                    await flooding.send('{"seek": 1.0}')

            task = asyncio.create_task(flood())

            def polled() -> bool:
                samples.poll(tuple)
                return len(heard) > 1.5 * BURST
            await until(polled)
            await other.send('{"seek": 2.0}')
            while 2.0 not in heard:
                await asyncio.sleep(0.002)
                samples.poll(tuple)
            assert heard.count(1.0) <= BURST + RATE * (time.monotonic() - begin) + 1
            await task
    check(steps)
