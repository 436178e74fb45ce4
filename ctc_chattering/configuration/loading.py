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

"""Parameter files for users of the package: by path, or by the name of one of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ctc_chattering.configuration.loop_setup import check_overrides, Overrides, Setup
from ctc_chattering.configuration.node_parameters import NODES
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.configuration.parameter_file import (
    EVERY_NODE,
    known_model_torque,
    load,
    node_values,
    read,
)
from ctc_chattering.control.recommended_gains import GAINS, LAW, suitable_gains
from ctc_chattering.errors import ParameterError, UsageError

#: Whose gains a law takes: those of the file, or the recommended ones.
FROM_FILE, RECOMMENDED = 'file', 'recommended'
#: Duration of the smooth start that goes with recommended gains [s].
_START = 2.0


def with_gains(path: Path | None, overrides: Overrides, gains: str | None = None
               ) -> tuple[dict[str, dict[str, Any]], str]:
    """
    Return overrides with the gains that their law takes where they have none.

    Parameters
    ----------
    path : Path or None
        As `load` takes it.
    overrides : mapping
        Values by node and parameter.
    gains : {'file', 'recommended'}, optional
        Whose gains are taken; where left out, what `GainChoice` decides for a law that file or
        overrides choose without gains.

    Returns
    -------
    overrides : dict
        With gains, and a smooth start where they are recommended ones.
    line : str
        What was added, for the user; empty for nothing.

    Raises
    ------
    UsageError
        If gains of a law are asked for that has no recommended ones.
    CtcError
        As `load` does.

    """
    found = {node: dict(values) for node, values in overrides.items()}
    given = node_values(found, 'controller', 'overrides')
    in_file = node_values(read(path) if path else {}, 'controller', str(path))
    of_file = in_file.get('law')
    law = given.get('law', of_file)
    chosen = given.keys().isdisjoint(GAINS) and (
        in_file.keys().isdisjoint(GAINS) if law == of_file == LAW
        else (law == LAW) != (of_file == LAW))
    if gains == FROM_FILE or (gains is None and not chosen):
        return found, ''
    if gains is not None and law != LAW:
        raise UsageError(f'--gains {gains}: {law} has no recommended '
                         f'gains; allowed with --law {LAW}')
    setup = load(path, found)
    torque = known_model_torque(setup.controller, setup.descriptions) if law == LAW else None
    taken = {name: x for name, x in suitable_gains(str(law), setup.controller, torque).items()
             if name not in given}
    found.setdefault('controller', {}).update(taken)
    text = ', '.join(f'{name} {_shown(x)}' for name, x in taken.items())
    if law == LAW:
        start = found.setdefault('reference', {}).setdefault(
            'start_duration', max(setup.reference.start_duration, _START))
        text += f', and start_duration {start} s for a smooth start'
    return found, (f'law {law} takes recommended gains: {text}; --gains file takes those of the '
                   'file')


def _shown(value: float | tuple[float, ...]) -> str:
    """Return a gain, once if it is the same for all joints."""
    values = value if isinstance(value, tuple) else (value,)
    return f'{values[0]:g}' if len(set(values)) == 1 else '/'.join(f'{x:g}' for x in values)


def load_parameters(path: str | Path = 'friction', overrides: Overrides | None = None,
                    gains: str | None = None) -> Setup:
    """
    Return the configurations of plant, controller and reference, and the events, of a file.

    A law that the overrides choose without gains takes recommended ones where those of the file
    do not suit it, as under ``ctc simulate --law``: `observer_feedback` has gains of its own.

    Parameters
    ----------
    path : str or Path
        A parameter file, or the name of one of the package: ``friction``, ``disturbance``,
        ``switch``, ``switching`` (the paper's arm), ``panda``, ``ur5``.
    overrides : mapping, optional
        Values by node and parameter that override the file's. Nodes are ``plant``,
        ``controller``, ``reference``, …, or ``/**`` for all that have the parameter; the
        parameters are in docs/parameters.md.
    gains : {'file', 'recommended'}, optional
        Take the gains of the file in any case, or the recommended ones of `observer_feedback`.

    Returns
    -------
    Setup
        For `simulate`.

    Raises
    ------
    CtcError
        If the file cannot be read, or something in it is not allowed.

    Examples
    --------
    >>> from ctc_chattering import load_parameters
    >>> setup = load_parameters('friction', {
    ...     'plant': {'duration': 6.0}, 'controller': {'law': 'integral', 'ki': 50.0}})
    >>> setup.controller.law, setup.controller.ki
    ('integral', (50.0, 50.0))

    """
    check_overrides('overrides', overrides or {}, (*NODES, EVERY_NODE))
    if gains not in (None, FROM_FILE, RECOMMENDED):
        raise ParameterError('gains', gains, f'{FROM_FILE} | {RECOMMENDED}')
    file = find_config(path) if isinstance(path, str) else path
    return load(file, with_gains(file, overrides or {}, gains)[0])
