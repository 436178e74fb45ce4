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

"""The experiments of `ctc reproduce` by name."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from pathlib import Path
from typing import Any

from ctc_chattering.configuration.package_share import config_directory


@dataclasses.dataclass(frozen=True)
class Experiment:
    """
    One run: a parameter file in `config/` and overrides.

    Attributes
    ----------
    file : str
        Name of the parameter file, without its ending.
    values : mapping
        Parameters of the controller in place of the file's.

    """

    file: str
    values: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def path(self) -> Path:
        """Return the parameter file."""
        return config_directory() / f'{self.file}.yaml'

    @property
    def name(self) -> str:
        """Name of its bag."""
        return '_'.join((self.file, *(x for x in self.values.values() if isinstance(x, str))))

    @property
    def overrides(self) -> dict[str, Mapping[str, Any]]:
        """Values that override those of the file."""
        return {'controller': self.values} if self.values else {}


#: Figures 2 to 9 of the paper, the switching that this package recommends (Ka above friction),
#: and the switch from one law to the other.
EXPERIMENTS = (
    Experiment('friction', {'law': 'compensation'}), Experiment('friction', {'law': 'chattering'}),
    Experiment('friction', {
        'law': 'chattering', 'switching': 'implicit_observer', 'ka': [12.0, 12.0]}),
    Experiment('disturbance', {'law': 'compensation'}),
    Experiment('disturbance', {'law': 'chattering'}), Experiment('switch'))
