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

from ctc_chattering.numerics.compilable import along, each, function, record, uniform
from ctc_chattering.numerics.linear_algebra import Vector

#: Values of the parameter ``velocity_sensor``.
VELOCITY_SENSORS = ('exact', 'difference', 'filtered')


@record
class Encoders(NamedTuple):
    """Parameters of the sensors; vectors of shape (n,), truth values 1.0 and 0.0."""

    #: Step of the position [rad], 0 for none, and standard deviations of noise [rad, rad/s].
    resolution: Vector
    position_noise: Vector
    velocity_noise: Vector
    #: 1 - exp(-ω h) of the low-pass, 1 for none, and h [s].
    gain: float
    period: float
    #: Whether the velocity is the true one, and all else as well.
    exact: float
    perfect: float


@record
class Measured(NamedTuple):
    """Position [rad] and velocity [rad/s] as measured, each of shape (n,)."""

    q: Vector
    dq: Vector


@function
def quantised(x: float, step: float) -> float:
    """Return the multiple of `step` nearest to x; x where rounding is coarser, or without one."""
    return step * round(x / step) if step and abs(x / step) < 1e15 else x


@function
def encoder(x: float, step: float, deviation: float, noise: float) -> float:
    """Return a position as an encoder has it; `noise` is of the deviation 1."""
    return quantised(x + deviation * noise, step)


@function
def difference(x: float, last: float, period: float) -> float:
    """Return the velocity between two positions."""
    return (x - last) / period


@function
def noisy(x: float, deviation: float, noise: float) -> float:
    """Return x with noise; `noise` is of the deviation 1."""
    return x + deviation * noise


@function
def low_pass(y: float, x: float, gain: float) -> float:
    """Return the next output after y."""
    return y + gain * (x - y)


@function
def off_the_grid(q: Vector, dq: Vector, before: Vector, offset: float, period: float
                 ) -> tuple[Vector, Vector]:
    """
    Return q and dq, shape (n,), at `offset` [s] after a sample.

    Parameters
    ----------
    q, dq, before : sequence of float, shape (n,)
        Position [rad] and velocity [rad/s] at the sample, and the velocity a period before; the
        mean acceleration in between goes on.
    offset, period : float
        [s].

    """
    change = along(dq, -1.0, before)
    mean = along(dq, 0.5 * offset / period, change)
    return along(q, offset, mean), along(dq, offset / period, change)


@function
def measured(sensor: Encoders, before: Measured, q: Vector, dq: Vector, elapsed: float,
             position_noise: Vector, velocity_noise: Vector) -> Measured:
    """
    Return what the sensors show.

    Parameters
    ----------
    sensor, before : Encoders, Measured
        Parameters, and what they showed a sample before.
    q, dq : sequence of float, shape (n,)
        Position [rad] and velocity [rad/s].
    elapsed : float
        Since the measurement before [s].
    position_noise, velocity_noise : sequence of float, shape (n,)
        Noise of the deviation 1.

    """
    if sensor.perfect:
        return Measured(q, dq)
    q = each(encoder, q, sensor.resolution, sensor.position_noise, position_noise)
    if not sensor.exact:
        dq = each(difference, q, before.q, uniform(elapsed))
    dq = each(noisy, dq, sensor.velocity_noise, velocity_noise)
    if sensor.gain < 1.0:
        dq = each(low_pass, before.dq, dq, uniform(sensor.gain))
    return Measured(q, dq)


class Sensor:
    """
    Turns states into measurements, one for each sample.

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
        exact = velocity == 'exact'
        self.perfect = exact and not (
            any(resolution) or any(position_noise) or any(velocity_noise))
        self.encoders = Encoders(
            resolution, position_noise, velocity_noise,
            -expm1(-cutoff * period) if velocity == 'filtered' else 1.0, period, float(exact),
            float(self.perfect))
        self.random = Random(seed)
        self.shown: Measured | None = None

    def measure(self, q: Vector, dq: Vector, elapsed: float = 0.0) -> tuple[Vector, Vector]:
        """Return `measured` after `elapsed` [s], 0 for a period, with noise of its own."""
        if self.perfect:
            return q, dq
        sensor, before = self.encoders, self.shown
        if before is None:
            before = Measured(q, dq)
            if not sensor.exact:
                last = [x - sensor.period * v for x, v in zip(q, dq)]
                before = Measured(each(encoder, last, sensor.resolution, sensor.position_noise,
                                       self.noise(sensor.position_noise)), dq)
            sensor = sensor._replace(gain=1.0)
        self.shown = measured(
            sensor, before, q, dq, elapsed or sensor.period, self.noise(sensor.position_noise),
            self.noise(sensor.velocity_noise))
        return self.shown

    def noise(self, deviation: Vector) -> Vector:
        """Return noise of the deviation 1 where there is any; nothing else is drawn."""
        return [self.random.gauss(0.0, 1.0) if s else 0.0 for s in deviation]
