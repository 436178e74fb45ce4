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
Search by Optuna for gains: the numbers that are searched, what they do over draws, the best.

Trials are asked for and answered in groups of a fixed size, so that the result does not depend on
how many of them run at a time. The numbers suit robots of every size: where joints differ, a
number times what the file has for each joint. Of error and variation the search sees logarithms,
of each limit a constraint.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
import math
from typing import Any, NamedTuple

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import UsageError
from ctc_chattering.runs.score import Score


class Range(NamedTuple):
    """Where a number is searched, on a logarithmic scale, and the law or switching that has it."""

    low: float
    high: float
    of: tuple[str, ...] = ()


#: What is searched. `pole` is p and `damping` d in ``kp = p²``, ``kv = 2 d p``; `ka` and
#: `friction_level` are multiples of the file's, `ki` of ``kp kv``, and `adaptation_gain` of the
#: Coulomb friction.
SPACE: dict[str, Range] = {
    'pole': Range(5.0, 500.0),
    'damping': Range(0.4, 4.0),
    'lambda': Range(1.0, 100.0, ('compensation', 'chattering', 'super_twisting')),
    'ka': Range(0.5, 20.0, ('chattering', 'extended_state_observer', 'observer_feedback')),
    'boundary_layer': Range(1e-3, 1.0, ('boundary_layer',)),
    'observer_bandwidth': Range(20.0, 2000.0, ('implicit_observer',)),
    'ki': Range(1e-3, 0.5, ('integral', 'pid_kalman')),
    'lead_ratio': Range(0.05, 1.0, ('pid_kalman',)),
    'momentum_gain': Range(10.0, 1000.0, ('momentum_observer',)),
    'super_twisting_k1': Range(1.0, 1000.0, ('super_twisting',)),
    'super_twisting_k2': Range(10.0, 1e5, ('super_twisting',)),
    'adaptation_gain': Range(0.1, 1e4, ('slotine_li',)),
    'friction_velocity': Range(2e-3, 1.0, (
        'slotine_li', 'friction_feedforward', 'pid_kalman', 'extended_state_observer')),
    'friction_lead': Range(3e-4, 0.03, ('pid_kalman', 'extended_state_observer')),
    'estimator_bandwidth': Range(30.0, 600.0, (
        'pid_kalman', 'extended_state_observer', 'observer_feedback')),
    'friction_learning': Range(1.0, 100.0, ('observer_feedback',))}


def space(config: ControllerConfig) -> dict[str, Range]:
    """Return what is searched for the law and switching in force."""
    mine = (config.law, config.switching_in_force)
    return {name: x for name, x in SPACE.items() if not x.of or set(x.of) & set(mine)}


def gains(numbers: Mapping[str, float], config: ControllerConfig, friction: tuple[float, ...]
          ) -> dict[str, Any]:
    """
    Return the parameters that the numbers of a trial mean.

    Parameters
    ----------
    numbers : mapping
        Of everything in `space`.
    config : ControllerConfig
        The file's, with the law and switching.
    friction : tuple of float, shape (n,)
        Coulomb friction of the plant [N·m].

    """
    n = len(config.joint_names)
    kp, kv = numbers['pole'] ** 2, 2.0 * numbers['damping'] * numbers['pole']
    values: dict[str, Any] = {'kp': [kp] * n, 'kv': [kv] * n}
    for name in space(config):
        if name not in ('pole', 'damping'):
            x = numbers[name]
            per_joint = config.parameters()[name].shape
            values[name] = [x * y for y in _scales(name, kp * kv, config, friction)
                            ] if per_joint else x
    return values


def starts(config: ControllerConfig, friction: tuple[float, ...], known: Mapping[str, Any],
           ranges: Mapping[str, Range]) -> list[dict[str, float]]:
    """
    Return the numbers of the first two trials, within the ranges.

    Parameters
    ----------
    config, friction
        As `gains` has them; their numbers, those of joint 1, are the first.
    known : mapping
        What is recommended for `observer_feedback`, by parameter: of its `kp`, `kv` and `ka`, and
        the triple pole of `integral` and the observer of `chattering` for a robot, are the
        second, with what suits a reversal of 10 ms, and the first for all else.
    ranges : mapping
        Where to search.

    """
    kp, kv = config.kp[0], config.kv[0]
    values = config.as_mapping()
    file = {'pole': math.sqrt(kp), 'damping': 0.5 * kv / math.sqrt(kp)}
    for name in space(config):
        if name not in file:
            x = values[name]
            file[name] = x[0] / _scales(name, kp * kv, config, friction)[0] if isinstance(
                x, tuple) else x
    pole = math.sqrt(known['kp'][0])
    other = {'pole': pole, 'damping': 0.5 * known['kv'][0] / pole,
             'ka': known['ka'][0] / (config.ka[0] or 1.0), 'ki': 1.0 / 9.0,
             'estimator_bandwidth': known['estimator_bandwidth'],
             'friction_lead': 5e-3, 'friction_velocity': 0.1, 'lead_ratio': 0.1,
             'observer_bandwidth': config.parameters()['observer_bandwidth'].default}
    return [{name: min(max(x[name], limits.low), limits.high) for name, limits in ranges.items()}
            for x in (file, {**file, **other})]


