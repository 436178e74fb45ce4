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

"""Messages by hand, and bags of a run such as the recorder makes them, without any node."""

from __future__ import annotations

from array import array
import bisect
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path
import struct
from typing import Any, NamedTuple

from ctc_chattering.analysis.result import Result
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.bags.writer import BagWriter, offered_qos
from ctc_chattering.parameters import Config
from ctc_chattering.ros.topics import DIAGNOSTICS
from ctc_chattering.simulation.closed_loop import Run
import numpy as np
import numpy.typing as npt
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from recorded_runs import FIELDS
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

Rows = Sequence[Sequence[float]]
Row = npt.NDArray[np.float64]


class Cdr:
    """A message written by hand as the OMG's CDR has it, in either byte order."""

    padding = b'\0'

    def __init__(self, order: str = '<') -> None:
        self.order = order
        self.data = bytearray(b'\0\1\0\0' if order == '<' else b'\0\0\0\0')

    def put(self, form: str, *values: float) -> Cdr:
        for value in values:
            self.data += self.padding * ((4 - len(self.data)) % struct.calcsize(form))
            self.data += struct.pack(self.order + form, value)
        return self

    def text(self, value: str) -> Cdr:
        self.put('I', len(value) + 1).data += value.encode() + b'\0'
        return self

    def texts(self, values: Sequence[str]) -> Cdr:
        self.put('I', len(values))
        for value in values:
            self.text(value)
        return self

    def row(self, values: Sequence[float]) -> Cdr:
        return self.put('I', len(values)).put('d', *values)

    def header(self, t: tuple[int, int], frame: str) -> Cdr:
        return self.put('i', t[0]).put('I', t[1]).text(frame)


def state(names: Sequence[str], rows: Rows, t: tuple[int, int] = (3, 4), frame: str = '',
          order: str = '<') -> bytes:
    cdr = Cdr(order).header(t, frame).texts(names)
    for row in rows:
        cdr.row(row)
    return bytes(cdr.data)


def efforts(names: Sequence[str], values: Sequence[float], order: str = '<') -> bytes:
    cdr = Cdr(order).put('I', len(names))
    for name in names:
        cdr.text(name).put('I', 1, 1)
    return bytes(cdr.put('I', 0).row(values).data)


def chunk(names: Sequence[str], points: Sequence[tuple[Rows, int, int]],
          t: tuple[int, int] = (3, 4), frame: str = '', order: str = '<') -> bytes:
    cdr = Cdr(order).header(t, frame).texts(names).put('I', len(points))
    for rows, sec, nanosec in points:
        for row in rows:
            cdr.row(row)
        cdr.put('i', sec).put('I', nanosec)
    return bytes(cdr.data)


class Entry(NamedTuple):
    """A message and where it belongs."""

    topic: str
    kind: str
    t: int
    message: Any


def nanoseconds(t: float) -> int:
    return round(t * 1e9)


def stamped(message: Any, t: int) -> Any:
    stamp = message.stamp if hasattr(message, 'stamp') else message.header.stamp
    stamp.sec, stamp.nanosec = divmod(t, 10 ** 9)
    return message


def parameters(node: str, t: int, values: dict[str, Any], first: bool) -> Entry:
    """Return the parameters of a node's parameters."""
    items = [Parameter(name, value=list(value) if isinstance(value, tuple) else value)
             .to_parameter_msg() for name, value in values.items()]
    event = ParameterEvent(node=f'/{node}')
    setattr(event, 'new_parameters' if first else 'changed_parameters', items)
    return Entry(f'/{node}/parameters', 'rcl_interfaces/msg/ParameterEvent', t, stamped(event, t))


def joint_state(t: int, names: Sequence[str], q: Row, dq: Row, effort: Row) -> Entry:
    message = JointState(name=list(names), position=array('d', q), velocity=array('d', dq),
                         effort=array('d', effort))
    return Entry('/joint_states', 'sensor_msgs/msg/JointState', t, stamped(message, t))


def command(t: int, names: Sequence[str], tau: Row) -> Entry:
    message = Float64MultiArray(data=array('d', tau))
    message.layout.dim = [MultiArrayDimension(label=name, size=1, stride=1) for name in names]
    return Entry('/effort_controller/commands', 'std_msgs/msg/Float64MultiArray', t, message)


