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

"""Definitions of types, and messages decoded by them, compared with rosbags."""

from __future__ import annotations

import random
from typing import Any

from ctc_chattering.bags.cdr_message import decoded
from ctc_chattering.bags.definitions import definitions, installed_definition, parsed
from ctc_chattering.errors import CtcError
import numpy as np
import pytest
from rosbags.typesys import get_typestore, Stores

STORE: Any = get_typestore(Stores.ROS2_JAZZY)
RANDOM = random.Random(1)
ODD = """# A comment, of float64 a
int32 LARGE = 5
string  TEXT="b # no comment"
bool[<=3] flags
Other[2] others   # another
uint8 x 7
string<=4[] names ["a", "b"]
my_msgs/Other other
wstring wide
"""


def field_of(item: Any) -> tuple[str, int | None]:
    """Return type and count of a field as rosbags describes it."""
    node, detail = int(item[0]), item[1]
    if node <= 2:
        return (detail[0] if node == 1 else detail), None
    return field_of(detail[0])[0], detail[1] if node == 3 else 0


def theirs(kind: str) -> list[tuple[str, str, int | None]]:
    return [(name, *field_of(item)) for name, item in STORE.fielddefs[kind][1]]


@pytest.mark.parametrize('source', ['bag', 'installed'])
def test_every_type_of_jazzy_has_the_fields_that_rosbags_finds(source: str) -> None:
    checked = 0
    for kind in STORE.fielddefs:
        try:
            text = installed_definition(kind) if source == 'installed' else (
                STORE.generate_msgdef(kind, ros_version=2)[0])
        except CtcError:
            continue  # Its package is not on PyPI.
        for name, fields in parsed(text, kind).items():
            assert [tuple(x) for x in fields] == theirs(name), name
        checked += 1
    assert checked > 150


def test_constants_bounds_defaults_and_comments() -> None:
    found = parsed(f'{ODD}\n{"=" * 80}\nMSG: my_msgs/Other\n', 'my_msgs/msg/Thing')
    assert [tuple(x) for x in found['my_msgs/msg/Thing']] == [
        ('flags', 'bool', 0), ('others', 'my_msgs/msg/Other', 2), ('x', 'uint8', None),
        ('names', 'string', 0), ('other', 'my_msgs/msg/Other', None), ('wide', 'wstring', None)]
    # A message without fields has one byte.
    assert [x.kind for x in found['my_msgs/msg/Other']] == ['uint8']


def test_idl_by_rosbags_and_what_is_not_known() -> None:
    idl = ('module my_msgs { module msg { struct Thing { std_msgs::msg::Header header; '
           'sequence<double> x; }; }; };')
    text = '=' * 80 + '\nIDL: my_msgs/msg/Thing\n' + idl
    for given in (idl, text):
        found = definitions('my_msgs/msg/Thing', 'ros2idl', given)
        if given == idl:
            assert [x.name for x in found['my_msgs/msg/Thing']] == ['header', 'x']
            assert found['builtin_interfaces/msg/Time']
    assert definitions('my_msgs/msg/Thing', '', '') == {}
    assert definitions('os.path/msg/Thing', '', '') == {}
    assert definitions('sensor_msgs/msg/JointState', '', '') != {}
    # What a definition lacks is taken from what is installed.
    assert 'builtin_interfaces/msg/Time' in definitions(
        'my_msgs/msg/Thing', 'ros2msg', 'std_msgs/Header header')


def value(item: Any) -> Any:
    """Return a random value of a field."""
    kind, count = field_of(item)
    if count is None:
        if kind in STORE.fielddefs:
            return message(kind)
        if kind == 'string':
            return ''.join(RANDOM.choices('abä', k=RANDOM.randrange(4)))
        if kind == 'bool':
            return bool(RANDOM.getrandbits(1))
        return float(np.float32(RANDOM.random())) if 'float' in kind else RANDOM.randrange(99)
    found = [value(item[1][0]) for _ in range(count or RANDOM.randrange(4))]
    if kind in STORE.fielddefs or kind == 'string':
        return found
    return np.array(found, {'byte': 'u1', 'char': 'u1', 'octet': 'u1'}.get(kind, kind))


def message(kind: str) -> Any:
    return STORE.types[kind](**{name: value(item) for name, item in STORE.fielddefs[kind][1]})


def same(found: Any, expected: Any) -> bool:
    if isinstance(expected, list):
        return len(found) == len(expected) and all(map(same, found, expected))
    if isinstance(expected, np.ndarray):
        return np.array_equal(found, expected)
    if kind := getattr(expected, '__msgtype__', ''):
        return all(same(getattr(found, name), getattr(expected, name))
                   for name, _ in STORE.fielddefs[kind][1])
    return type(found) is type(expected) and bool(found == expected)


@pytest.mark.parametrize('is_little', [True, False])
def test_random_messages(is_little: bool) -> None:
    for kind in list(STORE.fielddefs)[is_little::4]:
        sent = message(kind)
        data = bytes(STORE.serialize_cdr(sent, kind, little_endian=is_little))
        types = parsed(STORE.generate_msgdef(kind, ros_version=2)[0], kind)
        assert same(decoded(data, kind, types), sent), kind


def test_no_bytes_make_a_message_up() -> None:
    kind = 'sensor_msgs/msg/JointState'
    types = parsed(installed_definition(kind), kind)
    state = message(kind)
    state.name, state.position = ['elbow', 'wrist'], np.ones(2)
    data = bytes(STORE.serialize_cdr(state, kind))
    for end in range(len(data) - 8 * len(state.effort) - 4):
        with pytest.raises(Exception, match=''):
            decoded(data[:end], kind, types)
    with pytest.raises(CtcError, match='not CDR'):
        decoded(b'\1\2' + data[2:], kind, types)
