"""The paper's experiments by name."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from ctc_chattering.share import config_directory


@dataclasses.dataclass(frozen=True)
class Experiment:
    """One run of the paper: a parameter file in `config/` and, unless it says, the law."""

    file: str
    law: str | None = None

    @property
    def path(self) -> Path:
        """The parameter file."""
        return config_directory() / f'{self.file}.yaml'

    @property
    def name(self) -> str:
        """Name of its bag."""
        return f'{self.file}_{self.law}' if self.law else self.file

    @property
    def overrides(self) -> dict[str, dict[str, Any]]:
        """What stands above the file."""
        return {'controller': {'law': self.law}} if self.law else {}


#: Figures 2 to 9 of the paper, and the switch from one law to the other.
EXPERIMENTS = (
    Experiment('friction', 'compensation'), Experiment('friction', 'chattering'),
    Experiment('disturbance', 'compensation'), Experiment('disturbance', 'chattering'),
    Experiment('switch'))
