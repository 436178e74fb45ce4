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

from collections.abc import Mapping
from pathlib import Path

from ctc_chattering.arguments import checked
from ctc_chattering.configuration.loop_setup import check_overrides, Overrides, Setup
from ctc_chattering.configuration.node_parameters import NODES
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.configuration.parameter_file import EVERY_NODE, load


@checked(path=(str, Path), overrides=(Mapping, type(None)))
def load_parameters(path: str | Path = 'friction', overrides: Overrides | None = None) -> Setup:
    """
    Return the configurations of plant, controller and reference, and the events, of a file.

    Parameters
    ----------
    path : str or Path
        A parameter file, or the name of one of the package: ``friction``, ``disturbance``,
        ``switch``, ``switching`` (the paper's arm), ``panda``, ``ur5``.
    overrides : mapping, optional
        Values by node and parameter that override the file's. Nodes are ``plant``,
        ``controller``, ``reference``, …, or ``/**`` for all that have the parameter; the
        parameters are in docs/parameters.md.

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
    return load(find_config(path) if isinstance(path, str) else path, overrides)
