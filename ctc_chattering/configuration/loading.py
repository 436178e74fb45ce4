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

from ctc_chattering.arguments import check_type, checked
from ctc_chattering.configuration.node_parameters import NODES
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.configuration.parameter_file import EVERY_NODE, load, Overrides, Setup
from ctc_chattering.errors import ParameterError


@checked(path=(str, Path), overrides=(Mapping, type(None)))
def load_parameters(path: str | Path, overrides: Overrides | None = None) -> Setup:
    """
    Return the configurations of plant, controller and reference, and the events, of a file.

    Parameters
    ----------
    path : str or Path
        A file, or ``friction``, ``disturbance``, … for the package's own.
    overrides : mapping, optional
        Values by node and parameter that override the file's.

    Raises
    ------
    CtcError
        If the file cannot be read, or something in it is not allowed.

    """
    for node, values in (overrides or {}).items():
        if node not in (*NODES, EVERY_NODE):
            raise ParameterError('overrides', node, ' | '.join((*NODES, EVERY_NODE)))
        check_type(f'overrides of {node}', values, Mapping)
    return load(find_config(path) if isinstance(path, str) else path, overrides)
