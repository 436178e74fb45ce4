"""The experiments of `ctc reproduce` by name."""

from __future__ import annotations

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
    law : str, optional
        In place of the file's.
    switching : str, optional
        In place of the file's, with `ka`.
    ka : tuple of float
        Gain Ka under `switching` [N·m].

    """

    file: str
    law: str | None = None
    switching: str | None = None
    ka: tuple[float, ...] = ()

    @property
    def path(self) -> Path:
        """Return the parameter file."""
        return config_directory() / f'{self.file}.yaml'

    @property
    def name(self) -> str:
        """Name of its bag."""
        return '_'.join(filter(None, (self.file, self.law, self.switching)))

    @property
    def overrides(self) -> dict[str, dict[str, Any]]:
        """Values that override those of the file."""
        values: dict[str, Any] = {'law': self.law} if self.law else {}
        if self.switching:
            values.update(switching=self.switching, ka=list(self.ka))
        return {'controller': values} if values else {}


#: Figures 2 to 9 of the paper, the switching that this package recommends (Ka above friction),
#: and the switch from one law to the other.
EXPERIMENTS = (
    Experiment('friction', 'compensation'), Experiment('friction', 'chattering'),
    Experiment('friction', 'chattering', 'implicit_observer', (12.0, 12.0)),
    Experiment('disturbance', 'compensation'), Experiment('disturbance', 'chattering'),
    Experiment('switch'))
