"""
Search for gains with little error and little torque variation, within limits, by Optuna.

Trials are asked for and answered in groups of a fixed size, so that the result does not depend on
how many of them run at a time. The sampler sees logarithms of error and variation, and each limit
as a constraint.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import math
from typing import NamedTuple

from ctc_chattering.errors import UsageError
from ctc_chattering.studies.tuning import Range, require_optuna

#: What a trial can violate.
DIVERGED, TORQUE, RATE = CONSTRAINTS = ('diverged', 'torque', 'torque rate')
#: Major version of Optuna from which on trials have constraints.
_OPTUNA = 5
#: Number of seeds of a sampler.
_SEEDS = 2 ** 32
#: Trials that are asked for at once; and most trials at random before the sampler uses what it
#: found.
_GROUP, _AT_RANDOM = 10, 30
#: Largest ratio of a torque, or its rate, to a limit that is kept: as much as rounding does.
_WITHIN = 1.0 + 1e-9
#: Least and largest number of which a logarithm is taken.
_LEAST, _LARGEST = 1e-12, 1e9


class Measured(NamedTuple):
    """
    The numbers of a run; n joints.

    The largest RMS error [rad] and torque variation [N·m/s] of any joint in the window; the
    largest torque [N·m] and torque rate [N·m/s] of each joint in the whole run, shape (n,). If it
    diverged, `failure` says why.
    """

    error: float
    variation: float
    torque: tuple[float, ...]
    rate: tuple[float, ...]
    failure: str = ''


class Limits(NamedTuple):
    """Largest torque [N·m] and torque rate [N·m/s] of each joint, shape (n,); inf for none."""

    torque: tuple[float, ...]
    rate: tuple[float, ...]


class Score(NamedTuple):
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
    violating : dict of str to int
        By constraint: number of runs that violate it.
    runs : tuple of Measured
        Every run, in the order of the draws.

    """

    error: float
    variation: float
    torque: tuple[float, ...]
    rate: tuple[float, ...]
    excess: dict[str, float]
    violating: dict[str, int]
    runs: tuple[Measured, ...]

    @property
    def allowed(self) -> bool:
        """Whether no run violates anything."""
        return not any(self.violating.values())


class Trial(NamedTuple):
    """The numbers of a trial, as `tuning.SPACE` has them, and what they do."""

    numbers: dict[str, float]
    score: Score


def score(runs: Sequence[Measured], limits: Limits, percentile: float) -> Score:
    """
    Return what gains do over all draws.

    Parameters
    ----------
    runs : sequence of Measured
        One a draw.
    limits : Limits
        Of every run.
    percentile : float
        Part of the runs that error and variation do not exceed [%]; 100 for the worst run.

    """
    good = [x for x in runs if not x.failure]
    n = len(limits.torque)
    excess = {DIVERGED: 1.0 - len(good) / len(runs)}
    violating = {DIVERGED: len(runs) - len(good)}
    largest = {}
    for name, most, values in ((TORQUE, limits.torque, [x.torque for x in good]),
                               (RATE, limits.rate, [x.rate for x in good])):
        ratios = [max(x / y for x, y in zip(row, most)) for row in values]
        excess[name] = max(ratios, default=1.0) - _WITHIN
        violating[name] = sum(ratio > _WITHIN for ratio in ratios)
        largest[name] = tuple(map(max, zip(*values))) or (math.inf,) * n
    return Score(percentile_of([x.error for x in runs], percentile),
                 percentile_of([x.variation for x in runs], percentile),
                 largest[TORQUE], largest[RATE], excess, violating, tuple(runs))


def percentile_of(values: Sequence[float], percentile: float) -> float:
    """Return the least of `values` that `percentile` % of them do not exceed."""
    return sorted(values)[max(0, math.ceil(percentile / 100.0 * len(values) - 1e-9) - 1)]


def search(scores: Callable[[list[dict[str, float]]], Sequence[Score]],
           ranges: Mapping[str, Range], first: Sequence[Mapping[str, float]], trials: int,
           seed: int = 0) -> list[Trial]:
    """
    Return the trials of a search, in their order.

    Parameters
    ----------
    scores : callable
        What each of some numbers does.
    ranges : mapping
        Where to search.
    first : sequence of mapping
        Numbers with which to begin.
    trials : int
        How many, those of `first` included.
    seed : int
        Of the sampler.

    Raises
    ------
    UsageError
        If Optuna is not installed, or too old.

    """
    optuna = require_optuna('ctc tune')
    if int(optuna.__version__.partition('.')[0]) < _OPTUNA:
        raise UsageError(f'ctc tune needs Optuna {_OPTUNA}, this is {optuna.__version__}: '
                         f"pip install 'optuna>={_OPTUNA}'")
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(directions=['minimize'] * 2, sampler=optuna.samplers.TPESampler(
        n_startup_trials=max(1, min(_AT_RANDOM, trials // 4)), seed=seed % _SEEDS))
    for numbers in first:
        study.enqueue_trial(dict(numbers))
    space = {name: optuna.distributions.FloatDistribution(x.low, x.high, log=True)
             for name, x in ranges.items()}
    found: list[Trial] = []
    while len(found) < trials:
        asked = [study.ask(space) for _ in range(min(_GROUP, trials - len(found)))]
        for trial, result in zip(asked, scores([x.params for x in asked])):
            for name, value in result.excess.items():
                trial.set_constraint(name, value)
            study.tell(trial, [_logarithm(result.error), _logarithm(result.variation)])
            found.append(Trial(trial.params, result))
    return found


def _logarithm(value: float) -> float:
    return math.log(min(max(value, _LEAST), _LARGEST))


def front(scores: Sequence[Score]) -> list[int]:
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


def knee(scores: Sequence[Score]) -> int:
    """
    Return which of some scores has the smallest product of error and torque variation.

    On a front that is where one per cent less error costs one per cent more variation.
    """
    return min(range(len(scores)), key=lambda k: scores[k].error * scores[k].variation)
