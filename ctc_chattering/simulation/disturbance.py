"""The external perturbation d(t) of the plant (1): d_i = amplitude_i sin(frequency_i t)."""

from __future__ import annotations

from math import sin

from ctc_chattering.numerics.linear_algebra import Vector


def disturbance(amplitude: Vector, frequency: Vector, t: float) -> list[float]:
    """
    Return d(t), shape (n,) [N·m].

    Parameters
    ----------
    amplitude : sequence of float, shape (n,)
        [N·m].
    frequency : sequence of float, shape (n,)
        [rad/s].
    t : float
        Time [s].

    """
    return [a * sin(w * t) for a, w in zip(amplitude, frequency)]
