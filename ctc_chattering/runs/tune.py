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
Search for gains of a robot known within ranges.

`ctc tune` calls `tune`: trials on the draws of a `TuneSpec`, the front, and its validation on
fresh draws. `tune_page` writes the result. Trials are asked for and answered in groups of a fixed
size, so that the result does not depend on how many of them run at a time. The search sees the
logarithms of error and variation, and a constraint for each limit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
import dataclasses
import math
from pathlib import Path
from typing import Any, NamedTuple

from ctc_chattering.configuration.compilation import compile_setups
from ctc_chattering.control.recommended_gains import RECOMMENDED_LAW
from ctc_chattering.errors import CtcError, ParameterError, UsageError
from ctc_chattering.parameters import checked_integer
from ctc_chattering.runs.pool import processes, run_serially
from ctc_chattering.runs.recommended import gains_by_rule, LawSettings
from ctc_chattering.runs.run_lists import MapRuns
from ctc_chattering.runs.score import PER_JOINT
from ctc_chattering.runs.store import compute
from ctc_chattering.runs.tune_spec import (
    first_numbers,
    Limits,
    Numbers,
    Range,
    tune_spec,
    TuneSpec,
)
import numpy as np
import pandas  # type: ignore[import-untyped]
import pyarrow

#: Major version of Optuna from which on trials have constraints.
MIN_OPTUNA_VERSION = 5
#: Constraint on the runs of a trial that diverge.
DIVERGED = 'diverged'
#: Constraint on the torque of a trial.
TORQUE = 'torque'
#: Constraint on the torque rate of a trial.
RATE = 'torque rate'
#: Everything that a trial can violate.
CONSTRAINTS = (DIVERGED, TORQUE, RATE)
#: Called with the number of finished trials, and of all.
Progress = Callable[[int, int], None]


class GainsScore(NamedTuple):
    """
    Numbers of gains over all draws.

    Attributes
    ----------
    error, variation : float
        Bounds that the given part of the runs does not exceed [rad], [N·m/s]. They are inf where
        more runs diverge.
    torque, rate : tuple of float, shape (n,)
        Largest of all runs that do not diverge [N·m], [N·m/s].
    excess : dict of str to float
        By constraint: part of the runs that diverge, and relative excess of torque and rate over
        their limits. It is 0 or less where the constraint holds.

    """

    error: float
    variation: float
    torque: tuple[float, ...]
    rate: tuple[float, ...]
    excess: dict[str, float]

    @property
    def objectives(self) -> tuple[float, ...]:
        """Finite logarithms of error and variation."""
        return tuple(math.log(min(max(x, 1e-12), 1e9)) for x in (self.error, self.variation))

    @property
    def allowed(self) -> bool:
        """Absence of any violation in any run."""
        return max(self.excess.values()) <= 0.0


class Trial(NamedTuple):
    """The numbers of a trial, named as in `SPACE`."""

    numbers: Numbers
    score: GainsScore


def score_gains(runs: pandas.DataFrame, limits: Limits, percentile: float) -> GainsScore:
    """
    Return the score of gains over all draws.

    Parameters
    ----------
    runs : pandas.DataFrame
        A row a draw, as `store.compute` has them.
    limits : Limits
        Limits of every run.
    percentile : float
        Part of the runs that error and variation do not exceed [%], 100 for the worst run.

    Raises
    ------
    CtcError
        If the parameters of a run are not allowed, which is no property of the gains.

    """
    refused = runs['reason'][runs['failure'] == 'refused']
    if len(refused):
        raise CtcError(refused.iloc[0])
    good = runs[runs['failure'] == '']
    excess = {DIVERGED: 1.0 - len(good) / len(runs)}
    largest = {}
    for name, quantity, limit in ((TORQUE, 'peak', limits.torque),
                                  (RATE, 'peak_rate', limits.rate)):
        column, _ = PER_JOINT[quantity]
        values = good[[f'{column}_{i}' for i, _ in enumerate(limit, 1)]].to_numpy()
        used, largest[name] = 1.0, (math.inf,) * len(limit)
        if len(good):
            used, largest[name] = float((values / limit).max()), tuple(values.max(0).tolist())
        excess[name] = used - (1.0 + 1e-9)  # Rounding of a torque at its limit is no excess.
    bounds = np.percentile(runs[['error', 'variation']].fillna(math.inf), percentile, axis=0,
                           method='inverted_cdf')
    error, variation = bounds.tolist()
    return GainsScore(error, variation, largest[TORQUE], largest[RATE], excess)


