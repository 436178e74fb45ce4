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

"""Numbers of serialized messages are those that rosbags reads from each of them."""

from __future__ import annotations

from typing import Any

from ctc_chattering.bags.cdr_columns import blocks, field_names
from ctc_chattering.bags.definitions import Definitions, Field, parsed
from motion_bags import joint_state, torques
import numpy as np
import pytest
from robot_messages import FRANKA_STATE, franka_state, STORE, TRAJECTORY_STATE, trajectory_state

STATE = 'sensor_msgs/msg/JointState'
RNG = np.random.default_rng(1)


def known(kind: str) -> Definitions:
    return parsed(STORE.generate_msgdef(kind, ros_version=2)[0], kind)


def serialized(messages: list[Any]) -> list[bytes]:
    return [bytes(STORE.serialize_cdr(x, x.__msgtype__)) for x in messages]


def numbers(data: list[bytes], kind: str, field: str) -> dict[int, Any]:
    """Return the numbers of a field by the number of the message."""
    return {int(k): row for block in blocks(data, kind, known(kind), [field])
            for k, row in zip(block.place, block.numbers.get(field, np.empty((10 ** 6, 0))))}


def test_layouts_that_change_within_a_series() -> None:
    """Names of equal length, other lengths, other counts, and nothing at all."""
    q = RNG.normal(size=(60, 5))
    names = [('a', 'b'), ('b', 'a'), ('elbow', 'b'), ('x', 'y', 'z'), ()]
    messages = [joint_state(k, names[k % 5], q[k, :len(names[k % 5])], None,
                            q[k, :len(names[k % 5])]) for k in range(60)]
    found: dict[int, tuple[tuple[str, ...], Any]] = {}
    for block in blocks(serialized(messages), STATE, known(STATE), ['effort', 'position']):
        rows = block.numbers.get('effort', np.empty((len(block.place), 0)))
        found.update({int(k): (block.names.get('name', ()), row)
                      for k, row in zip(block.place, rows)})
    assert sorted(found) == list(range(60))
    for k, message in enumerate(messages):
        assert found[k][0] == tuple(message.name)
        assert found[k][1] == pytest.approx(message.effort)


def test_nested_fields_and_numbers_of_all_sizes() -> None:
    q, dq, tau, desired = RNG.normal(size=(4, 7))
    names = [f'joint{k}' for k in range(7)]
    data = serialized([franka_state(5 * 10 ** 9 + 7, names, q, dq, tau, desired)])
    for field, wanted in (
            ('header.stamp.sec', [5]), ('header.stamp.nanosec', [7]), ('robot_mode', [2]),
            ('measured_joint_state.velocity', dq), ('desired_joint_state.effort', desired),
            ('collision_indicators.is_joint_collision', np.zeros(7))):
        assert numbers(data, FRANKA_STATE, field)[0] == pytest.approx(wanted)
    data = serialized([trajectory_state(0, names, q, dq, tau)])
    assert numbers(data, TRAJECTORY_STATE, 'output.effort')[0] == pytest.approx(tau)
    assert numbers(data, TRAJECTORY_STATE, 'speed_scaling_factor')[0] == pytest.approx([1.0])
    counts = field_names(data[0], TRAJECTORY_STATE, known(TRAJECTORY_STATE))
    assert counts['feedback.positions'] == 7


def test_big_endian() -> None:
    message = torques(np.array([1.5, -2.5]), ('a', 'bcd'))
    data = bytes(STORE.serialize_cdr(message, message.__msgtype__, little_endian=False))
    (block,) = blocks([data], message.__msgtype__, known(message.__msgtype__), ['data'])
    assert block.numbers['data'].tolist() == [[1.5, -2.5]]
    assert block.names == {'layout.dim.label': ('a', 'bcd')}


def test_what_cannot_be_decoded_is_left_out() -> None:
    good = serialized([joint_state(0, ('a',), np.ones(1), None, None)])[0]
    bad = [b'', b'\0', good[:30], b'\1\2' + good[2:], good[:20] + b'\xff' * 8 + good[28:]]
    assert list(numbers([*bad, good], STATE, 'position')) == [len(bad)]
    # A type whose definition ends in one that is not known can be read up to there.
    whole = known(FRANKA_STATE)
    cut = {**whole, FRANKA_STATE: (
        *whole[FRANKA_STATE][:4], Field('errors', 'franka_msgs/msg/Errors', None))}
    data = serialized([franka_state(0, [f'j{k}' for k in range(7)], *RNG.normal(size=(4, 7)))])
    (block,) = blocks(data, FRANKA_STATE, cut, ['measured_joint_state.effort'])
    assert block.numbers['measured_joint_state.effort'].shape == (1, 7)
    assert list(blocks(data, FRANKA_STATE, cut, ['ddq_d'])) == []
