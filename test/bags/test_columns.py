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

"""Messages as columns are what the reader of single messages reads, or there are no columns."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from bags import Entry, write_bag
from ctc_chattering.bags.columns import Columns, ColumnSink, joint_values, read_topics
from ctc_chattering.bags.motion import JOINT_STATE, MULTI_ARRAY, SignalTopic
from ctc_chattering.bags.repair import open_bag
from motion_bags import joint_state, serialized, torques
import numpy as np
import pytest

NAMES, FIELDS = ['a', 'finger', 'long_name_of_b'], ('position', 'velocity')
JOINTS = ('long_name_of_b', 'a')
RNG = np.random.default_rng(3)


def state(k: int, names: list[str] = NAMES) -> Any:
    return joint_state(10 ** 18 + 7 * k, names, *RNG.normal(size=(3, len(names))))


def as_it_is(message: Any) -> Any:
    return message


def with_any_bytes_between(message: Any) -> tuple[str, bytes]:
    """Return a message with bytes for alignment as other writers have them."""
    data, zeros = bytearray(serialized(message)), serialized(message)
    other = joint_state(1, ['a', 'finger', 'long_name_of_b'], *np.ones((3, 3)))
    assert len(serialized(other)) == len(zeros)
    at = zeros.index(b'a\0') + 2
    data[at:at + 2] = b'xy'
    return message.__msgtype__, bytes(data)


def big_endian(message: Any) -> tuple[str, bytes]:
    return message.__msgtype__, serialized(message, '>')


def read(path: Path, found: list[Any]) -> tuple[Columns | None, Any]:
    """Return what is read at once, and message by message."""
    write_bag(path, [Entry('/joint_states', 10 ** 6 * k, x) for k, x in enumerate(found)])
    with closing(open_bag(path)) as bag:
        sink = ColumnSink('joint_states', JOINT_STATE, joint_values(FIELDS, JOINTS))
        read_topics(bag, [sink])
        return sink.columns(), SignalTopic(
            bag, 'joint_states', JOINT_STATE, FIELDS, tuple(bag.connections)).read(JOINTS)


@pytest.mark.parametrize('how', [as_it_is, with_any_bytes_between])
def test_columns_are_the_values_of_the_messages(
        tmp_path: Path, how: Callable[[Any], Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Check it also where they are read block by block."""
    monkeypatch.setattr('ctc_chattering.bags.columns._BLOCK', 7)
    columns, one_by_one = read(tmp_path / 'bag', [how(state(k)) for k in range(20)])
    assert columns is not None
    assert columns.logged.tolist() == one_by_one.logged.tolist()
    assert columns.stamps.tolist() == one_by_one.stamps.tolist() == [
        10 ** 18 + 7 * k for k in range(20)]
    for i, values in enumerate(one_by_one.values):
        assert columns.values[:, i].tobytes() == values.tobytes()


@pytest.mark.parametrize('found', [
    [], [big_endian(state(0))], [state(0), state(1, NAMES[:2])], [state(0), state(1, NAMES[::-1])],
    [state(0, ['a', 'finger', 'nothing_else_'])],
    [state(0), (JOINT_STATE, b'\0\1\0\0' + bytes(9))],
    [(JOINT_STATE, b'\0\1\0\0')], [joint_state(1, NAMES, np.ones(3), None, None)],
    [joint_state(1, ['a', 'a', 'long_name_of_b'], *np.ones((3, 3)))]],
    ids=['none', 'order of bytes', 'other joints', 'other order', 'joint missing', 'cut', 'empty',
         'no velocity', 'one joint twice'])
def test_messages_of_no_one_layout_have_no_columns(tmp_path: Path, found: list[Any]) -> None:
    columns, _ = read(tmp_path / 'bag', [x for message in found for x in (message, message)])
    assert columns is None


def test_topics_are_read_together(tmp_path: Path) -> None:
    """Check a topic of another type with the same name, and commands without names."""
    found = [Entry('/joint_states', k, state(k)) for k in range(3)]
    found += [Entry('/other/joint_states', k, torques([k])) for k in range(3)]
    found += [Entry('/commands', k, torques([k, -k])) for k in range(5)]
    write_bag(tmp_path / 'bag', found)
    with closing(open_bag(tmp_path / 'bag')) as bag:
        states = ColumnSink('joint_states', JOINT_STATE, joint_values(FIELDS, JOINTS))
        commands = ColumnSink('commands', MULTI_ARRAY, joint_values(('data',), JOINTS))
        read_topics(bag, [states, commands])
    both = states.columns(), commands.columns()
    assert both[0] is not None and both[1] is not None
    assert len(both[0].stamps) == 3
    assert both[1].values[:, 0].tolist() == [[k, -k] for k in range(5)]
