"""A finished run together with what it takes to draw it and to sum it up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import dataclasses
from functools import cached_property
import json
import math
from pathlib import Path
from typing import Any

from ctc_chattering.core.controller import ControllerConfig
from ctc_chattering.core.metrics import metrics
from ctc_chattering.core.models import model_of
from ctc_chattering.core.plants import make_plant
from ctc_chattering.core.simulation import Run, simulate
from ctc_chattering.core.terms import Terms, terms
from ctc_chattering.errors import CtcError
from ctc_chattering.params import Setup


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
    computed : Terms, optional
        Terms, if they are known already.

    """

    experiment: str
    configs: Sequence[tuple[float, ControllerConfig]]
    run: Run
    computed: Terms | None = None

    @cached_property
    def terms(self) -> Terms:
        """The parts of the torque, v and V, computed when first asked for."""
        return self.computed or terms(self.run, self.configs)

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
    def marks(self) -> list[tuple[float, str]]:
        """Times [s] at which law or switching changed during the run, with what they became."""
        return [(t, new.law if new.law != old.law else new.switching)
                for (_, old), (t, new) in zip(self.configs, self.configs[1:])
                if (new.law, new.switching) != (old.law, old.switching)]

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


def simulated(setup: Setup, progress: Callable[[float], None] | None = None) -> Result:
    """
    Simulate what a parameter file describes.

    Parameters
    ----------
    setup : Setup
        As `params.load` returns it.
    progress : callable, optional
        Called now and then with the simulated time [s].

    """
    run = simulate(setup.plant, setup.controller, setup.reference, setup.events, progress,
                   route=setup.route,
                   robot=make_plant(setup.plant, setup.descriptions.get('plant', '')),
                   model=model_of(setup.controller, setup.descriptions.get('controller', '')))
    configs = [(0.0, setup.controller)]
    for event in setup.events:
        if event.node == 'controller':
            configs.append((event.time, configs[-1][1].changed(event.values)))
    return Result(setup.plant.experiment, configs, run)


def write_metrics(results: Sequence[Result], path: Path) -> None:
    """
    Write ``{"runs": [...]}``, an object per run, as strict JSON.

    A number that is not finite, which JSON cannot say, becomes null.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    runs = [finite(result.metrics()) for result in results]
    text = json.dumps({'runs': runs}, indent=2, allow_nan=False, ensure_ascii=False)
    write_text(path, text + '\n')


def finite(value: Any) -> Any:
    """Return `value` with None in place of every number that is not finite."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_text(path: Path, text: str) -> None:
    """Write a file, making its directory; raise `CtcError` if that cannot be done."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding='utf-8')
    except OSError as error:
        raise CtcError(f'cannot write {path}: {error.strerror}') from None
