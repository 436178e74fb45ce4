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

"""What a robot's sensors make of its state: encoders, velocity and noise, reproducibly."""

from __future__ import annotations

from math import expm1
from random import Random
from typing import NamedTuple

from ctc_chattering.compiled.compilable import function, record, some
from ctc_chattering.numerics.linear_algebra import Array, Vector
import numpy as np

#: Values of the parameter ``velocity_sensor``.
VELOCITY_SENSORS = ('exact', 'difference', 'filtered')


@record
class Encoders(NamedTuple):
    """Parameters of the sensors; vectors of shape (n,), truth values 1.0 and 0.0."""

    #: Step of the position [rad], 0 for none, and standard deviations of noise [rad, rad/s].
    resolution: Array
    position_noise: Array
    velocity_noise: Array
    #: 1 - exp(-ω h) of the low-pass, 1 for none, and h [s].
    gain: float
    period: float
    #: Whether the velocity is the true one, but for noise.
    exact: float


@record
class Measured(NamedTuple):
    """Position [rad] and velocity [rad/s] as measured, each of shape (n,)."""

    q: Array
    dq: Array


@function
def quantised(x: Array, step: Array) -> Array:
    """Return the multiples of `step` nearest to x; x where rounding is coarser, or without one."""
    ratio = x / np.where(step > 1e-300, step, 1.0)
    return np.where((step > 1e-300) & (np.abs(ratio) < 1e15), step * np.rint(ratio), x)


@function
def off_the_grid(q: Array, dq: Array, before: Array, offset: float, period: float
                 ) -> tuple[Array, Array]:
    """
    Return q and dq, shape (n,), at `offset` [s] after a sample.

    Parameters
    ----------
    q, dq, before : array, shape (n,)
        Position [rad] and velocity [rad/s] at the sample, and the velocity a period before; the
        mean acceleration in between goes on.
    offset, period : float
        [s].

    """
    change = offset / period * (dq - before)
    return q + offset * (dq + 0.5 * change), dq + change


@function
def measured(sensor: Encoders, before: Measured, q: Array, dq: Array, elapsed: float,
             position_noise: Array, velocity_noise: Array) -> Measured:
    """
    Return what the sensors show.

    Parameters
    ----------
    sensor, before : Encoders, Measured
        Parameters, and what they showed a sample before.
    q, dq : array, shape (n,)
        Position [rad] and velocity [rad/s].
    elapsed : float
        Since the measurement before [s].
    position_noise, velocity_noise : array, shape (n,)
        Noise of the deviation 1.

    """
    q = q + sensor.position_noise * position_noise
    if some(sensor.resolution):
        q = quantised(q, sensor.resolution)
    if not sensor.exact:
        dq = (q - before.q) / elapsed
    dq = dq + sensor.velocity_noise * velocity_noise
    if sensor.gain < 1.0:
        dq = before.dq + sensor.gain * (dq - before.dq)
    return Measured(q, dq)


class Sensor:
    """
    The sensors of a robot: their parameters, noise and first measurement.

    The velocity is the true one (`exact`), or the difference of two measured positions over one
    period (`difference`), then with noise, and `filtered` behind a low-pass of first order::

        y[k] = y[k-1] + (1 - exp(-ω h)) (x[k] - y[k-1]),   y[0] = x[0]

    The position before the first is where the state at the start comes from at its velocity.

    Parameters
    ----------
    resolution : sequence of float, shape (n,)
        Step of the position encoders [rad]; 0 for none.
    position_noise, velocity_noise : sequence of float, shape (n,)
        Standard deviations of white Gaussian noise [rad, rad/s].
    seed : int
        The same seed gives the same noise.
    velocity : str
        One of `VELOCITY_SENSORS`.
    cutoff : float
        ω of the low-pass [rad/s].
    period : float
        h [s].

    """

    def __init__(self, resolution: Vector, position_noise: Vector, velocity_noise: Vector,
                 seed: int, velocity: str = 'exact', cutoff: float = 1.0, period: float = 1.0
                 ) -> None:
        self.encoders = Encoders(
            np.array(resolution), np.array(position_noise), np.array(velocity_noise),
            -expm1(-cutoff * period) if velocity == 'filtered' else 1.0, period,
            float(velocity == 'exact'))
        self.random = Random(seed)

    def first(self, q: Array, dq: Array) -> Measured:
        """Return what is measured of the state at the start, with noise of its own."""
        sensor = self.encoders
        before = Measured(q, dq)
        if not sensor.exact:
            last = q - sensor.period * dq + sensor.position_noise * self.noise(
                sensor.position_noise)
            before = Measured(quantised(last, sensor.resolution), dq)
        return measured(sensor._replace(gain=1.0), before, q, dq, sensor.period,
                        self.noise(sensor.position_noise), self.noise(sensor.velocity_noise))

    def noise(self, deviation: Array) -> Array:
        """Return noise of the deviation 1 where there is any; nothing else is drawn."""
        return np.array([self.random.gauss(0.0, 1.0) if s else 0.0 for s in deviation.tolist()])
