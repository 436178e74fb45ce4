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

"""Bags of joint states and commanded torques as any recorder makes them, without any node."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

_STORE = get_typestore(Stores.ROS2_JAZZY)
_TYPES = {name: _STORE.types[name] for name in (
    'sensor_msgs/msg/JointState', 'std_msgs/msg/Float64MultiArray', 'std_msgs/msg/String',
    'std_msgs/msg/Header', 'std_msgs/msg/MultiArrayLayout', 'std_msgs/msg/MultiArrayDimension',
    'builtin_interfaces/msg/Time')}


def joint_state(t: int, names: Sequence[str], q: Array, dq: Array | None, effort: Array | None
                ) -> Any:
    """Return a JointState with the stamp t [ns]."""
    stamp = _TYPES['builtin_interfaces/msg/Time'](sec=t // 10 ** 9, nanosec=t % 10 ** 9)
    none = np.zeros(0)
    return _TYPES['sensor_msgs/msg/JointState'](
        header=_TYPES['std_msgs/msg/Header'](stamp=stamp, frame_id=''), name=list(names),
        position=np.array(q, float), velocity=none if dq is None else np.asarray(dq, float),
        effort=none if effort is None else np.asarray(effort, float))


def torques(values: Array, names: Sequence[str] = ()) -> Any:
    """Return commanded torques, with names or without."""
    labels = [_TYPES['std_msgs/msg/MultiArrayDimension'](label=name, size=1, stride=1)
              for name in names]
    layout = _TYPES['std_msgs/msg/MultiArrayLayout'](dim=labels, data_offset=0)
    return _TYPES['std_msgs/msg/Float64MultiArray'](layout=layout, data=np.array(values, float))


def write(path: Path, messages: Sequence[tuple[str, int, Any]],
          storage: StoragePlugin = StoragePlugin.MCAP, typestore: Any = _STORE,
          compression: str = '') -> Path:
    """
    Write messages (topic, log time [ns], message) into a bag.

    Parameters
    ----------
    path : Path
        The bag's directory.
    messages : sequence of (str, int, message)
        In any order.
    storage : StoragePlugin
        MCAP or sqlite3.
    typestore : Typestore
        Types of the messages.
    compression : {'', 'message', 'file', 'storage'}
        What zstd compresses.

    """
    writer = Writer(path, version=9, storage_plugin=storage)
    if compression:
        writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    with writer:
        connections: dict[tuple[str, str], Any] = {}
        for topic, t, message in messages:
            kind = message.__msgtype__
            if (topic, kind) not in connections:
                connections[topic, kind] = writer.add_connection(topic, kind, typestore=typestore)
            writer.write(connections[topic, kind], t, typestore.serialize_cdr(message, kind))
    return path


def messages_of(t: Array, names: Sequence[str], q: Array, dq: Array | None,
                effort: Array | None, command: Array | None, order: Sequence[int] | None = None,
                extra: Sequence[str] = (), labels: bool = True, urdf: str = ''
                ) -> list[tuple[str, int, Any]]:
    """
    Return what a robot and its controller send.

    The states have the joints in `order`, after `extra` ones; a command is 0.2 ms after its state.
    """
    picked = list(order or range(len(names)))
    theirs = [*extra, *(names[i] for i in picked)]
    more = np.full(len(extra), 0.3)

    def row(values: Array | None, k: int) -> Array | None:
        return None if values is None else np.concatenate((more, values[k][picked]))
    found: list[tuple[str, int, Any]] = []
    if urdf:
        found.append(('/robot_description', 0, _TYPES['std_msgs/msg/String'](data=urdf)))
    for k, time in enumerate(t):
        at = round(time * 1e9) + 10 ** 9
        place = row(q, k)
        assert place is not None
        found.append(('/joint_states', at, joint_state(
            at, theirs, place, row(dq, k), row(effort, k))))
        if command is not None:
            found.append(('/effort_controller/commands', at + 200_000, torques(
                command[k], names if labels else ())))
    return found
