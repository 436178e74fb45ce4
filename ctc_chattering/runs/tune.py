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

"""Gains searched over draws of what is uncertain, and validated on fresh ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
import dataclasses
from functools import partial
from itertools import chain, count
from pathlib import Path
from typing import Any, NamedTuple

from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.yaml_file import read_yaml
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.errors import ParameterError
from ctc_chattering.parameters import whole
from ctc_chattering.runs.points import Runs
from ctc_chattering.runs.pool import processes
from ctc_chattering.runs.recommended import recommended, recommended_setup
from ctc_chattering.runs.score import Score, score
from ctc_chattering.runs.search import (
    front,
    knee,
    Numbers,
    over_draws,
    OverDraws,
    require_optuna,
    search,
    starts,
    Trial,
)
from ctc_chattering.runs.spec import errors_of
from ctc_chattering.runs.tune_spec import identified_spec, parse_tune, TuneSpec

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


def scores_of(window: tuple[float, float], setups: Sequence[Setup]) -> list[Score]:
    """Run setups; return the numbers of their true motion in a window."""
    return [score(setup, window) for setup in setups]


class Evaluation(NamedTuple):
    """
    How candidates are evaluated.

    Attributes
    ----------
    spec : TuneSpec
        Window and limits.
    percentile : float
        Part of the runs that error and variation do not exceed [%]; 100 for the worst run.
    each : callable
        Map of a function over tasks, in their order.

    """

    spec: TuneSpec
    percentile: float
    each: Callable[..., Iterator[Any]]

    def scores(self, candidates: Iterable[Mapping[str, Any]], draws: Runs) -> list[OverDraws]:
        """Return what candidates, parameters of the controller, do over the same draws."""
        spec, n = self.spec, len(draws.setups)
        setups = [dataclasses.replace(setup, controller=setup.controller.changed(values))
                  for values in candidates for setup in draws.setups]
        runs = list(chain.from_iterable(self.each(
            partial(scores_of, spec.window),
            [setups[k:k + _CHUNK] for k in range(0, len(setups), _CHUNK)])))
        return [over_draws(runs[k:k + n], spec.limits, self.percentile)
                for k in range(0, len(runs), n)]


def searched(evaluation: Evaluation, trials: int, seed: int) -> Tuning:
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
    drawn, fresh = Runs(spec), Runs(spec.fresh())
    for draws in (drawn, fresh):  # What is not allowed shows here.
        _ = draws.setups
    first = starts(spec.setup.controller, spec.setup.plant.coulomb_friction,
                   recommended(spec.setup), spec.ranges)
    found: list[Trial] = []
    others = references(spec)
    of_others = evaluation.scores(others.values(), drawn)

    def answers(batch: list[Numbers]) -> Iterator[tuple[tuple[float, float], dict[str, float]]]:
        found.extend(map(Trial, batch, evaluation.scores(map(spec.gains, batch), drawn)))
        return ((x.score.objectives, x.score.excess) for x in found[-len(batch):])

    search(answers, spec.ranges, first, trials, seed)
    chosen = front([trial.score for trial in found])
    values = [spec.gains(found[k].numbers) for k in chosen]
    validated = evaluation.scores([*values, *others.values()], fresh)
    points = tuple(map(Candidate, map(str, count(1)), values, (found[k].score for k in chosen),
                       validated))
    rest = tuple(map(Candidate, others, others.values(), of_others, validated[len(points):]))
    config = spec.setup.controller
    mine = [x for x in rest if points and config.changed(x.values).law == config.law]
    return Tuning(spec, evaluation.percentile, seed, tuple(found), tuple(chosen), points,
                  recommended_of([*points, *mine]), rest, drawn, fresh)


def recommended_of(candidates: Sequence[Candidate]) -> Candidate | None:
    """Return the knee on fresh draws, of those that keep the limits there, or of all."""
    kept = [x for x in candidates if x.fresh.allowed] or list(candidates)
    return kept[knee([x.fresh for x in kept])] if kept else None


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


def setups(spec: TuneSpec) -> list[Setup]:
    """Return the laws that run: the one that is tuned, and those of `references`."""
    return [dataclasses.replace(spec.setup, controller=spec.setup.controller.changed(values))
            for values in ({}, *references(spec).values())]


def _differences(old: ControllerConfig, new: ControllerConfig) -> dict[str, Any]:
    """Return the parameters of `new` that `old` has otherwise."""
    before = old.as_mapping()
    return {name: x for name, x in new.as_mapping().items() if x != before[name]}


Progress = Callable[[int, int], None]


def tune_spec(spec: TuneSpec | Mapping[str, Any] | str | Path,
              identified: str | Path | None = None) -> TuneSpec:
    """Return what is tuned; arguments and errors as of `tune`."""
    if isinstance(spec, TuneSpec):
        return spec
    if isinstance(spec, Mapping):
        if identified is not None:
            return identified_spec(Path(identified), spec)
        return parse_tune(dict(spec), Path(Path(str(spec.get('params_file', 'friction'))).name))
    with errors_of(Path(spec)):
        return parse_tune(read_yaml(Path(spec)), Path(spec))


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
        Called with the number of runs that are done, and of all: first of the search, then of
        the validation.

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
    require_optuna('tune')
    trials, jobs = whole('trials', trials, 1), whole('jobs', jobs, 1)
    if not 0.0 < percentile <= 100.0:
        raise ParameterError('percentile', percentile, 'a number > 0 and <= 100')
    found = tune_spec(spec, identified)
    compile_setups(setups(found), show)
    count = trials + len(references(found))
    with _map(jobs, count * found.repeats.repeats, progress) as each:
        return searched(Evaluation(found, percentile, each), trials, found.repeats.seed)


@contextmanager
def _map(jobs: int, total: int, progress: Progress | None) -> Iterator[Callable[..., Any]]:
    """Yield a map over processes that tells how many of the runs are done, after them anew."""
    with processes(jobs) as each:
        done = 0

        def counted(function: Callable[[Any], list[Any]], tasks: list[list[Any]]
                    ) -> Iterator[list[Any]]:
            nonlocal done, total
            if done == total:
                done, total = 0, sum(map(len, tasks))
            for found in each(function, tasks):
                done += len(found)
                if progress is not None:
                    progress(done, total)
                yield found
        yield counted
