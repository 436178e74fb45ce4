"""Encoders and velocity as `simulation/sensor.py` has them."""

from __future__ import annotations

import dataclasses

from ctc_chattering.batch.compiler import compiled, inlined
from ctc_chattering.batch.random_numbers import gauss
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np


@dataclasses.dataclass
class SensorSettings:
    """Parameters of the sensors; arrays of shape (n,)."""

    #: Whether position and velocity are measured as they are, and the velocity as it is.
    perfect: bool
    exact: bool
    resolution: Array
    position_noise: Array
    velocity_noise: Array
    #: Gain of the low-pass, 1 for none, and sample period [s].
    gain: float
    period: float


@dataclasses.dataclass
class SensorState:
    """What the sensors remember, and what they show; arrays of shape (n,)."""

    q: Array
    dq: Array
    #: Positions measured last, and whether there are any.
    last: Array
    begun: int
    #: Of the low-pass, and whether it has begun.
    output: Array
    filtering: int
    #: Of `gauss`.
    kept: Array


def sensor_settings(config: PlantConfig, period: float) -> SensorSettings:
    """Return the numbers of a configuration, with the sample period [s]."""
    exact = config.velocity_sensor == 'exact'
    perfect = exact and not (any(config.encoder_resolution) or any(config.position_noise)
                             or any(config.velocity_noise))
    gain = -np.expm1(-config.velocity_cutoff * period
                     ) if config.velocity_sensor == 'filtered' else 1.0
    return SensorSettings(
        perfect, exact, np.array(config.encoder_resolution), np.array(config.position_noise),
        np.array(config.velocity_noise), gain, period)


def sensor_state(n: int) -> SensorState:
    """Return the state at the start."""
    zero = np.zeros(n)
    return SensorState(zero, zero, zero, 0, zero, 0, np.zeros(2))


@inlined
def quantised(x: float, step: float) -> float:
    """Return the multiple of `step` nearest to `x`; a step of 0 is none."""
    return float(step * np.rint(x / step)) if step and np.isfinite(x / step) else x


@inlined
def encoder(x: float, i: int, c: SensorSettings, s: SensorState, source: np.random.Generator
            ) -> float:
    """Return a position as encoder `i` has it."""
    if c.position_noise[i]:
        x += c.position_noise[i] * gauss(source, s.kept)
    return quantised(x, c.resolution[i])


@compiled
def measure(q: Array, dq: Array, c: SensorSettings, s: SensorState, source: np.random.Generator
            ) -> None:
    """Set position [rad] and velocity [rad/s] as measured, each of shape (n,)."""
    n = len(q)
    if c.perfect:
        for i in range(n):
            s.q[i], s.dq[i] = q[i], dq[i]
        return
    if not c.exact and not s.begun:
        s.begun = 1
        for i in range(n):
            s.last[i] = encoder(q[i] - c.period * dq[i], i, c, s, source)
    for i in range(n):
        s.q[i] = encoder(q[i], i, c, s, source)
    for i in range(n):
        v = dq[i]
        if not c.exact:
            v, s.last[i] = (s.q[i] - s.last[i]) / c.period, s.q[i]
        if c.velocity_noise[i]:
            v += c.velocity_noise[i] * gauss(source, s.kept)
        if c.gain < 1.0:
            if s.filtering:
                v = s.output[i] + c.gain * (v - s.output[i])
            s.output[i] = v
        s.dq[i] = v
    s.filtering = 1
