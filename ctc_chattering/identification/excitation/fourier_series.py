"""
Finite Fourier series that begin and end at rest, for motions that excite a robot.

Swevers, Ganseman, Tükel, De Schutter & Van Brussel, "Optimal robot excitation and identification",
IEEE Transactions on Robotics and Automation 13 (1997) 730-740.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class FourierSeries(NamedTuple):
    """
    One series per joint: dq(t) = Σ a_k cos(k ω t) + b_k sin(k ω t), with q(0) = 0, k = 1 … K.

    Attributes
    ----------
    cosines, sines : ndarray, shape (n, K)
        a_k and b_k [rad/s].
    period : float
        2π / ω [s].

    """

    cosines: Array
    sines: Array
    period: float

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration, each (N, n), at the times `t`, (N,) [s]."""
        rate = 2.0 * np.pi / self.period * np.arange(1, self.cosines.shape[1] + 1)
        angle = np.outer(t, rate)
        c, s = np.cos(angle), np.sin(angle)
        a, b = self.cosines.T, self.sines.T
        return ((s / rate) @ a + ((1.0 - c) / rate) @ b, c @ a + s @ b,
                (c * rate) @ b - (s * rate) @ a)

    def scaled(self, factors: Array) -> FourierSeries:
        """Return each joint's series times one of `factors`, shape (n,)."""
        return FourierSeries(self.cosines * factors[:, np.newaxis],
                             self.sines * factors[:, np.newaxis], self.period)


def random_series(rng: np.random.Generator, n: int, harmonics: int, period: float
                  ) -> FourierSeries:
    """
    Return a random series per joint that is at rest, without acceleration, at t = 0 and `period`.

    Its mean is q(0): b_k / k adds up to 0, as a_k does for the velocity and k b_k for the
    acceleration at rest.

    Parameters
    ----------
    rng : Generator
        Source of the coefficients.
    n, harmonics : int
        Number of joints and of harmonics K, at least 3.
    period : float
        Time that the motion takes [s].

    """
    k = np.arange(1.0, harmonics + 1.0)
    a, b = rng.standard_normal((2, n, harmonics)) * np.sqrt(k)
    return FourierSeries(_without(a, np.ones((1, harmonics))), _without(b, np.array([1.0 / k, k])),
                         period)


def _without(rows: Array, constraints: Array) -> Array:
    """Return the rows less their part along the `constraints`: the products with these are 0."""
    part: Array = rows @ np.linalg.pinv(constraints) @ constraints
    return rows - part
