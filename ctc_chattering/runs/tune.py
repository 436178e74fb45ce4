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
Gains by a search of Optuna for a robot that is known in part: trials, the front, validation.

Trials are asked for and answered in groups of a fixed size, so that the result does not depend on
how many of them run at a time. Of error and variation the search sees logarithms, of each limit a
constraint.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
import dataclasses
from itertools import count
import math
from pathlib import Path
from typing import Any, NamedTuple

from ctc_chattering.configuration.compilation import compile_setups
from ctc_chattering.control.recommended_gains import RECOMMENDED_LAW
from ctc_chattering.errors import CtcError, ParameterError, UsageError
from ctc_chattering.parameters import checked_integer
from ctc_chattering.runs.points import Runs
from ctc_chattering.runs.pool import processes, serially
from ctc_chattering.runs.recommended import gains_by_rule
from ctc_chattering.runs.score import PER_JOINT
from ctc_chattering.runs.store import compute
from ctc_chattering.runs.tune_spec import Limits, Range, starts, tune_spec, TuneSpec
import numpy as np
import pandas  # type: ignore[import-untyped]
import pyarrow

#: Major version of Optuna from which on trials have constraints.
_OPTUNA = 5
#: Number of seeds of a sampler.
_SEEDS = 2 ** 32
#: Trials that are asked for at once, and most at random before the sampler uses what it found.
_GROUP, _AT_RANDOM = 10, 30
#: What a trial can violate.
DIVERGED, TORQUE, RATE = CONSTRAINTS = ('diverged', 'torque', 'torque rate')
#: Largest ratio of a torque, or its rate, to a limit that is kept: as much as rounding does.
_WITHIN = 1.0 + 1e-9
#: Least and largest number of which a logarithm is taken.
_LEAST, _LARGEST = 1e-12, 1e9
#: Numbers by name, and what they do: two values to be small, and constraints that hold up to 0.
Numbers = dict[str, float]
Answers = Callable[[list[Numbers]], Iterable[tuple[Sequence[float], Mapping[str, float]]]]
Progress = Callable[[int, int], None]


class OverDraws(NamedTuple):
    """
    What gains do over all draws.

    Attributes
    ----------
    error, variation : float
        What the given part of the runs does not exceed [rad], [N·m/s]; inf where too many
        diverge.
    torque, rate : tuple of float, shape (n,)
        Largest of all runs that do not diverge [N·m], [N·m/s].
    excess : dict of str to float
        By constraint: part of the runs that diverge; by how much the torque or its rate exceeds
        its limit, as a part of it. At most 0 where the constraint holds.

    """

    error: float
    variation: float
    torque: tuple[float, ...]
    rate: tuple[float, ...]
    excess: dict[str, float]

    @property
    def objectives(self) -> tuple[float, ...]:
        """Return the logarithms of error and variation."""
        return tuple(math.log(min(max(x, _LEAST), _LARGEST)) for x in (self.error, self.variation))

    @property
    def allowed(self) -> bool:
        """Whether no run violates anything."""
        return max(self.excess.values()) <= 0.0


class Trial(NamedTuple):
    """The numbers of a trial, as `tuning.SPACE` has them, and what they do."""

    numbers: dict[str, float]
    score: OverDraws


def over_draws(runs: pandas.DataFrame, limits: Limits, percentile: float) -> OverDraws:
    """
    Return what gains do over all draws.

    Parameters
    ----------
    runs : pandas.DataFrame
        A row a draw, as `store.rows` has them.
    limits : Limits
        Of every run.
    percentile : float
        Part of the runs that error and variation do not exceed [%]; 100 for the worst run.

    Raises
    ------
    CtcError
        If the parameters of a run are not allowed: that is no property of the gains.

    """
    refused = runs['reason'][runs['failure'] == 'refused']
    if len(refused):
        raise CtcError(refused.iloc[0])
    good = runs[runs['failure'] == '']
    excess, largest = {DIVERGED: 1.0 - len(good) / len(runs)}, {}
    for name, (key, _), most in ((TORQUE, PER_JOINT['peak'], limits.torque),
                                 (RATE, PER_JOINT['peak_rate'], limits.rate)):
        values = good[[f'{key}_{i}' for i, _ in enumerate(most, 1)]].to_numpy()
        excess[name] = float((values / most).max() if len(good) else 1.0) - _WITHIN
        largest[name] = tuple(values.max(0).tolist()) if len(good) else (math.inf,) * len(most)
    error, variation = (percentile_of(runs[name].fillna(math.inf).tolist(), percentile)
                        for name in ('error', 'variation'))
    return OverDraws(error, variation, largest[TORQUE], largest[RATE], excess)


