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
Search by Optuna for the numbers that do best.

Trials are asked for and answered in groups of a fixed size, so that the result does not depend on
how many of them run at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from ctc_chattering.errors import UsageError
from ctc_chattering.studies.tuning import Range

#: Major version of Optuna from which on trials have constraints.
_OPTUNA = 5
#: Number of seeds of a sampler.
_SEEDS = 2 ** 32
#: Numbers by name, and what they do: values to be small, and constraints that hold up to 0.
Numbers = dict[str, float]
Answers = Callable[[list[Numbers]], Iterable[tuple[Sequence[float], Mapping[str, float]]]]


def search(answers: Answers, ranges: Mapping[str, Range], first: Iterable[Mapping[str, float]],
           trials: int, seed: int, objectives: int = 1, group: int = 1, at_random: int = 10,
           together: bool = False) -> list[Numbers]:
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
    objectives : int
        How many values a trial has.
    group : int
        Trials that are asked for at once.
    at_random : int
        Most trials at random before the sampler uses what it found.
    together : bool
        Whether the sampler takes all numbers of a trial together, not each by itself.

    Raises
    ------
    UsageError
        If Optuna is not installed, or too old.

    """
    optuna = require_optuna('a search')
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(
        directions=['minimize'] * objectives, sampler=optuna.samplers.TPESampler(
            n_startup_trials=max(1, min(at_random, trials // 4)), seed=seed % _SEEDS,
            multivariate=together))
    for numbers in first:
        study.enqueue_trial(dict(numbers))
    space = {name: optuna.distributions.FloatDistribution(x.low, x.high, log=True)
             for name, x in ranges.items()}
    found: list[Numbers] = []
    while len(found) < trials:
        asked = [study.ask(space) for _ in range(min(group, trials - len(found)))]
        for trial, (values, constraints) in zip(asked, answers([x.params for x in asked])):
            for name, value in constraints.items():
                trial.set_constraint(name, value)
            study.tell(trial, list(values))
            found.append(trial.params)
    return found


def require_optuna(what: str) -> Any:
    """Return the library, or raise `UsageError` that says how to install it."""
    try:
        import optuna
    except ImportError:
        raise UsageError(f"{what} needs Optuna: pip install optuna, or '.[tune]' from the "
                         'checkout') from None
    if int(optuna.__version__.partition('.')[0]) < _OPTUNA:
        raise UsageError(f'{what} needs Optuna {_OPTUNA}, this is {optuna.__version__}: '
                         f"pip install 'optuna>={_OPTUNA}'")
    return optuna
