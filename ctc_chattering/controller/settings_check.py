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
Settings of a law with which it is worse than law `compensation`, as far as they alone show it.

`actuator_lag` T and `torque_rate_limit` say what is known of the drives; no lag and no limit, as
by default, are taken for ideal drives.

- Switching ``implicit_observer``: the term rattles where ω T exceeds `LAG_RATIO` (measured).
- Law ``integral``: a joint with a lag has the poles of T s⁴ + s³ + Kv s² + Kp s + Ki, and is
  unstable for Ki >= Kp (Kv - T Kp) (Routh).
- Laws without a bound of what they estimate: drives with a limited rate that they do not know
  let the estimate grow, until the loop diverges (measured).

docs/safety.md has the measurements, and the conditions that settings do not show.

A number that is set while the controller runs changes by at most a factor of `FACTOR` at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil, inf, log
from typing import Any

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.parameters import matrix, Parameter
import numpy as np

#: Largest product of `observer_bandwidth` and the lag of the drives.
LAG_RATIO = 0.3
#: Largest factor by which a number changes at once.
FACTOR = 100.0
#: Laws without a bound of what they estimate.
UNBOUNDED = ('integral', 'momentum_observer', 'super_twisting')


def unsafe_settings(config: ControllerConfig) -> Iterator[str]:
    """Yield a line for each condition of this module that `config` meets."""
    if config.switching_in_force == 'implicit_observer':
        ratio = config.observer_bandwidth * max(config.known_lag)
        if ratio > LAG_RATIO:
            yield (f'observer_bandwidth times actuator_lag is {ratio:.2g}; the term rattles '
                   f'above {LAG_RATIO:g}')
    if config.law == 'integral':
        n, lag = len(config.joint_names), np.array(config.known_lag)
        kp, kv = (np.array(matrix(x, n)).diagonal() for x in (config.kp, config.kv))
        for name, ki, most in zip(config.joint_names, config.ki, kp * (kv - lag * kp)):
            if ki >= most:
                yield f'{name}: ki is {ki:g}; the loop is unstable from {max(most, 0.0):g} on'
    if config.law in UNBOUNDED and any(
            ours > drives for ours, drives in zip(
                config.effort_rate_limit, config.torque_rate_limit)):
        yield ('effort_rate_limit exceeds torque_rate_limit; where drives are slower than the '
               f'torque that is sent, the estimate of {config.law} grows')


def check_change(before: ControllerConfig, after: ControllerConfig) -> None:
    """Raise `ParameterError` if a number changes by more than `FACTOR` at once."""
    n = len(before.joint_names)
    for name, spec in before.parameters().items():
        first, *more = change_steps(spec, getattr(before, spec.field), getattr(after, spec.field),
                                    n)
        if more:
            shown = [float(f'{x:.3g}') for x in np.ravel(first)]
            raise ParameterError(name, getattr(after, spec.field), (
                f'a change by a factor of at most {FACTOR:g} at once; if you mean it, set '
                f'{shown if isinstance(first, tuple) else shown[0]} first'))


def change_steps(spec: Parameter, before: Any, after: Any, n: int) -> list[Any]:
    """
    Return the values by which a parameter changes from one to another.

    Who asks for a larger change than `FACTOR` confirms it by setting them all, one after another.

    Parameters
    ----------
    spec : Parameter
        Of `ControllerConfig`.
    before, after : object
        In force, and wanted.
    n : int
        Number of joints.

    Returns
    -------
    list
        `after`, and before it steps of at most `FACTOR` that lead there; from 0 a factor counts
        from the default, or from 1. What becomes 0, or is or becomes infinite, needs none.

    """
    if before == after or spec.read_only or spec.kind not in ('float', 'float[]'):
        return [after]
    full = spec.shape == 'nn' and len(after) != n
    old, new = (np.diagonal(matrix(x, n)) if spec.shape == 'nn' else np.atleast_1d(x)
                for x in (before, after))
    default = spec.default if 0.0 < spec.default < inf else 1.0
    with np.errstate(all='ignore'):
        last = np.log(np.abs(new))
        change = last - np.log(np.abs(np.where(old == 0.0, default, old)))
    change[~np.isfinite(change)] = 0.0
    count = max(1, ceil(np.abs(change).max() / log(1.01 * FACTOR)))
    diagonals = [np.exp(last - change * (1.0 - k / count)) for k in range(1, count)]
    steps = [matrix(after, n) * np.sqrt(np.outer(x / new, x / new)) if full else x
             for x in diagonals]
    return [tuple(map(float, x.ravel())) if isinstance(after, tuple) else float(x[0])
            for x in steps] + [after]


def missing_limits(config: ControllerConfig, of_model: Vector) -> str:
    """
    Return a line that names the joints without a limit, for a warning at the start; '' for none.

    Parameters
    ----------
    config : ControllerConfig
        As at the start.
    of_model : sequence of float, shape (n,)
        `Model.effort_limits`.

    """
    limits = {'effort_limit': config.largest_torque(of_model)}
    if config.takes('torque_rate_limit'):
        limits['torque_rate_limit'] = config.torque_rate_limit
    return '; '.join(
        f'{name} is infinite for {", ".join(joints)}' for name, values in limits.items()
        if (joints := [x for x, limit in zip(config.joint_names, values) if limit == inf]))
