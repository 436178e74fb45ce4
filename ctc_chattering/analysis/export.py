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

"""The samples of a run as files for other programs."""

from __future__ import annotations

import csv
from pathlib import Path

from ctc_chattering.analysis.output import writing
from ctc_chattering.analysis.result import Result
from ctc_chattering.arguments import checked
from ctc_chattering.errors import ParameterError
import numpy as np

#: Arrays per joint with the suffix of the joint's position unit; None for the torque unit.
_ARRAYS = {'q': '', 'dq': '/s', 'q_d': '', 'dq_d': '/s', 'ddq_d': '/s²', 'tau': None, 'v': '/s'}


@checked(result=Result, path=(str, Path))
def export(result: Result, path: str | Path) -> None:
    """
    Write the samples of a run with names and units of the joints, for other programs.

    Parameters
    ----------
    result : Result
        Of `simulate` or `read_bag`.
    path : str or Path
        File to write: ``.npz`` for NumPy, which has the gains as well; ``.csv`` for a column per
        joint and quantity.

    Raises
    ------
    CtcError
        If the name ends otherwise, or the file cannot be written.

    Examples
    --------
    >>> from ctc_chattering import export, load_parameters, simulate
    >>> result = simulate(load_parameters('friction', {'plant': {'duration': 0.1}}))
    >>> export(result, 'run.csv')
    >>> open('run.csv').readline().split(',')[:2]
    ['t [s]', 'q_joint1 [rad]']

    """
    path = Path(path)
    if path.suffix not in ('.npz', '.csv'):
        raise ParameterError('path', str(path), 'a name that ends in .npz or .csv')
    (write_csv if path.suffix == '.csv' else write_npz)(result, path)


def write_npz(result: Result, path: Path) -> None:
    """
    Write samples, names, units and gains as a NumPy file.

    ``t``, shape (N,), and ``q, dq, q_d, dq_d, ddq_d, tau, v``, shape (N, n); ``joint_names``,
    ``position_units``, ``torque_units``, shape (n,); ``control_period``, ``law``, ``switching``
    and the gains by name, as at the end.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    with writing(path):
        np.savez(path, **vars(result.run), joint_names=result.joint_names,
                 position_units=result.position_units, torque_units=result.torque_units,
                 control_period=result.config.control_period, law=result.law,
                 switching=result.config.switching, **result.gains)


def write_csv(result: Result, path: Path) -> None:
    """
    Write samples as comma-separated values, a column per joint and quantity.

    The first row has the name and unit of each column, for example ``q_elbow [rad]``. Numbers are
    exact; unknown ones are ``nan``.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    heads, columns = ['t [s]'], [result.run.t]
    for name, suffix in _ARRAYS.items():
        units = (result.torque_units if suffix is None
                 else [unit + suffix for unit in result.position_units])
        heads += [f'{name}_{joint} [{unit}]' for joint, unit in zip(result.joint_names, units)]
        columns.extend(getattr(result.run, name).T)
    with writing(path), path.open('w', newline='', encoding='utf-8') as file:
        rows = csv.writer(file)
        rows.writerow(heads)
        rows.writerows(np.column_stack(columns).tolist())
