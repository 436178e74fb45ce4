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

"""Signals are the values of some joints, of messages that have each of them once."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
import struct
from typing import Any

from bags import Entry, write_bag
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.bags.signals import (
    JOINT_STATE,
    MULTI_ARRAY,
    read_signals,
    Signal,
    SignalTopic,
)
from ctc_chattering.errors import CtcError
from motion_bags import joint_state, serialized, torques, write_defined
import numpy as np
import pytest

NAMES = ['a', 'finger', 'long_name_of_b']
JOINTS = ('long_name_of_b', 'a')
RNG = np.random.default_rng(3)


def state(k: int, names: list[str] = NAMES) -> Any:
    return joint_state(10 ** 18 + 7 * k, names, *RNG.normal(size=(3, len(names))))


def read(path: Path, messages: list[Any], joints: tuple[str, ...] = JOINTS) -> Signal:
    write_bag(path, [Entry('/joint_states', 10 ** 6 * k, x) for k, x in enumerate(messages)])
    with closing(open_bag(path)) as bag:
        return SignalTopic(bag, 'joint_states', JOINT_STATE, ('position', 'velocity'),
                           tuple(bag.connections)).read(joints)


def test_values_stand_in_the_order_of_the_joints(tmp_path: Path) -> None:
    """Check names in several orders, and messages in the other order of bytes."""
    messages = [state(0), state(1, NAMES[::-1]), state(2), state(3)]
    found: list[Any] = [*messages[:3], (JOINT_STATE, serialized(messages[3], '>'))]
    signal = read(tmp_path / 'bag', found)
    assert signal.logged.tolist() == [0, 10 ** 6, 2 * 10 ** 6, 3 * 10 ** 6]
    assert signal.stamps.tolist() == [10 ** 18 + 7 * k for k in range(4)]
    for field, values in zip(('position', 'velocity'), signal.values):
        for message, row in zip(messages, values):
            by_name = dict(zip(message.name, getattr(message, field).tolist()))
            assert row.tolist() == [by_name[x] for x in JOINTS]


@pytest.mark.parametrize('message', [
    state(0, ['a', 'finger', 'nothing_else_']), joint_state(1, ['a', 'a', 'long_name_of_b'],
                                                            *np.ones((3, 3))),
    (JOINT_STATE, b'\0\1\0\0'), (JOINT_STATE, b'\0\1\0\0' + bytes(9))],
    ids=['joint missing', 'one joint twice', 'empty', 'cut'])
def test_other_messages_are_left_out(tmp_path: Path, message: Any) -> None:
    signal = read(tmp_path / 'bag', [state(0), message, state(2)])
    assert signal.stamps.tolist() == [10 ** 18, 10 ** 18 + 14]


def test_messages_alike_are_read_at_once_to_the_last_bit(tmp_path: Path) -> None:
    """Check also that a name of the same length, and bytes of another order, are noticed."""
    messages = [state(k) for k in range(40)]
    blocks = {
        'alike': messages,
        'another name': [*messages, state(40, ['a', 'finger', 'another_name__'])],
        'another length': [*messages, state(40, [*NAMES, 'one_more'])],
        'other bytes': [*messages, (JOINT_STATE, serialized(state(40), '>'))]}
    at_once = {}
    for case, block in blocks.items():
        path = tmp_path / case
        write_bag(path, [Entry('/joint_states', 10 ** 6 * k, x) for k, x in enumerate(block)])
        with closing(open_bag(path)) as bag:
            topic = SignalTopic(bag, 'joint_states', JOINT_STATE, ('position', 'velocity'),
                                tuple(bag.connections))
            contents = [(t, x) for _, t, x in bag.messages()]
            at_once[case] = topic._read_alike(contents, JOINTS)
            one_by_one = topic._read_each(contents, JOINTS)
            np.testing.assert_equal(topic.read(JOINTS), one_by_one)
    assert [case for case, signal in at_once.items() if signal is not None] == ['alike']
    np.testing.assert_equal(at_once['alike'], read(tmp_path / 'bag', messages))
    found = at_once['alike']
    assert found is not None and found.stamps.tolist() == [10 ** 18 + 7 * k for k in range(40)]
    assert found.values[1].tolist() == [[x.velocity[2], x.velocity[0]] for x in messages]


RULE = '=' * 80
#: Definitions of other distributions, with the layout of a message.
HEADERS = {
    'number in front': (
        'uint32 seq\nbuiltin_interfaces/Time stamp\nstring frame_id', '<4s4xiII4sId'),
    'time the other way round': (
        'builtin_interfaces/Time stamp\nstring frame_id\n'
        f'{RULE}\nMSG: builtin_interfaces/Time\nuint32 nanosec\nint32 sec', '<4sIiI4sI4xd')}


@pytest.mark.parametrize('kind', HEADERS)
def test_stamps_of_a_header_that_the_bag_defines(tmp_path: Path, kind: str) -> None:
    """They are not where ROS 2 Jazzy has them."""
    header, layout = HEADERS[kind]
    definition = f'std_msgs/Header header\nfloat64[] x\n{RULE}\nMSG: std_msgs/Header\n{header}\n'
    times = [(k, 0) if kind == 'number in front' else (0, k) for k in range(3)]
    write_defined(tmp_path / 'file.mcap', '/row', definition, {
        k: struct.pack(layout, b'\0\1\0\0', *time, 1, b'', 1, 0.5 * k)
        for k, time in enumerate(times)})
    with closing(open_bag(tmp_path / 'file.mcap')) as bag:
        connections = tuple(bag.named('row'))
        signal = SignalTopic(bag, 'row', 'my_msgs/msg/Thing', ('x',), connections).read(('a',))
    assert signal.stamps.tolist() == [0, 10 ** 9, 2 * 10 ** 9]
    assert signal.values[0].tolist() == [[0.0], [0.5], [1.0]]


def test_a_field_that_a_message_lacks_is_nan(tmp_path: Path) -> None:
    signal = read(tmp_path / 'bag', [
        state(0), joint_state(1, NAMES, np.ones(3), None, None), state(2)])
    assert np.isnan(signal.values[1]).all(axis=1).tolist() == [False, True, False]
    assert signal.select_finite().stamps.tolist() == [10 ** 18, 10 ** 18 + 14]


def test_values_without_names_are_those_of_the_joints(tmp_path: Path) -> None:
    """Check also that a field without numbers is named."""
    write_bag(tmp_path / 'bag', [Entry('/commands', k, torques([k, -k])) for k in range(5)])
    with closing(open_bag(tmp_path / 'bag')) as bag:
        topic = SignalTopic(bag, 'commands', MULTI_ARRAY, ('data',), tuple(bag.connections))
        assert topic.read(JOINTS).values[0].tolist() == [[k, -k] for k in range(5)]
        assert topic.read_layout() == ((), 2)
        with pytest.raises(CtcError, match=r'commands has no numbers in datum; it has: .*data'):
            topic._replace(fields=('datum',)).read_layout()


def test_topics_are_read_in_one_pass_as_each_by_itself(tmp_path: Path) -> None:
    """Check also a topic without messages."""
    entries = [Entry('/joint_states', 10 ** 6 * k, state(k)) for k in range(40)]
    entries += [Entry('/commands', 10 ** 6 * k, torques([k, -k])) for k in range(5, 30)]
    write_bag(tmp_path / 'bag', sorted(entries, key=lambda x: x.t))
    with closing(open_bag(tmp_path / 'bag')) as bag:
        requests = [
            (SignalTopic(bag, name, message_type, fields, tuple(bag.named(name))), JOINTS)
            for name, message_type, fields in (
                ('joint_states', JOINT_STATE, ('position', 'velocity')),
                ('commands', MULTI_ARRAY, ('data',)),
                ('nothing', MULTI_ARRAY, ('data',)))]
        signals = read_signals(bag, requests)
        assert [len(x.logged) for x in signals] == [40, 25, 0]
        np.testing.assert_equal(signals, [topic.read(JOINTS) for topic, _ in requests])
