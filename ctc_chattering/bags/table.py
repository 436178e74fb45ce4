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
The motion of a robot from a table of comma-separated values, as most public recordings are.

The first column is the time [s]. Then, in any order, `q_NAME` has the position of a joint
[rad], `tau_NAME` its torque as measured, and `dq_NAME` its velocity [rad/s], if recorded; NAME is
that of the description, or a number from 1 on in the order of the joints.
"""

from __future__ import annotations

from collections.abc import Sequence
import csv
from pathlib import Path
import re
import warnings

from ctc_chattering.bags.recording import RecordedMotion, Recording
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, shorten, suggest
from ctc_chattering.input_files import check_regular
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Ending of the name of a table.
SUFFIX = '.csv'
#: Names of the column of time.
TIME = ('t', 'time', 'time_s', 't [s]')
#: Name of another column: quantity, joint, and a unit, as `ctc export` writes it beside desired
#: motions, which are none of a joint.
COLUMN = re.compile(r'(?!d*q_d_)(q|dq|tau|effort)_?(.+?)(?: \[.*\])?')
#: Largest table that is read [bytes].
MOST_BYTES = 2 ** 31


def read_table(path: str | Path, joints: Sequence[str] = (), description: str = ''
               ) -> RecordedMotion:
    """
    Return the motion that a table holds, for `identify`.

    Parameters
    ----------
    path : str or Path
        The file.
    joints : sequence of str
        Joints in the order of the model; empty for the movable joints of the description that the
        table has, or those of the table.
    description : str
        Text of the URDF.

    Raises
    ------
    CtcError
        If the file cannot be read, lacks a column, or `Recording.checked` refuses it.

    """
    path = Path(path)
    heads, values = _read(path)
    if not heads or heads[0].strip().lower() not in TIME:
        raise CtcError(f'{path}: the first column is {heads[0] if heads else "missing"}; allowed: '
                       f'{", ".join(TIME)}, the time in seconds')
    columns: dict[str, dict[str, Array]] = {'q': {}, 'dq': {}, 'tau': {}}
    for head, column in zip(heads[1:], values.T[1:]):
        match = COLUMN.fullmatch(head.strip())
        if match:
            quantity = match[1].replace('effort', 'tau')
            columns[quantity][match[2]] = column
    names = tuple(joints) or _joints(path, tuple(columns['q']), description)

    def rows(quantity: str) -> Array | None:
        found = [columns[quantity].get(name, columns[quantity].get(str(k)))
                 for k, name in enumerate(names, 1)]
        missing = [name for name, column in zip(names, found) if column is None]
        if missing and quantity == 'q':
            raise CtcError(f'{path}: no column q_{missing[0]}; it has: {shorten(heads[1:])}'
                           f'{suggest(f"q_{missing[0]}", heads)}')
        return None if missing else np.stack([x for x in found if x is not None], axis=1)

    positions = rows('q')
    assert positions is not None
    recording = Recording(path.name, names, values[:, 0] - values[0, 0], positions, rows('dq'),
                          rows('tau'))
    return RecordedMotion(recording.checked(), description)


def _joints(path: Path, in_table: tuple[str, ...], description: str) -> tuple[str, ...]:
    """Return the joints where none are asked for."""
    movable = Tree(description).movable if description else in_table
    if all(name.isdigit() for name in in_table):
        if len(in_table) == len(movable):
            return tuple(movable)
        raise CtcError(f'{path}: {len(in_table)} joints with numbers; the description has '
                       f'{len(movable)}: {shorten(movable)}. Give --joints in their order')
    found = tuple(name for name in movable if name in in_table)
    if not found:
        raise CtcError(f'{path}: the description has the joints {shorten(movable)}; the table '
                       f'has {shorten(in_table)}')
    return found


def _read(path: Path) -> tuple[list[str], Array]:
    """Return heads and numbers of a table, shape (N, columns)."""
    check_regular(path)
    try:
        if path.stat().st_size > MOST_BYTES:
            raise CtcError(f'{path}: larger than {MOST_BYTES >> 20} MiB')
        with path.open(newline='', encoding='utf-8') as file:
            heads = next(csv.reader(file), [])
            with warnings.catch_warnings():
                warnings.simplefilter('error')  # Of a table without rows.
                values = np.loadtxt(file, delimiter=',', ndmin=2)
    except (OSError, ValueError, UnicodeDecodeError, UserWarning) as error:
        raise CtcError(f'{path}: not a table of numbers below one line of names: {error}'
                       ) from None
    if values.shape[1] != len(heads) or len(values) < 2:
        raise CtcError(f'{path}: {len(heads)} names above {values.shape[1]} columns of '
                       f'{len(values)} rows')
    return heads, values