def percentile_of(values: Sequence[float], percentile: float) -> float:
    """Return the least of `values` that `percentile` % of them do not exceed."""
    return sorted(values)[max(0, math.ceil(percentile / 100.0 * len(values) - 1e-9) - 1)]


def front(scores: Sequence[OverDraws]) -> list[int]:
    """
    Return which scores are not dominated, in the order of their variation.

    A score that violates a constraint is not among them; one is dominated by another with no more
    error and no more variation, of which one is less, and of equal ones the first remains.
    """
    allowed = [k for k, x in enumerate(scores) if x.allowed]
    found: list[int] = []
    for k in sorted(allowed, key=lambda k: (scores[k].variation, scores[k].error)):
        if not found or scores[k].error < scores[found[-1]].error:
            found.append(k)
    return found


def search(answers: Answers, ranges: Mapping[str, Range], first: Iterable[Mapping[str, float]],
           trials: int, seed: int) -> list[Numbers]:
    """
    Return the numbers of all trials, in their order.

    Parameters
    ----------
    answers : callable
        What each of some numbers does.
    ranges : mapping
        Where to search.
    first : iterable of mapping
        Numbers with which to begin.
    trials : int
        How many, those of `first` included.
    seed : int
        Of the sampler, TPE.

    Raises
    ------
    UsageError
        If Optuna is too old.

    """
    optuna = require_optuna()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(
        directions=['minimize'] * 2, sampler=optuna.samplers.TPESampler(
            n_startup_trials=max(1, min(_AT_RANDOM, trials // 4)), seed=seed % _SEEDS))
    for numbers in first:
        study.enqueue_trial(dict(numbers))
    space = {name: optuna.distributions.FloatDistribution(x.low, x.high, log=True)
             for name, x in ranges.items()}
    found: list[Numbers] = []
    while len(found) < trials:
        asked = [study.ask(space) for _ in range(min(_GROUP, trials - len(found)))]
        for trial, (values, constraints) in zip(asked, answers([x.params for x in asked])):
            for name, value in constraints.items():
                trial.set_constraint(name, value)
            study.tell(trial, list(values))
            found.append(trial.params)
    return found


def require_optuna() -> Any:
    """Return the library; raise `UsageError` if it is too old."""
    import optuna
    if int(optuna.__version__.partition('.')[0]) < _OPTUNA:
        raise UsageError(f'Optuna {_OPTUNA} is needed, this is {optuna.__version__}: '
                         f"pip install 'optuna>={_OPTUNA}'")
    return optuna


class Candidate(NamedTuple):
    """
    Gains, and what they do.

    Attributes
    ----------
    name : str
        Shown.
    values : mapping
        Parameters of the controller in place of those of the file.
    drawn, fresh : OverDraws
        On the draws of the search, and on fresh ones.

    """

    name: str
    values: Mapping[str, Any]
    drawn: OverDraws
    fresh: OverDraws


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
    trials : tuple of Trial
        All, in their order.
    front : tuple of int
        Trials that are not dominated, in the order of their torque variation.
    points : tuple of Candidate
        The same, validated.
    best : Candidate or None
        What is recommended: of the points, and of `others` under the law that is tuned; None
        without a trial that keeps the limits.
    others : tuple of Candidate
        The gains of the file, and the recommended settings of laws.
    drawn, fresh : Runs
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
    drawn: Runs
    fresh: Runs
    table: pyarrow.Table


def searched(spec: TuneSpec, trials: int, percentile: float = 95.0, seed: int = 0,
             each: Callable[..., Iterator[Any]] = serially, progress: Progress | None = None
             ) -> Tuning:
    """
    Search for gains, and validate what was found.

    Parameters
    ----------
    spec : TuneSpec
        Robot, law, limits and ranges.
    trials : int
        How many.
    percentile : float
        Part of the runs that error and variation do not exceed [%]; 100 for the worst run.
    seed : int
        Of the sampler.
    each : callable
        `pool.computed` of a client, or `pool.serially`.
    progress : callable, optional
        Called with the number of trials that are done, and of all.

    Raises
    ------
    CtcError
        If a draw is not allowed; before anything is run.

    """
    drawn, fresh = Runs(spec), Runs(spec.fresh())
    for runs in (drawn, fresh):  # What is not allowed shows here.
        list(map(runs.setup, range(len(runs))))
    tables: list[pyarrow.Table] = []

    def scores(candidates: Mapping[str, Mapping[str, Any]], draws: Runs) -> list[OverDraws]:
        """Return what candidates, parameters of the controller, do over the same draws."""
        runs = Runs(draws.spec.under(candidates))
        chunks = np.split(np.arange(len(runs)), len(candidates))
        tables.extend(each(compute, chunks, runs, ''))
        return [over_draws(x.to_pandas(), spec.limits, percentile) for x in tables[-len(chunks):]]

    first = starts(spec.setup.controller, spec.setup.plant.coulomb_friction,
                   gains_by_rule(spec.setup, RECOMMENDED_LAW), spec.ranges)
    found: list[Trial] = []
    others = spec.references
    of_others = scores(others, drawn)

    def answers(batch: list[Numbers]) -> Iterator[tuple[tuple[float, ...], dict[str, float]]]:
        named = {f'trial {k}': spec.gains(x) for k, x in enumerate(batch, len(found))}
        found.extend(map(Trial, batch, scores(named, drawn)))
        if progress is not None:
            progress(len(found), trials)
        return ((x.score.objectives, x.score.excess) for x in found[-len(batch):])

    search(answers, spec.ranges, first, trials, seed)
    chosen = front([trial.score for trial in found])
    values = {f'trial {k}': spec.gains(found[k].numbers) for k in chosen}
    validated = scores({**values, **others}, fresh)
    points = tuple(map(Candidate, map(str, count(1)), values.values(),
                       (found[k].score for k in chosen), validated))
    rest = tuple(map(Candidate, others, others.values(), of_others, validated[len(points):]))
    config, table = spec.setup.controller, pyarrow.concat_tables(tables)
    table = table.set_column(0, 'run', pyarrow.array(range(len(table))))
    mine = [x for x in rest if points and config.changed(x.values).law == config.law]
    return Tuning(spec, percentile, seed, tuple(found), tuple(chosen), points,
                  recommended_of([*points, *mine]), rest, drawn, fresh, table)


def recommended_of(candidates: Sequence[Candidate]) -> Candidate | None:
    """
    Return which has the smallest product of error and torque variation on fresh draws.

    On a front that is where one per cent less error costs one per cent more variation. It is of
    those that keep the limits there, or of all.
    """
    kept = [x for x in candidates if x.fresh.allowed] or candidates
    return min(kept, key=lambda x: x.fresh.error * x.fresh.variation, default=None)


def tune(spec: TuneSpec | Mapping[str, Any] | str | Path, trials: int = 200,
         percentile: float = 95.0, identified: str | Path | None = None, jobs: int = 1,
         show: Callable[[str], None] = print, progress: Progress | None = None) -> Tuning:
    """
    Search for gains for a robot whose parameters are known only within ranges.

    Parameters
    ----------
    spec : mapping, str or Path
        What is tuned, as docs/tuning.md has it, or the path of a file with it; such as
        ``{'params_file': 'panda', 'repeats': 32, 'tune': {'law': 'observer_feedback'}}``.
    trials : int
        Gains to try.
    percentile : float
        Part of the draws that error and torque variation do not exceed [%]; 100 for the worst.
    identified : str or Path, optional
        Directory that `write_identified` has written: the robot, uncertain within its
        intervals. `spec` is then a mapping of further keys.
    jobs : int
        Processes; with more than 1 a script needs ``if __name__ == '__main__'``.
    show : callable
        Takes lines about what is compiled.
    progress : callable, optional
        Called with the number of trials that are done, and of all; the validation follows.

    Returns
    -------
    Tuning
        The ``points`` of the front of error against torque variation, each with ``values``, the
        parameters of the controller; ``best`` is the recommended one, None if none keeps the
        limits. For `write_tuning`.

    Raises
    ------
    CtcError
        If something in the spec, or an argument, is not allowed, before anything is run.

    """
    require_optuna()
    trials, jobs = checked_integer('trials', trials, 1), checked_integer('jobs', jobs, 1)
    if not 0.0 < percentile <= 100.0:
        raise ParameterError('percentile', percentile, 'a number > 0 and <= 100')
    found = tune_spec(spec, identified)
    runs = Runs(found.under({'tuned': {}, **found.references}))
    compile_setups(runs.examples(), show)
    with processes(jobs) as each:
        return searched(found, trials, percentile, found.repeats.seed, each, progress)
