"""
The level of Coulomb's friction, learned from what an observer still has to add.

Where the level K̂ is too low by ΔK, the estimate P̂ jumps by 2 ΔK, delayed by the observer, when
the velocity changes its sign. K̂ follows the correlation of P̂ with the sign of the velocity,
delayed alike (three lags of the observer's bandwidth ω), both above the frequency w₀::

    dK̂/dt = γ y φ,     y = HP(P̂),     φ = HP(LP³(sgn dq̂)),     0 <= K̂ <= Ka

The high-pass keeps slow errors of the model out, and a friction that grows with the velocity. A
joint at rest, or one that does not turn back, teaches nothing.
"""

from __future__ import annotations

from math import exp

import numpy as np

from ctc_chattering.numerics.linear_algebra import Array

#: w₀ [rad/s].
_SLOW = 60.0
#: Velocity that counts as motion [rad/s].
_MOVING = 2e-3


class FrictionLevel:
    """
    Learns the level of friction of every joint.

    Parameters
    ----------
    level : array, shape (n,)
        K̂ at the start [N·m].

    Attributes
    ----------
    level : array, shape (n,)
        K̂ [N·m].

    """

    def __init__(self, level: Array) -> None:
        self.reset(level)

    def reset(self, level: Array) -> None:
        """Begin again at the level K̂, shape (n,) [N·m]."""
        self.level = level
        #: Of the sign of the velocity: outputs of the three lags, and slow parts of φ and y.
        self._lags = np.zeros((3, len(level)))
        self._slow = np.zeros((2, len(level)))

    def configure(self, gain: float, bandwidth: float, period: float, bound: Array) -> None:
        """Set γ [1/s], ω [rad/s], h [s] and Ka, shape (n,) [N·m]; K̂ is preserved."""
        self._gain, self._bound = gain * period, bound
        self._follow, self._forget = 1.0 - exp(-bandwidth * period), 1.0 - exp(-_SLOW * period)

    def learn(self, dq: Array, perturbation: Array) -> None:
        """Improve K̂ by dq̂ [rad/s] and P̂ [N·m], shape (n,), of one sample."""
        x = np.sign(dq) * (np.abs(dq) > _MOVING)
        for lag in self._lags:
            lag += self._follow * (x - lag)
            x = lag
        signals = np.array((x, perturbation))
        self._slow += self._forget * (signals - self._slow)
        fast = signals - self._slow
        change = self._gain * fast[0] * fast[1]
        self.level = np.minimum(np.maximum(self.level + change, 0.0), self._bound)
