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
Samples of a run as NumPy and CSV files.

`ctc export`, `ctc simulate` and the public API come here.
"""

from __future__ import annotations

from collections.abc import Mapping
import csv
import io
from pathlib import Path
from typing import Any, BinaryIO

from ctc_chattering.analysis.result import Result
from ctc_chattering.errors import ParameterError
from ctc_chattering.output_files import replacing
from ctc_chattering.simulation.closed_loop import Array
import numpy as np

#: What stands behind the unit of a joint's position, by signal. The torque has a unit of its own.
_UNIT_SUFFIXES = {
    'q': '',
    'dq': '/s',
    'q_d': '',
    'dq_d': '/s',
    'ddq_d': '/s²',
    'tau': '',
    'v': '/s',
}


def commands_path(path: Path) -> Path:
    """
    Return the file of torques beside a CSV file.

    It has torques at times of their own.
    """
    return path.with_name(f'{path.stem}_commands.csv')


def export(result: Result, path: str | Path) -> None:
    """
    Write the samples of a run for other programs.

    They have the names and units of the joints.

    A NumPy file has these arrays.

    - ``t``, shape (N,), and ``q, dq, q_d, dq_d, ddq_d, tau, v``, shape (N, n).
    - ``correction``, shape (N, 3, n), where one was learned: what the law's reference has beyond
      ``q_d, dq_d, ddq_d``.
    - ``command_t``, shape (M,), and ``command``, shape (M, n): all torques sent.
    - Of a bag ``terms_t`` and ``nominal, compensation, robust, lyapunov``: terms of the law.
    - ``signals`` and ``origins``: whether each is recorded, computed exactly or not known.
    - ``joint_names``, ``position_units`` and ``torque_units``, shape (n,).
    - ``control_period``, ``law``, ``switching`` and the gains by name, as at the end.

    A CSV file has a column for each joint and quantity. Its head is name and unit, for example
    ``q_elbow [rad]``. Torques that have times of their own are in ``NAME_commands.csv`` beside it.
    Numbers are exact, unknown ones are ``nan``.

    Parameters
    ----------
    result : Result
        Run of `simulate` or `read_bag`.
    path : str or Path
        File to write, ``.npz`` or ``.csv``.

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
    if path.suffix == '.npz':
        with replacing(path) as stream:
            _write_arrays(result, stream)
    elif path.suffix == '.csv':
        _write_csv(result, path, result.run.t, _arrays(result))
        if result.commands is not None:
            _write_csv(
                result, commands_path(path), result.commands.t, {'tau': result.commands.values}
            )
    else:
        raise ParameterError('path', str(path), 'a name that ends in .npz or .csv')


def _arrays(result: Result) -> dict[str, Array]:
    """Return the arrays that both formats have, each of shape (N, n)."""
    return {name: getattr(result, name) for name in _UNIT_SUFFIXES}


def _write_arrays(result: Result, stream: BinaryIO) -> None:
    """Write the arrays of a run in NumPy's format."""
    law_terms: dict[str, Any] = {}
    if result.law_terms is not None:
        law_terms = {
            'terms_t': result.law_terms.t,
            **{
                name: getattr(result.law_terms, name)
                for name in ('nominal', 'compensation', 'robust', 'lyapunov')
            },
        }
    origins = result.origins
    np.savez(
        stream,
        **{name: x for name, x in {**vars(result.run), **_arrays(result)}.items()
           if x is not None},
        command_t=result.torque.t,
        command=result.torque.values,
        **law_terms,
        signals=list(origins),
        origins=[x.value for x in origins.values()],
        joint_names=result.joint_names,
        position_units=result.position_units,
        torque_units=result.torque_units,
        control_period=result.config.control_period,
        law=result.law,
        switching=result.config.switching,
        **result.gains,
    )


def _write_csv(result: Result, path: Path, t: Array, arrays: Mapping[str, Array]) -> None:
    """
    Write times and arrays as comma-separated values.

    Each array has the shape (N, n).
    """
    heads, columns = ['t [s]'], [t]
    for name, values in arrays.items():
        units = result.torque_units if name == 'tau' else result.position_units
        heads += [
            f'{name}_{joint} [{unit}{_UNIT_SUFFIXES[name]}]'
            for joint, unit in zip(result.joint_names, units)
        ]
        columns += [*values.T]
    with replacing(path) as stream:
        text = io.TextIOWrapper(stream, 'utf-8', 'backslashreplace', newline='')
        csv.writer(text).writerows([heads, *np.column_stack(columns).tolist()])
        text.detach()