def pareto_front(scores: Sequence[GainsScore]) -> list[int]:
    """
    Return the non-dominated scores in order of variation.

    A score that violates a constraint is not among them. Another one dominates a score if it has
    no more error and no more variation, and less of one. Of equal scores the first remains.
    """
    allowed = [k for k, x in enumerate(scores) if x.allowed]
    front: list[int] = []
    for k in sorted(allowed, key=lambda k: (scores[k].variation, scores[k].error)):
        if not front or scores[k].error < scores[front[-1]].error:
            front.append(k)
    return front


def run_trials(evaluate: Callable[[list[Numbers]], Iterable[GainsScore]],
               ranges: Mapping[str, Range], first: Iterable[Mapping[str, float]], trials: int,
               seed: int) -> list[Trial]:
    """
    Return all trials in their order.

    Parameters
    ----------
    evaluate : callable
        Returns the scores of some numbers.
    ranges : mapping
        Ranges of the search.
    first : iterable of mapping
        Numbers with which to begin.
    trials : int
        Number of trials, those of `first` included.
    seed : int
        Seed of the sampler, TPE.

    Raises
    ------
    UsageError
        If Optuna is too old.

    """
    optuna = require_optuna()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    sampler = optuna.samplers.TPESampler(
        n_startup_trials=max(1, min(30, trials // 4)), seed=seed % 2 ** 32)
    study = optuna.create_study(directions=['minimize'] * 2, sampler=sampler)
    for numbers in first:
        study.enqueue_trial(dict(numbers))
    distributions = {name: optuna.distributions.FloatDistribution(x.low, x.high, log=True)
                     for name, x in ranges.items()}
    done: list[Trial] = []
    while len(done) < trials:
        group = [study.ask(distributions) for _ in range(min(10, trials - len(done)))]
        for trial, score in zip(group, evaluate([x.params for x in group])):
            for name, value in score.excess.items():
                trial.set_constraint(name, value)
            study.tell(trial, list(score.objectives))
            done.append(Trial(trial.params, score))
    return done


def require_optuna() -> Any:
    """
    Return the library.

    Raise `UsageError` if it is too old.
    """
    import optuna
    if int(optuna.__version__.partition('.')[0]) < MIN_OPTUNA_VERSION:
        raise UsageError(
            f'Optuna {MIN_OPTUNA_VERSION} is needed, this is {optuna.__version__}: '
            f"pip install 'optuna>={MIN_OPTUNA_VERSION}'")
    return optuna


class Candidate(NamedTuple):
    """
    A law with its scores on drawn and fresh robots.

    Attributes
    ----------
    law : LawSettings
        Law and gains.
    drawn, fresh : GainsScore
        Scores on the draws of the search, and on fresh ones.

    """

    law: LawSettings
    drawn: GainsScore
    fresh: GainsScore

    @property
    def name(self) -> str:
        """Name in tables."""
        return self.law.name

    @property
    def values(self) -> Mapping[str, Any]:
        """Parameters in place of those of the file."""
        return self.law.values


@dataclasses.dataclass(frozen=True)
class Tuning:
    """
    The result of a search.

    Attributes
    ----------
    spec : TuneSpec
        Robot, law, limits and ranges.
    percentile : float
        Part of the runs that error and variation of a candidate do not exceed [%].
    seed : int
        Seed of the search.
    trials : tuple of Trial
        All, in their order.
    front : tuple of int
        Trials that are not dominated, in the order of their torque variation.
    points : tuple of Candidate
        The same, validated.
    best : Candidate or None
        The recommended one of the points, and of `others` under the law that is tuned. It is None
        without a trial that keeps the limits.
    others : tuple of Candidate
        The gains of the file, and the recommended settings of laws.
    drawn, fresh : MapRuns
        Draws of the search and of the validation.
    table : pyarrow.Table
        A row a run, as that of a map: of all candidates on all draws, then on fresh ones.

    """

    spec: TuneSpec
    percentile: float
    seed: int
    trials: tuple[Trial, ...]
    front: tuple[int, ...]
    points: tuple[Candidate, ...]
    best: Candidate | None
    others: tuple[Candidate, ...]
    drawn: MapRuns
    fresh: MapRuns
    table: pyarrow.Table


def search_gains(spec: TuneSpec, trials: int, percentile: float = 95.0, seed: int = 0,
                 run_tasks: Callable[..., Iterator[Any]] = run_serially,
                 progress: Progress | None = None) -> Tuning:
    """
    Search for gains, and validate those of the front.

    Parameters
    ----------
    spec : TuneSpec
        Robot, law, limits and ranges.
    trials : int
        Number of trials.
    percentile : float
        Part of the runs that error and variation do not exceed [%], 100 for the worst run.
    seed : int
        Seed of the sampler.
    run_tasks : callable
        `pool.run_on_workers` of a client, or `pool.run_serially`.
    progress : callable, optional
        Called with the number of finished trials, and of all.

    Raises
    ------
    CtcError
        If a draw is not allowed, before anything is run.

    """
    drawn, fresh = MapRuns(spec), MapRuns(spec.fresh())
    for runs in (drawn, fresh):  # A value that is not allowed shows here.
        list(map(runs.setup, range(len(runs))))
    tables: list[pyarrow.Table] = []
    finished = 0

    def score(laws: Sequence[LawSettings], draws: MapRuns) -> list[GainsScore]:
        """Return the scores of laws over the same draws."""
        runs = MapRuns(dataclasses.replace(draws.spec, variants=tuple(laws)))
        chunks = np.split(np.arange(len(runs)), len(laws))
        tables.extend(run_tasks(compute, chunks, runs, ''))
        return [score_gains(x.to_pandas(), spec.limits, percentile)
                for x in tables[-len(chunks):]]

    def evaluate(batch: list[Numbers]) -> list[GainsScore]:
        """Return the scores of the next trials."""
        nonlocal finished
        laws = [spec.law(f'trial {finished + k}', x) for k, x in enumerate(batch)]
        scores = score(laws, drawn)
        finished += len(batch)
        if progress is not None:
            progress(finished, trials)
        return scores

    references = spec.references
    reference_scores = score(references, drawn)
    first = first_numbers(spec.setup.controller, spec.setup.plant.coulomb_friction,
                          gains_by_rule(spec.setup, RECOMMENDED_LAW), spec.ranges)
    done = run_trials(evaluate, spec.ranges, first, trials, seed)
    front = pareto_front([trial.score for trial in done])
    laws = [spec.law(f'trial {k}', done[k].numbers) for k in front]
    validated = score([*laws, *references], fresh)
    points = [Candidate(dataclasses.replace(law, name=str(number)), done[k].score, fresh_score)
              for number, (k, law, fresh_score) in enumerate(zip(front, laws, validated), 1)]
    compared = list(map(Candidate, references, reference_scores, validated[len(points):]))
    comparable = [x for x in compared if points and x.law.law == spec.setup.controller.law]
    table = pyarrow.concat_tables(tables)
    table = table.set_column(0, 'run', pyarrow.array(range(len(table))))
    return Tuning(
        spec=spec, percentile=percentile, seed=seed, trials=tuple(done), front=tuple(front),
        points=tuple(points), best=select_recommended([*points, *comparable]),
        others=tuple(compared), drawn=drawn, fresh=fresh, table=table)


def select_recommended(candidates: Sequence[Candidate]) -> Candidate | None:
    """
    Return the best compromise on fresh draws.

    On a front that is where one per cent less error costs one per cent more variation. Those that
    keep the limits there come first.
    """
    allowed = [x for x in candidates if x.fresh.allowed] or candidates
    return min(allowed, key=lambda x: x.fresh.error * x.fresh.variation, default=None)


def tune(spec: TuneSpec | Mapping[str, Any] | str | Path, trials: int = 200,
         percentile: float = 95.0, identified: str | Path | None = None, jobs: int = 1,
         show: Callable[[str], None] = print, progress: Progress | None = None) -> Tuning:
    """
    Search for gains of a robot known within ranges.

    Parameters
    ----------
    spec : mapping, str or Path
        Keys of the spec, as docs/tuning.md has them, or the path of a file with them. An example
        is ``{'params_file': 'panda', 'repeats': 32, 'tune': {'law': 'observer_feedback'}}``.
    trials : int
        Gains to try.
    percentile : float
        Part of the draws that error and torque variation do not exceed [%], 100 for the worst.
    identified : str or Path, optional
        Directory that `write_identified` has written: the robot, uncertain within its
        intervals. `spec` is then a mapping of further keys.
    jobs : int
        Processes. With more than 1 a script needs ``if __name__ == '__main__'``.
    show : callable
        Takes lines about compilation.
    progress : callable, optional
        Called with the number of finished trials, and of all. The validation follows.

    Returns
    -------
    Tuning
        The ``points`` of the front of error against torque variation, each with ``values``, the
        parameters of the controller. ``best`` is the recommended one, None if none keeps the
        limits. `write_tuning` takes it.

    Raises
    ------
    CtcError
        If something in the spec, or an argument, is not allowed, before anything is run.

    """
    require_optuna()
    trials, jobs = checked_integer('trials', trials, 1), checked_integer('jobs', jobs, 1)
    if not 0.0 < percentile <= 100.0:
        raise ParameterError('percentile', percentile, 'a number > 0 and <= 100')
    checked = tune_spec(spec, identified)
    laws = (*checked.variants, *checked.references)
    compile_setups(MapRuns(dataclasses.replace(checked, variants=laws)).examples(), show)
    with processes(jobs) as run_tasks:
        return search_gains(
            checked, trials, percentile, checked.repeats.seed, run_tasks, progress)
