"""What a robot's sensors make of its state: encoders, velocity and noise, reproducibly."""

from __future__ import annotations

from math import expm1, isfinite
from random import Random

from ctc_chattering.numerics.linear_algebra import Vector

#: Values of the parameter ``velocity_sensor``.
VELOCITY_SENSORS = ('exact', 'difference', 'filtered')


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
        self._resolution = resolution
        self._position, self._velocity = position_noise, velocity_noise
        self._gauss = Random(seed).gauss
        self._exact, self._period = velocity == 'exact', period
        self._gain = -expm1(-cutoff * period) if velocity == 'filtered' else 1.0
        self._last: Vector | None = None
        self._output: Vector | None = None
        self.perfect = self._exact and not (
            any(resolution) or any(position_noise) or any(velocity_noise))

    def measure(self, q: Vector, dq: Vector) -> tuple[Vector, Vector]:
        """Return position [rad] and velocity [rad/s] as measured, each of shape (n,)."""
        if self.perfect:
            return q, dq
        h, gauss = self._period, self._gauss
        if self._last is None and not self._exact:
            self._last = self._encoders([x - h * v for x, v in zip(q, dq)])
        q = self._encoders(q)
        if self._last is not None:
            dq, self._last = [(x - last) / h for x, last in zip(q, self._last)], q
        dq = [x + gauss(0.0, s) if s else x for x, s in zip(dq, self._velocity)]
        if self._gain < 1.0:
            dq = [y + self._gain * (x - y) for x, y in zip(dq, self._output or dq)]
            self._output = dq
        return q, dq

    def _encoders(self, q: Vector) -> list[float]:
        q = [x + self._gauss(0.0, s) if s else x for x, s in zip(q, self._position)]
        return quantised(q, self._resolution)


def quantised(x: Vector, step: Vector) -> list[float]:
    """Return the multiples of `step` that are nearest to `x`, shape (n,); a step of 0 is none."""
    return [r * round(a / r) if r and isfinite(a / r) else a for a, r in zip(x, step)]
