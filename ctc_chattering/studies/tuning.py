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
The gains of a law as numbers to be searched.

They suit robots of every size: where joints differ, a number times what the file has for each
joint.
"""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any, NamedTuple

from ctc_chattering.control.controller import ControllerConfig


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
        second, with what suits a reversal of 10 ms, and the first for all else.

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
    return [{name: min(max(x.get(name, file[name]), limits.low), limits.high)
             for name, limits in space(config).items()} for x in ({}, other)]


def _scales(name: str, product: float, config: ControllerConfig, friction: tuple[float, ...]
            ) -> tuple[float, ...]:
    """Return by what a number of one gain is multiplied on each joint, shape (n,)."""
    n = len(config.joint_names)
    return {'ka': tuple(x or 1.0 for x in config.ka), 'ki': (product,) * n,
            'adaptation_gain': tuple(x or 1.0 for x in friction)}.get(name, (1.0,) * n)
