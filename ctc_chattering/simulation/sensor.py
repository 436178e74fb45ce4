"""What a robot's sensors make of its state: encoder resolution and noise, reproducibly."""

from __future__ import annotations

from math import isfinite
from random import Random

from ctc_chattering.numerics.linear_algebra import Vector


class Sensor:
    """
    Turns states into measurements, one after the other.

    Parameters
    ----------
    resolution : sequence of float, shape (n,)
        Step of the position encoders [rad]; 0 for none.
    position_noise, velocity_noise : sequence of float, shape (n,)
        Standard deviations of white Gaussian noise [rad, rad/s].
    seed : int
        The same seed gives the same noise.

    """

    def __init__(self, resolution: Vector, position_noise: Vector, velocity_noise: Vector,
                 seed: int) -> None:
        self._resolution = resolution
        self._position, self._velocity = position_noise, velocity_noise
        self._gauss = Random(seed).gauss
        self.perfect = not (any(resolution) or any(position_noise) or any(velocity_noise))

    def measure(self, q: Vector, dq: Vector) -> tuple[Vector, Vector]:
        """Return position [rad] and velocity [rad/s] as measured, each of shape (n,)."""
        if self.perfect:
            return q, dq
        gauss = self._gauss
        q = [x + gauss(0.0, s) if s else x for x, s in zip(q, self._position)]
        return ([r * round(x / r) if r and isfinite(x / r) else x
                 for x, r in zip(q, self._resolution)],
                [x + gauss(0.0, s) if s else x for x, s in zip(dq, self._velocity)])
