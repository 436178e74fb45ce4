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
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.parameters import matrix
import numpy as np

#: Largest product of `observer_bandwidth` and the lag of the drives.
LAG_RATIO = 0.3
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
