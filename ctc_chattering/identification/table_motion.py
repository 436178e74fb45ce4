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
Recorded motion of a robot, from a CSV table.

The first column is the time [s]. The others may be in any order: `q_NAME` is the position of a
joint [rad], `tau_NAME` its measured torque and `dq_NAME` its velocity [rad/s], if recorded. NAME
is that of the description, or a number from 1 on in the order of the joints. `ctc identify` calls
`read_table` for a file that ends in ``.csv``.
"""

from __future__ import annotations

from collections.abc import Sequence
import csv
from pathlib import Path
import re
import warnings

from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, shorten, suggest
from ctc_chattering.identification.recording import (
    find_joints,
    RecordedMotion,
    Recording,
    RecordingError,
    RecordingFault,
)
from ctc_chattering.input_files import check_regular
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Ending of the name of a table.
SUFFIX = '.csv'
#: Names of the column of time.
TIME = ('t', 'time', 'time_s', 't [s]')
#: Name of another column: quantity, joint, and a unit as `ctc export` writes it. Columns of
#: desired motions do not match.
COLUMN = re.compile(r'(?!d*q_d_)(q|dq|tau|effort)_?(.+?)(?: \[.*\])?')
#: Largest table that is read.
MAX_BYTES = 2 ** 31


def read_table(
        path: str | Path,
        joints: Sequence[str] = (),
        description: str = '') -> RecordedMotion:
    """
    Return the motion in a table, for `identify`.

    Parameters
    ----------
    path : str or Path
        The file.
    joints : sequence of str
        Joints in the order of the model. By default the movable joints of the description that
        the table has, or those of the table.
    description : str
        Text of the URDF.

    Raises
    ------
    CtcError
        If the file cannot be read, lacks a column, or `Recording.checked` refuses it.

    """
    path = Path(path)
    heads, values = _read_columns(path)
    if not heads or heads[0].strip().lower() not in TIME:
        raise RecordingError(
            RecordingFault.TOPIC,
            f'{path}: the first column is {heads[0] if heads else "missing"}; allowed: '
            f'{", ".join(TIME)}, the time in seconds')
    columns: dict[str, dict[str, Array]] = {'q': {}, 'dq': {}, 'tau': {}}
    for head, column in zip(heads[1:], values.T[1:]):
        match = COLUMN.fullmatch(head.strip())
        if match:
            quantity = match[1].replace('effort', 'tau')
            columns[quantity][match[2]] = column
    names = tuple(joints)
    if not names:
        names = tuple(columns['q'])
        if description and all(name.isdigit() for name in names):
            names = _name_numbers(path, names, description)
        else:
            names = find_joints(path, description, names)

    def stack(quantity: str) -> Array | None:
        by_joint = columns[quantity]
        picked = [by_joint.get(name, by_joint.get(str(k))) for k, name in enumerate(names, 1)]
        present = [x for x in picked if x is not None]
        return np.stack(present, axis=1) if len(present) == len(names) else None

    q = stack('q')
    if q is None:
        missing = next(name for k, name in enumerate(names, 1)
                       if columns['q'].keys().isdisjoint((name, str(k))))
        raise RecordingError(
            RecordingFault.TOPIC,
            f'{path}: no column q_{missing}; it has: {shorten(heads[1:])}'
            f'{suggest(f"q_{missing}", heads)}')
    t = values[:, 0] - values[0, 0]
    recording = Recording(path.name, names, t, q, stack('dq'), stack('tau'))
    return RecordedMotion(recording.checked(), description)


def _name_numbers(path: Path, numbers: tuple[str, ...], description: str) -> tuple[str, ...]:
    """Return the movable joints that numbers from 1 on stand for."""
    movable = Tree(description).movable
    if len(numbers) != len(movable):
        raise RecordingError(
            RecordingFault.JOINTS,
            f'{path}: {len(numbers)} joints with numbers; the description has '
            f'{len(movable)}: {shorten(movable)}. Give --joints in their order')
    return movable


def _read_columns(path: Path) -> tuple[list[str], Array]:
    """Return a table's heads and numbers, shape (N, columns)."""
    check_regular(path)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise CtcError(f'{path}: larger than {MAX_BYTES >> 20} MiB')
        with path.open(newline='', encoding='utf-8') as file, warnings.catch_warnings():
            warnings.simplefilter('error')  # loadtxt warns of a table without rows.
            heads = next(csv.reader(file), [])
            values = np.loadtxt(file, delimiter=',', ndmin=2)
    except (OSError, ValueError, UserWarning) as error:
        raise CtcError(f'{path}: not a table of numbers below one line of names: {error}'
                       ) from None
    if values.shape[1] != len(heads) or len(values) < 2:
        raise CtcError(f'{path}: {len(heads)} names above {values.shape[1]} columns of '
                       f'{len(values)} rows')
    return heads, values
