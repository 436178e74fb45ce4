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

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from ctc_chattering.analysis.result import Result
from ctc_chattering.bags.writer import BagWriter, offered_qos
from ctc_chattering.parameters import Config
from motion_bags import header, joint_state, made, point, serialized, torques, trajectory
import numpy as np
from rclpy.parameter import Parameter

Rows = Sequence[Sequence[float]]


def state(names: Sequence[str], rows: Rows, t: tuple[int, int] = (3, 4), order: str = '<'
          ) -> bytes:
    """Return a serialized JointState."""
    message: Any = joint_state(0, names, *rows)  # type: ignore[arg-type]
    message.header.stamp.sec, message.header.stamp.nanosec = t
    return serialized(message, order)


def efforts(names: Sequence[str], values: Sequence[float]) -> bytes:
    """Return serialized torques."""
    return serialized(torques(values, names))


def chunk(names: Sequence[str], points: Sequence[tuple[Rows, int, int]],
          t: tuple[int, int] = (3, 4)) -> bytes:
    """Return a serialized JointTrajectory."""
    message: Any = trajectory(0, names, [point(0, *rows) for rows, _, _ in points])
    message.header.stamp.sec, message.header.stamp.nanosec = t
    for mine, (_, *after) in zip(message.points, points):
        mine.time_from_start.sec, mine.time_from_start.nanosec = after
    return serialized(message)


class Entry(NamedTuple):
    """A message and where it belongs."""

    topic: str
    t: int
    message: Any


def nanoseconds(t: float) -> int:
    return round(t * 1e9)


def _value(x: Any) -> Any:
    """Return a ParameterValue as `rosbags` has it."""
    value = Parameter('', value=list(x) or [''] if isinstance(x, tuple) else x
                      ).get_parameter_value()
    none = np.zeros(0, np.uint8)
    return made('rcl_interfaces/msg/ParameterValue', **{
        **{name: getattr(value, name) for name in value.get_fields_and_field_types()},
        'byte_array_value': none, 'bool_array_value': none, 'integer_array_value': none,
        'double_array_value': np.array(value.double_array_value, float)})


def parameters(node: str, t: int, values: dict[str, Any], first: bool) -> Entry:
    """Return the parameters of a node's parameters."""
    items = [made('rcl_interfaces/msg/Parameter', name=name, value=_value(x))
             for name, x in values.items()]
    return Entry(f'/{node}/parameters', t, made(
        'rcl_interfaces/msg/ParameterEvent', stamp=header(t).stamp, node=f'/{node}',
        new_parameters=items if first else [], changed_parameters=[] if first else items,
        deleted_parameters=[]))


def entries(result: Result, plant: Config, start: int = 0, order: Sequence[int] = (0, 1),
            extra: Sequence[str] = (), chunk: int = 25) -> list[Entry]:
    """
    Return what the nodes send in lockstep, from simulated time `start` [ns] on.

    States and commands have the joints in `order`, the states `extra` ones in front; the reference
    has them the other way round, in chunks of so many points.
    """
    run, names, mine = result.run, result.joint_names, list(order)
    ours = [names[i] for i in order]
    theirs = [*extra, *ours]
    times = [start + nanoseconds(t) for t in run.t]
    found = [parameters('plant', start, plant.as_mapping(), True)]
    found += [Entry('/reference', times[i], trajectory(times[i], names[::-1], [
        point(times[k] - times[i], *(x[k][::-1] for x in (run.q_d, run.dq_d, run.ddq_d)))
        for k in range(i, min(i + chunk, len(times)))])) for i in range(0, len(times), chunk)]
    due = list(result.configs)
    old: dict[str, Any] = {}
    applied = np.zeros(len(names))
    for k, t in enumerate(times):
        found.append(Entry('/joint_states', t, joint_state(t, theirs, *(
            np.concatenate([np.full(len(extra), 7.7), x[mine]])
            for x in (run.q[k], run.dq[k], applied)))))
        found.append(Entry('/effort_controller/commands', t, torques(run.tau[k][mine], ours)))
        applied = run.tau[k]
        while due and start + nanoseconds(due[0][0]) <= t:
            new = due.pop(0)[1].as_mapping()
            changed = {key: value for key, value in new.items() if old.get(key) != value}
            found.append(parameters('controller', t, changed, not old))
            old = new
    return found


def write_bag(path: Path, found: Iterable[Entry], namespace: str = '',
              notes: Mapping[str, str] = MappingProxyType({})) -> dict[str, int]:
    """Record messages as the recorder does; return how many there are by topic."""
    recording = BagWriter(path)
    recording.notes |= notes
    profiles = [offered_qos(100, latched) for latched in (False, True)]
    for topic, t, message in found:
        kind, data = message if isinstance(message, tuple) else (
            message.__msgtype__, serialized(message))
        profile = profiles[topic.endswith('/parameters')]
        recording.write(namespace + topic, kind, t, data, profile)
    recording.close()
    return recording.counts
