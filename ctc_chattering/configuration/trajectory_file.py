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

"""
Read and write files of waypoints, for `trajectory_file` of the reference.

The reference node and `load_parameters` read them. `ctc excite` and users write them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ctc_chattering.configuration.yaml_file import FileKind, mapping, read_yaml, yaml_text
from ctc_chattering.errors import ParameterError, prefixed
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.output_files import write_text
from ctc_chattering.parameters import LARGEST, Parameter
from ctc_chattering.trajectory.waypoints import FIELDS, Route

#: Decimal places of positions, velocities and accelerations in a file.
_DECIMALS = 8


def read_trajectory(path: Path, joint_names: Sequence[str]) -> Route:
    """
    Return the checked waypoints of a file.

    The file has `joint_names` and `points`. Each point has `positions`, `time_from_start` [s] and
    optionally `velocities`, `accelerations` and an empty `effort`. A `header` is ignored: times
    count from the start of the motion.

    Parameters
    ----------
    path : Path
        The file.
    joint_names : sequence of str
        Joints of the reference. The file must name exactly these.

    Raises
    ------
    CtcError
        If the file is invalid. The text names file, point and allowed values.

    """
    tree = read_yaml(path, FileKind.WAYPOINTS)
    with prefixed(f'{path}: '):
        return _route(tree).ordered(joint_names)


def write_trajectory(route: Route, path: Path) -> None:
    """
    Write waypoints in the format of `read_trajectory`.

    Parameters
    ----------
    route : Route
        The waypoints.
    path : Path
        File to write.

    Raises
    ------
    CtcError
        If it cannot be written.

    """
    points = []
    for t, point in zip(route.times, route.points):
        fields = {field: [round(float(x), _DECIMALS) + 0.0 for x in row]  # 0.0 and never -0.0
                  for field, row in zip(FIELDS, point) if row}
        points.append({'time_from_start': seconds(t), **fields})
    write_text(path, yaml_text({'joint_names': list(route.names), 'points': points}))


def _route(tree: object) -> Route:
    """Return the waypoints of a file, whose `FIELDS` are not yet checked."""
    values = mapping('trajectory', tree, ('joint_names', 'points', 'header'))
    names = Parameter('joint_names', 'str[]', (), '').coerce(values.get('joint_names'))
    rows = values.get('points')
    if not isinstance(rows, list):
        raise ParameterError('points', rows, 'a list of points')
    times = []
    points = []
    for i, row in enumerate(rows):
        name = f'points[{i}]'
        point = mapping(name, row, (*FIELDS, 'effort', 'time_from_start'))
        if point.get('effort'):
            raise ParameterError(f'{name}.effort', point['effort'], 'none: it would not be used')
        time = Parameter(f'{name}.time_from_start', 'float', None, '', 's', 0.0, LARGEST)
        times.append(round(time.checked(point.get('time_from_start')) * NANOSECONDS))
        points.append(tuple(point.get(field, []) for field in FIELDS))
    return Route(names, times, points)
