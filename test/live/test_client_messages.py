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

"""What one browser sends cannot break the page of the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import math
from types import SimpleNamespace
from typing import Any

from ctc_chattering.live.client_messages import fits, is_allowed
from ctc_chattering.live.page import free_port, require_viser
from ctc_chattering.live.server import serve, stop
import msgspec
import pytest
from websockets.sync.client import connect

STEPS = SimpleNamespace(value=1, min=1, max=100_000, disabled=False)
TORQUE = SimpleNamespace(value=50.0, min=None, max=None, disabled=False)
LASTS = SimpleNamespace(value=0.2, min=0.0, max=10.0, disabled=False)
LAW = SimpleNamespace(value='chattering', options=('chattering', 'compensation'), disabled=False)
TEXT = SimpleNamespace(value='', disabled=False)
BUTTON = SimpleNamespace(value=False, disabled=False)
OFF = SimpleNamespace(value=False, disabled=True)
WIDGETS = {'steps': STEPS, 'law': LAW, 'text': TEXT, 'off': OFF}
ODD: list[Any] = [None, [], {}, [1.0], 'nan', '1', b'1', math.nan, math.inf, -math.inf, 2**64,
                  10**400, {'value': 1}]


@pytest.mark.parametrize(('widget', 'good', 'bad'), [
    (STEPS, [1, 7, 7.0, 100_000], [0, -1, 1.5, 100_001, 1e300, True, *ODD]),
    (TORQUE, [-1e9, 0, 0.5], [True, *ODD[:9], 10**400, {'value': 1}]),
    (LASTS, [0, 0.0, 10, 10.0], [-1e-9, 10.1, 1e300, False, *ODD]),
    (LAW, ['compensation'], ['other', '', 0, True, *ODD]),
    (TEXT, ['', 'nan', '<b>', 'x' * 10_000], ['x' * 10_001, 1, True, *ODD[:4], *ODD[6:]]),
    (BUTTON, [True, False], [0, 1, 'true', *ODD])])
def test_a_widget_has_values_of_its_kind_within_its_limits(
        widget: Any, good: list[Any], bad: list[Any]) -> None:
    assert [x for x in good if not fits(widget, x)] == []
    assert [x for x in bad if fits(widget, x)] == []


def test_only_what_the_page_can_send_is_allowed() -> None:
    update = {'type': 'GuiUpdateMessage', 'uuid': 'law', 'updates': {'value': 'compensation'}}
    camera = {'type': 'ViewerCameraMessage', 'wxyz': [1.0, 0, 0, 0], 'fov': 1, 'near': 0.1,
              'far': 10, 'image_height': 500, 'image_width': 400, 'position': [1.0, 2, 3],
              'look_at': [0, 0, 0], 'up_direction': [0, 0, 1.0]}
    assert is_allowed(update, WIDGETS)
    assert is_allowed(camera, WIDGETS)
    others: tuple[dict[str, Any], ...] = (
        {'uuid': 'none'}, {'uuid': ['law']}, {'uuid': None}, {'updates': {}},
        {'updates': ['value']}, {'updates': {'value': 'compensation', 'removed': True}},
        {'updates': {'sync_cb': None}}, {'updates': {'options': ['x']}}, {'more': 1},
        {'uuid': 'off', 'updates': {'value': True}}, {'type': 'ShareUrlRequest'},
        {'type': 'FileTransferStartUpload'}, {'type': 'GuiFormDirtyMessage'}, {'type': 1})
    for other in others:
        assert not is_allowed({**update, **other}, WIDGETS)
    for wrong in (math.nan, math.inf, 'x', [math.nan] * 3, [1] * 5, [[1]], None, 1.0, [1, 2]):
        assert not is_allowed({**camera, 'position': wrong}, WIDGETS)
    assert not is_allowed({**camera, 'more': 1}, WIDGETS)
    assert not is_allowed({k: v for k, v in camera.items() if k != 'far'}, WIDGETS)
    messages: tuple[Any, ...] = (None, 1, 'x', [], {}, [update])
    assert [x for x in messages if is_allowed(x, WIDGETS)] == []


@pytest.fixture(scope='module')
def page() -> Iterator[tuple[Any, Callable[[], Any]]]:
    """Yield a served page with one number, and what opens a connection to it."""
    viser = require_viser()
    server, url = serve(viser, '127.0.0.1', free_port('127.0.0.1', 0), 'test')
    number = server.gui.add_number('samples', 1, min=1, max=100_000, step=1)
    protocol: Any = [f'viser-v{viser.__version__}']
    yield number, lambda: connect(url.replace('http', 'ws'), subprotocols=protocol)
    stop(server)


def said(it: Any, wanted: str) -> None:
    """Wait until the server has said something."""
    import zstandard
    while True:
        data = it.recv(timeout=30.0)
        size = int.from_bytes(data[8:16], 'little')
        if wanted in str(msgspec.msgpack.decode(
                zstandard.ZstdDecompressor().decompress(data[16:16 + size]))):
            return


def test_a_hostile_browser_does_not_disturb_the_next_one(page: Any) -> None:
    """Check after 1e300 for a whole number, which no message to a later browser can contain."""
    number, opened = page

    def update(**updates: Any) -> bytes:
        return msgspec.msgpack.encode({
            'type': 'GuiUpdateMessage', 'uuid': number._impl.uuid, 'updates': updates})
    with opened() as hostile:
        for data in (update(value=1e300), update(value='x'), update(value=math.nan),
                     update(value=7, removed=True), update(update_cb=None), b'', b'\xc1',
                     b'\x91' * 100_000, 'text',
                     msgspec.msgpack.encode({'type': 'ShareUrlRequest'})):
            hostile.send(data)
        hostile.send(update(value=8))
        with opened() as other:
            said(other, "'samples'")
            hostile.send(update(value=9))
            said(other, "{'value': 9}")
    assert number.value == 9