def _scales(name: str, product: float, config: ControllerConfig, friction: tuple[float, ...]
            ) -> tuple[float, ...]:
    """Return by what a number of one gain is multiplied on each joint, shape (n,)."""
    n = len(config.joint_names)
    return {'ka': tuple(x or 1.0 for x in config.ka), 'ki': (product,) * n,
            'adaptation_gain': tuple(x or 1.0 for x in friction)}.get(name, (1.0,) * n)


#: Major version of Optuna from which on trials have constraints.
_OPTUNA = 5
#: Number of seeds of a sampler.
_SEEDS = 2 ** 32
#: Trials that are asked for at once, and most at random before the sampler uses what it found.
_GROUP, _AT_RANDOM = 10, 30
#: Numbers by name, and what they do: two values to be small, and constraints that hold up to 0.
Numbers = dict[str, float]
Answers = Callable[[list[Numbers]], Iterable[tuple[Sequence[float], Mapping[str, float]]]]


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
        If Optuna is not installed, or too old.

    """
    optuna = require_optuna('a search')
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


#: What a trial can violate.
DIVERGED, TORQUE, RATE = CONSTRAINTS = ('diverged', 'torque', 'torque rate')
#: Largest ratio of a torque, or its rate, to a limit that is kept: as much as rounding does.
_WITHIN = 1.0 + 1e-9
#: Least and largest number of which a logarithm is taken.
_LEAST, _LARGEST = 1e-12, 1e9


class Limits(NamedTuple):
    """Largest torque [N·m] and torque rate [N·m/s] of each joint, shape (n,); inf for none."""

    torque: tuple[float, ...]
    rate: tuple[float, ...]


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
    violating : dict of str to int
        By constraint: number of runs that violate it.
    runs : tuple of Score
        Every run, in the order of the draws.

    """

    error: float
    variation: float
    torque: tuple[float, ...]
    rate: tuple[float, ...]
    excess: dict[str, float]
    violating: dict[str, int]
    runs: tuple[Score, ...]

    @property
    def objectives(self) -> tuple[float, float]:
        """Return the logarithms of error and variation."""
        return _logarithm(self.error), _logarithm(self.variation)

    @property
    def product(self) -> float:
        """Return error times variation."""
        return self.error * self.variation

    @property
    def allowed(self) -> bool:
        """Whether no run violates anything."""
        return not any(self.violating.values())


class Trial(NamedTuple):
    """The numbers of a trial, as `tuning.SPACE` has them, and what they do."""

    numbers: dict[str, float]
    score: OverDraws


def over_draws(runs: Sequence[Score], limits: Limits, percentile: float) -> OverDraws:
    """
    Return what gains do over all draws.

    Parameters
    ----------
    runs : sequence of Score
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
    for name, most, values in ((TORQUE, limits.torque, [x.peak for x in good]),
                               (RATE, limits.rate, [x.peak_rate for x in good])):
        ratios = [max(x / y for x, y in zip(row, most)) for row in values]
        excess[name] = max(ratios, default=1.0) - _WITHIN
        violating[name] = sum(ratio > _WITHIN for ratio in ratios)
        largest[name] = tuple(map(max, zip(*values))) or (math.inf,) * n
    return OverDraws(percentile_of([x.error for x in runs], percentile),
                     percentile_of([x.most_variation for x in runs], percentile),
                     largest[TORQUE], largest[RATE], excess, violating, tuple(runs))


def percentile_of(values: Sequence[float], percentile: float) -> float:
    """Return the least of `values` that `percentile` % of them do not exceed."""
    return sorted(values)[max(0, math.ceil(percentile / 100.0 * len(values) - 1e-9) - 1)]


def _logarithm(value: float) -> float:
    return math.log(min(max(value, _LEAST), _LARGEST))


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
