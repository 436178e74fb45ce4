"""Candidates over draws: the runs of a search for gains, and of its validation."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
import dataclasses
from itertools import count
from math import inf, isfinite
from typing import Any, NamedTuple

from ctc_chattering.analysis.engine import simulated_by
from ctc_chattering.analysis.metrics import metrics
from ctc_chattering.configuration.parameter_file import Setup
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.errors import CtcError, MachineError, refused_as
from ctc_chattering.robustness.tuning.search import (
    front,
    knee,
    Measured,
    Score,
    score,
    search,
    Trial,
)
from ctc_chattering.robustness.tuning.spec import Draws, TuneSpec
from ctc_chattering.studies.recommended import recommended, recommended_setup
from ctc_chattering.studies.tuning import Range, starts
import numpy as np

#: Law that docs/laws.md recommends for real arms.
_BEST = 'observer_feedback'
#: Runs that a process gets at once.
_CHUNK = 8


class Candidate(NamedTuple):
    """
    Gains, and what they do.

    Attributes
    ----------
    name : str
        Shown.
    values : mapping
        Parameters of the controller in place of those of the file.
    drawn, fresh : Score
        On the draws of the search, and on fresh ones.

    """

    name: str
    values: Mapping[str, Any]
    drawn: Score
    fresh: Score


@dataclasses.dataclass(frozen=True)
class Tuning:
    """
    The result of a search.

    Attributes
    ----------
    spec : TuneSpec
        What was tuned.
    percentile : float
        Part of the runs that error and variation of a candidate do not exceed [%].
    seed : int
        Of the search.
    engine : str
        What ran it.
    trials : tuple of Trial
        All, in their order.
    front : tuple of int
        Trials that are not dominated, in the order of their torque variation.
    points : tuple of Candidate
        The same, validated.
    knee : int or None
        Index of the recommended point; None without a trial that keeps the limits.
    others : tuple of Candidate
        The gains of the file, and the recommended settings of laws.
    fresh : Draws
        Of the validation.

    """

    spec: TuneSpec
    percentile: float
    seed: int
    engine: str
    trials: tuple[Trial, ...]
    front: tuple[int, ...]
    points: tuple[Candidate, ...]
    knee: int | None
    others: tuple[Candidate, ...]
    fresh: Draws


def measured(task: tuple[Setup, tuple[float, float], str]) -> Measured:
    """Run a setup by an engine; return the numbers of its true motion in a window."""
    setup, window, engine = task
    try:
        with refused_as('the run failed'), np.errstate(all='ignore'):
            run = simulated_by(setup, engine, truth=True).run
    except MachineError:
        raise
    except CtcError as error:
        return Measured(inf, inf, (), (), str(error))
    period = setup.controller.control_period
    found = metrics(run, window, period=period)
    whole = metrics(run, (0.0, setup.plant.duration), period=period)
    largest = max(found['rms_error_rad'])
    if not isfinite(largest):
        return Measured(inf, inf, (), (), 'the error is not finite')
    return Measured(largest, max(found['torque_variation_nm_per_s']),
                    tuple(np.abs(run.tau).max(axis=0).tolist()),
                    tuple(whole['max_torque_rate_nm_per_s']))


class Evaluation(NamedTuple):
    """
    How candidates are evaluated.

    Attributes
    ----------
    spec : TuneSpec
        Window and limits.
    percentile : float
        Part of the runs that error and variation do not exceed [%]; 100 for the worst run.
    engine : str
        `BATCH` or `REFERENCE`; it has the robot of the spec.
    each : callable
        Map of a function over tasks in their order, with `chunksize` of them at a time.

    """

    spec: TuneSpec
    percentile: float
    engine: str
    each: Callable[..., Iterator[Any]]

    def scores(self, candidates: Iterable[Mapping[str, Any]], draws: Draws) -> list[Score]:
        """Return what candidates, parameters of the controller, do over the same draws."""
        spec, n = self.spec, len(draws.setups)
        tasks = [(dataclasses.replace(setup, controller=setup.controller.changed(values)),
                  spec.window, self.engine) for values in candidates for setup in draws.setups]
        runs: list[Measured] = list(self.each(measured, tasks, chunksize=_CHUNK))
        return [score(runs[k:k + n], spec.limits, self.percentile)
                for k in range(0, len(runs), n)]


def tune(evaluation: Evaluation, trials: int, seed: int) -> Tuning:
    """
    Search for gains, and validate what was found.

    Parameters
    ----------
    evaluation : Evaluation
        Robot, law, limits, ranges, and how to evaluate.
    trials : int
        How many.
    seed : int
        Of the sampler.

    Raises
    ------
    CtcError
        If a draw is not allowed; before anything is run.

    """
    spec = evaluation.spec
    drawn, fresh = spec.draws(), spec.fresh_draws()
    first = starts(spec.setup.controller, spec.setup.plant.coulomb_friction,
                   recommended(spec.setup))
    found = search(lambda batch: evaluation.scores(map(spec.gains, batch), drawn), spec.ranges,
                   [_within(x, spec.ranges) for x in first], trials, seed)
    chosen = front([trial.score for trial in found])
    values = [spec.gains(found[k].numbers) for k in chosen]
    others = references(spec)
    validated = evaluation.scores([*values, *others.values()], fresh)
    points = tuple(map(Candidate, map(str, count(1)), values, (found[k].score for k in chosen),
                       validated))
    rest = tuple(map(Candidate, others, others.values(),
                     evaluation.scores(others.values(), drawn), validated[len(points):]))
    return Tuning(spec, evaluation.percentile, seed, evaluation.engine, tuple(found),
                  tuple(chosen), points, recommended_point(points), rest, fresh)


def _within(numbers: Mapping[str, float], ranges: Mapping[str, Range]) -> dict[str, float]:
    """Return numbers within the ranges that are searched."""
    return {name: min(max(numbers[name], x.low), x.high) for name, x in ranges.items()}


def recommended_point(points: Sequence[Candidate]) -> int | None:
    """Return the knee on fresh draws, of the points that keep the limits there, or of all."""
    kept = [k for k, x in enumerate(points) if x.fresh.allowed] or list(range(len(points)))
    return kept[knee([points[k].fresh for k in kept])] if kept else None


def references(spec: TuneSpec) -> dict[str, dict[str, Any]]:
    """Return the gains of the file, which are the first, and the recommended settings, by name."""
    file, law = spec.file, spec.setup.controller.law
    setups = {'file': file, **{f'recommended {name}': recommended_setup(file, name)
                               for name in dict.fromkeys((law, _BEST))}}
    found = {}
    for name, setup in setups.items():
        config = setup.controller
        words = (name, '' if config.law in name else config.law, config.switching_in_force)
        found[' '.join(filter(None, words))] = _differences(spec.setup.controller, config)
    return found


def _differences(old: ControllerConfig, new: ControllerConfig) -> dict[str, Any]:
    """Return the parameters of `new` that `old` has otherwise."""
    before = old.as_mapping()
    return {name: x for name, x in new.as_mapping().items() if x != before[name]}
