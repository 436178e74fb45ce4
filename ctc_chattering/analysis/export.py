"""The samples of a run as files for other programs."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from ctc_chattering.analysis.result import Result
from ctc_chattering.errors import CtcError

#: Arrays per joint with the suffix of the joint's position unit; None for the torque unit.
_ARRAYS = {'q': '', 'dq': '/s', 'q_d': '', 'dq_d': '/s', 'ddq_d': '/s²', 'tau': None, 'v': '/s'}


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
    config = result.configs[-1][1]
    arrays: dict[str, Any] = {
        't': result.run.t, **{name: getattr(result.run, name) for name in _ARRAYS},
        'joint_names': result.joint_names, 'position_units': result.position_units,
        'torque_units': result.torque_units, 'control_period': config.control_period,
        'law': result.law, 'switching': result.switching, **result.gains}
    try:
        np.savez(path, **arrays)
    except OSError as error:
        raise CtcError(f'{path}: {error.strerror or error}') from None


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
        for i, joint in enumerate(result.joint_names):
            unit = (result.torque_units[i] if suffix is None
                    else result.position_units[i] + suffix)
            heads.append(f'{name}_{joint} [{unit}]')
            columns.append(getattr(result.run, name)[:, i])
    try:
        with path.open('w', newline='', encoding='utf-8') as file:
            rows = csv.writer(file)
            rows.writerow(heads)
            rows.writerows(np.column_stack(columns).tolist())
    except OSError as error:
        raise CtcError(f'{path}: {error.strerror or error}') from None