def reference(times: Sequence[int], names: Sequence[str], rows: Sequence[Sequence[Row]]) -> Entry:
    """Return a chunk of the motion from its instants and its (q_d, dq_d, ddq_d)."""
    message = JointTrajectory(joint_names=list(names))
    for t, (q, dq, ddq) in zip(times, rows):
        point = JointTrajectoryPoint(positions=array('d', q), velocities=array('d', dq),
                                     accelerations=array('d', ddq))
        after = point.time_from_start
        after.sec, after.nanosec = divmod(t - times[0], 10 ** 9)
        message.points.append(point)
    return Entry('/reference', 'trajectory_msgs/msg/JointTrajectory', times[0],
                 stamped(message, times[0]))


def entries(result: Result, plant: Config, start: int = 0, order: Sequence[int] = (0, 1),
            extra: Sequence[str] = (), chunk: int = 25) -> list[Entry]:
    """
    Return what the nodes send in lockstep, from simulated time `start` [ns] on.

    States and commands have the joints in `order`, the states `extra` ones in front; the reference
    has them the other way round, in chunks of so many points.
    """
    run, names = result.run, result.joint_names
    ours = [names[i] for i in order]
    theirs = [*extra, *ours]
    times = [start + nanoseconds(t) for t in run.t]
    n, back = len(names), list(range(len(names)))[::-1]
    found = [parameters('plant', start, plant.as_mapping(), True)]
    for i in range(0, len(times), chunk):
        rows = [[x[k][back] for x in (run.q_d, run.dq_d, run.ddq_d)]
                for k in range(i, min(i + chunk, len(times)))]
        found.append(reference(times[i:i + chunk], [names[k] for k in back], rows))
    due = list(result.configs)
    old: dict[str, Any] = {}
    applied = np.zeros(n)
    for k, t in enumerate(times):
        q, dq, effort = (np.concatenate([np.full(len(extra), 7.7), x[list(order)]])
                         for x in (run.q[k], run.dq[k], applied))
        found.append(joint_state(t, theirs, q, dq, effort))
        found.append(command(t, ours, run.tau[k][list(order)]))
        applied = run.tau[k]
        while due and start + nanoseconds(due[0][0]) <= t:
            new = due.pop(0)[1].as_mapping()
            changed = {key: value for key, value in new.items() if old.get(key) != value}
            found.append(parameters('controller', t, changed, not old))
            old = new
    return found


def serialized(message: Any) -> bytes:
    """
    Return a message as it goes over the serialization.

    rclpy's `serialize_message` leaves as many bytes of junk at the end as it reckoned too much.
    """
    data = bytes(serialize_message(message))

    def whole(end: int) -> bool:
        try:
            return bool(deserialize_message(data[:end], type(message)) == message)
        except RuntimeError:
            return False
    return data[:bisect.bisect_left(range(len(data)), True, key=whole)]


def write_bag(path: Path, found: Iterable[Entry], namespace: str = '') -> dict[str, int]:
    """Record messages as the recorder does; return how many there are by topic."""
    recording = BagWriter(path)
    profiles = [offered_qos(100, latched) for latched in (False, True)]
    for topic, kind, t, message in found:
        data = message if isinstance(message, bytes) else serialized(message)
        profile = profiles[topic.endswith('/parameters')]
        recording.write(namespace + topic, kind, t, data, profile)
    recording.close()
    return recording.counts


def same(a: Run, b: Run, but: Sequence[str] = ()) -> None:
    """Assert that two runs are equal to the last bit."""
    for name in FIELDS:
        if name not in but:
            x, y = getattr(a, name), getattr(b, name)
            assert x.shape == y.shape
            assert np.ascontiguousarray(x).tobytes() == np.ascontiguousarray(y).tobytes()


def reports_of(bag: Path, node: str) -> list[dict[str, str]]:
    """Return what a node said in the diagnostics that a bag holds."""
    with closing(open_bag(bag)) as reader:
        connections = [x for x in reader.connections if x.topic == DIAGNOSTICS]
        arrays: list[Any] = [reader.deserialize(data, connection.msgtype)
                             for connection, _, data in reader.messages(connections)]
    found = [status for array in arrays for status in array.status if status.name == f'/{node}']
    return [{x.key: x.value for x in status.values} for status in found]
