"""A finished run together with what it takes to draw it and to sum it up."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from ctc_chattering.core.controller import ControllerConfig
from ctc_chattering.core.metrics import metrics
from ctc_chattering.core.simulation import Run
from ctc_chattering.core.terms import Terms, terms


@dataclasses.dataclass(frozen=True)
class Result:
    """
    One run of one experiment.

    Attributes
    ----------
    experiment : str
        Its title, for example ``friction``.
    configs : sequence of (time, ControllerConfig)
        The controller's configurations in the order in which they came into force [s].
    run : Run
        The samples.
    terms : Terms
        The parts of the torque, v and V.

    """

    experiment: str
    configs: Sequence[tuple[float, ControllerConfig]]
    run: Run
    terms: Terms

    @classmethod
    def of(cls, experiment: str, configs: Sequence[tuple[float, ControllerConfig]],
           run: Run) -> Result:
        """Return the result of a run, its terms computed."""
        return cls(experiment, configs, run, terms(run, configs))

    @property
    def law(self) -> str:
        """The law in force at the end."""
        return self.configs[-1][1].law

    @property
    def switching(self) -> str:
        """The switching in force at the end."""
        return self.configs[-1][1].switching

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the arrays' columns."""
        return self.configs[0][1].joint_names

    @property
    def changes(self) -> list[tuple[float, str]]:
        """Times [s] at which the law changed during the run, with the new law."""
        return [(t, new.law) for (_, old), (t, new) in zip(self.configs, self.configs[1:])
                if new.law != old.law]

    @property
    def label(self) -> str:
        """Experiment and laws in words, for a legend."""
        laws = [self.configs[0][1].law, *(law for _, law in self.changes)]
        return f'{self.experiment}: {" → ".join(laws)}'

    @property
    def slug(self) -> str:
        """Experiment and law in a form fit for a file name."""
        return self.experiment if self.changes else f'{self.experiment}_{self.law}'

    def metrics(self) -> dict[str, Any]:
        """Return this run's entry of ``metrics.json``."""
        return {
            'experiment': self.experiment, 'law': self.law, 'switching': self.switching,
            'control_period_s': self.configs[-1][1].control_period, **metrics(self.run)}
