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
Measurement of the robot's state.

`plant_step.advance_plant` measures each sample with `measured`, from the true state and from
random numbers that `plant.py` draws. The position is rounded to multiples of the resolution.
The velocity x is the true one (`exact`), or the difference of two measured positions over one
period (`difference`), each with noise. `filtered` is the latter behind a low-pass of first order::

    y[k] = y[k-1] + (1 - exp(-ω h)) (x[k] - y[k-1]),   y[0] = x[0]                        (SE1)
"""

from __future__ import annotations

from math import expm1
from random import Random
from typing import NamedTuple

from ctc_chattering.compiled.compilable import function, record, some
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np

#: A smaller step of an encoder is none: dividing by it would overflow.
_MIN_RESOLUTION = 1e-300
#: From this number of steps on, rounding is finer than a float resolves.
_MAX_STEPS = 1e15


@record
class Encoders(NamedTuple):
    """Sensors, with parameters of `PlantConfig` by name, shape (n,)."""

    #: Step of the position, 0 for none [rad].
    encoder_resolution: Array
    #: Standard deviations [rad, rad/s].
    position_noise: Array
    velocity_noise: Array
    #: 1 - exp(-ω h) of (SE1), 1 without a low-pass.
    gain: float
    #: h [s].
    period: float
    #: True where the velocity is the true one, apart from noise.
    exact: bool


@record
class Measured(NamedTuple):
    """Measured position [rad] and velocity [rad/s], each of shape (n,)."""

    q: Array
    dq: Array


def encoders_of(config: PlantConfig, period: float) -> Encoders:
    """Return the sensors of a configuration."""
    filtered = config.velocity_sensor == 'filtered'
    return config.select(
        Encoders, gain=-expm1(-config.velocity_cutoff * period) if filtered else 1.0,
        period=period, exact=config.velocity_sensor == 'exact')


def draw_noise(random: Random, deviation: Array) -> Array:
    """Draw a normal number for each deviation that is not 0."""
    return np.array([random.gauss(0.0, 1.0) if x else 0.0 for x in deviation.tolist()])


def measured_at_start(encoders: Encoders, random: Random, q: Array, dq: Array) -> Measured:
    """
    Return the first measurement.

    The measurement before it is of the position that leads here at this velocity.
    """
    previous = Measured(q, dq)
    if not encoders.exact:
        noise = draw_noise(random, encoders.position_noise)
        position = q - encoders.period * dq + encoders.position_noise * noise
        previous = Measured(quantised(position, encoders.encoder_resolution), dq)
    return measured(encoders._replace(gain=1.0), previous, q, dq, encoders.period,
                    draw_noise(random, encoders.position_noise),
                    draw_noise(random, encoders.velocity_noise))


@function
def quantised(x: Array, step: Array) -> Array:
    """Return the multiples of `step` nearest to x."""
    rounds = step > _MIN_RESOLUTION
    ratio = x / np.where(rounds, step, 1.0)
    return np.where(rounds & (np.abs(ratio) < _MAX_STEPS), step * np.rint(ratio), x)


@function
def off_the_grid(q: Array, dq: Array, previous_dq: Array, offset: float, period: float
                 ) -> tuple[Array, Array]:
    """
    Return q and dq at `offset` after a sample.

    Parameters
    ----------
    q, dq : array, shape (n,)
        Position [rad] and velocity [rad/s] at the sample.
    previous_dq : array, shape (n,)
        Velocity a period earlier [rad/s]. The mean acceleration since then goes on.
    offset, period : float
        Times [s].

    """
    change = offset / period * (dq - previous_dq)
    return q + offset * (dq + 0.5 * change), dq + change


@function
def measured(encoders: Encoders, previous: Measured, q: Array, dq: Array, elapsed: float,
             position_noise: Array, velocity_noise: Array) -> Measured:
    """
    Return what the sensors show of a state.

    Parameters
    ----------
    encoders : Encoders
        Parameters.
    previous : Measured
        The measurement a sample earlier.
    q, dq : array, shape (n,)
        Position [rad] and velocity [rad/s].
    elapsed : float
        Time since the previous measurement [s].
    position_noise, velocity_noise : array, shape (n,)
        Standard normal numbers.

    """
    q = q + encoders.position_noise * position_noise
    if some(encoders.encoder_resolution):
        q = quantised(q, encoders.encoder_resolution)
    if not encoders.exact:
        dq = (q - previous.q) / elapsed
    dq = dq + encoders.velocity_noise * velocity_noise
    if encoders.gain < 1.0:
        dq = previous.dq + encoders.gain * (dq - previous.dq)                         # (SE1)
    return Measured(q, dq)
