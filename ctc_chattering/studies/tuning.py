"""
The gains of a law as numbers to be searched, and their cost in a comparison.

The cost of gains is the mean over the joints of the weighted sum of ``ln(x / x_0)``, where x is
the RMS error, the torque variation or the largest torque rate, and x_0 the same under
`compensation` with the file's gains in the same condition. It is 0 for these, and 1 for what is e
times worse in everything at weights whose sum is 1. The gains searched are numbers that suit
robots of every size: where joints differ, a number times what the file has for each joint.
"""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any, NamedTuple

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.studies.score import Score

#: Cost of gains with which a run diverges; larger than that of any run that does not.
DIVERGED = 1e3
#: Added to both sides of a ratio, so that 0 is allowed.
_TINY = 1e-12


class Weights(NamedTuple):
    """Weights of the cost: RMS error, torque variation, largest torque rate."""

    error: float = 1.0
    variation: float = 0.5
    rate: float = 0.25


class Budget(NamedTuple):
    """What each law may use: trials, the seed of Optuna's sampler, and the weights."""

    trials: int
    seed: int = 0
    weights: Weights = Weights()


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
    'b': Range(0.1, 10.0, ('compensation', 'chattering', 'super_twisting')),
    'ka': Range(0.5, 20.0, ('chattering', 'observer_feedback')),
    'boundary_layer': Range(1e-3, 1.0, ('boundary_layer',)),
    'observer_bandwidth': Range(20.0, 2000.0, ('implicit_observer',)),
    'ki': Range(1e-3, 0.5, ('integral',)),
    'momentum_gain': Range(10.0, 1000.0, ('momentum_observer',)),
    'super_twisting_k1': Range(1.0, 1000.0, ('super_twisting',)),
    'super_twisting_k2': Range(10.0, 1e5, ('super_twisting',)),
    'adaptation_gain': Range(0.1, 1e4, ('slotine_li',)),
    'friction_velocity': Range(2e-3, 1.0, ('slotine_li', 'friction_feedforward')),
    'estimator_bandwidth': Range(30.0, 400.0, ('observer_feedback',)),
    'friction_learning': Range(1.0, 100.0, ('observer_feedback',))}
#: Laws that get the plant's true Coulomb friction: their best case.
KNOW_FRICTION = ('slotine_li', 'friction_feedforward')


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
    if config.law in KNOW_FRICTION:
        values['friction_level'] = list(friction)
    return values


def starts(config: ControllerConfig, friction: tuple[float, ...], known: Mapping[str, Any]
           ) -> list[dict[str, float]]:
    """
    Return the numbers of the first two trials, within the ranges.

    Parameters
    ----------
    config, friction
        As `gains` has them; their numbers, those of joint 1, are the first.
    known : mapping
        What is recommended for `observer_feedback`, by parameter: of its `kp`, `kv` and `ka`, and
        the triple pole of `integral` and the observer of `chattering` for a robot, are the
        second, with the first for all else.

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
             'observer_bandwidth': config.parameters()['observer_bandwidth'].default}
    return [{name: min(max(x.get(name, file[name]), limits.low), limits.high)
             for name, limits in space(config).items()} for x in ({}, other)]


def _scales(name: str, product: float, config: ControllerConfig, friction: tuple[float, ...]
            ) -> tuple[float, ...]:
    """Return by what a number of one gain is multiplied on each joint, shape (n,)."""
    n = len(config.joint_names)
    return {'ka': tuple(x or 1.0 for x in config.ka), 'ki': (product,) * n,
            'adaptation_gain': tuple(x or 1.0 for x in friction)}.get(name, (1.0,) * n)


def cost(found: Score, base: Score, weights: Weights) -> float:
    """Return the cost of what was found, relative to `base`."""
    if found.failure:
        return DIVERGED
    total = 0.0
    for weight, mine, theirs in zip(weights, (found.rms, found.variation, found.rate),
                                    (base.rms, base.variation, base.rate)):
        total += weight * sum(math.log((x + _TINY) / (y + _TINY))
                              for x, y in zip(mine, theirs)) / len(mine)
    return min(total, DIVERGED) if math.isfinite(total) else DIVERGED
