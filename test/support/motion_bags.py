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

"""Messages and bags of joint states and torques as any recorder makes them, without any node."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ctc_chattering.numerics.linear_algebra import Array
from mcap.writer import Writer as McapWriter
import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

#: The types of all messages, to which tests may add.
STORE = get_typestore(Stores.ROS2_JAZZY)
S = 10 ** 9


def made(kind: str, **fields: Any) -> Any:
    """Return a message of a type, `package/msg/Name`."""
    return STORE.types[kind](**fields)


def header(t: int, frame: str = '') -> Any:
    """Return a header with the stamp t [ns]."""
    stamp = made('builtin_interfaces/msg/Time', sec=t // S, nanosec=t % S)
    return made('std_msgs/msg/Header', stamp=stamp, frame_id=frame)


def row(values: Any) -> Array:
    """Return numbers as a message has them; None stands for none."""
    return np.zeros(0) if values is None else np.array(values, float)


def joint_state(t: int, names: Sequence[str], q: Array, dq: Array | None, effort: Array | None
                ) -> Any:
    """Return a JointState with the stamp t [ns]."""
    return made('sensor_msgs/msg/JointState', header=header(t), name=list(names),
                position=row(q), velocity=row(dq), effort=row(effort))


def torques(values: Any, names: Sequence[str] = ()) -> Any:
    """Return commanded torques, with names or without."""
    labels = [made('std_msgs/msg/MultiArrayDimension', label=name, size=1, stride=1)
              for name in names]
    return made('std_msgs/msg/Float64MultiArray', data=row(values), layout=made(
        'std_msgs/msg/MultiArrayLayout', dim=labels, data_offset=0))


def string(text: str) -> Any:
    return made('std_msgs/msg/String', data=text)


def point(t: int, *rows: Any) -> Any:
    """Return a point of a trajectory at t [ns]: positions, velocities, accelerations, efforts."""
    fields = ('positions', 'velocities', 'accelerations', 'effort')
    return made('trajectory_msgs/msg/JointTrajectoryPoint', time_from_start=made(
        'builtin_interfaces/msg/Duration', sec=t // S, nanosec=t % S), **{
            name: row(x) for name, x in zip(fields, (*rows, None, None, None))})


def trajectory(t: int, names: Sequence[str], points: Sequence[Any]) -> Any:
    """Return a JointTrajectory with the stamp t [ns]."""
    return made('trajectory_msgs/msg/JointTrajectory', header=header(t), joint_names=list(names),
                points=list(points))


def serialized(message: Any, order: str = '<') -> bytes:
    """Return the CDR of a message, in either byte order."""
    return bytes(STORE.serialize_cdr(
        message, message.__msgtype__, little_endian=order == '<'))


def write(path: Path, messages: Sequence[tuple[str, int, Any]],
          storage: StoragePlugin = StoragePlugin.MCAP, compression: str = '') -> Path:
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
                connections[topic, kind] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic, kind], t, serialized(message))
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

    def mine(values: Array | None, k: int) -> Any:
        return None if values is None else np.concatenate((more, values[k][picked]))
    found: list[tuple[str, int, Any]] = []
    if urdf:
        found.append(('/robot_description', 0, string(urdf)))
    for k, time in enumerate(t):
        at = round(time * 1e9) + S
        found.append(('/joint_states', at, joint_state(
            at, theirs, mine(q, k), mine(dq, k), mine(effort, k))))
        if command is not None:
            found.append(('/effort_controller/commands', at + 200_000, torques(
                command[k], names if labels else ())))
    return found


def write_defined(path: Path, topic: str, definition: str, messages: Mapping[int, bytes],
                  encoding: str = 'ros2msg') -> None:
    """Write messages of the type `my_msgs/msg/Thing`, by log times [ns], and its definition."""
    with path.open('wb') as stream:
        writer = McapWriter(stream)
        writer.start('ros2')
        schema = writer.register_schema('my_msgs/msg/Thing', encoding, definition.encode())
        channel = writer.register_channel(topic, 'cdr', schema)
        for t, data in messages.items():
            writer.add_message(channel, t, data, t)
        writer.finish()  # type: ignore[no-untyped-call]
