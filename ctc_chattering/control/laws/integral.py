"""
Law `integral`: computed torque with integral action.

Siciliano, Sciavicco, Villani & Oriolo, *Robotics: Modelling, Planning and Control*, 2009, sec.
8.5, with an integral in the feedback; back-calculation as in Åström & Hägglund, *PID Controllers*,
1995, sec. 3.5. Sampled, with x the integral::

    τ[k]   = M (ddq_d + Kv de + Kp e + x[k]) + C dq + G                                       (1)
    x[k+1] = x[k] + h Ki e[k] - (1 - exp(-h / T)) M⁻¹ s[k],      T_i = Kp_ii / Ki_i           (2)

s is the saturation error, what the limits took from the torque: x tracks what they allow within
the integral time T. Without saturation and friction, e obeys ddde + Kv dde + Kp de + Ki e = 0,
which is stable if and only if, on every joint (Hurwitz)::

    Ki < Kv Kp                                                                                (3)

A triple pole at -p has Kv = 3 p, Kp = 3 p², Ki = p³. In a sampled loop (1) with M̂ = c M needs
c h Kv < 2 as well.
"""

from __future__ import annotations

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.laws.base import Law, State, Terms, Torque
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import matrix
import numpy as np


class Integral(Law):
    """Computed torque with the integral x [rad/s²]."""

    symbol = '-M ∫ Ki e dt'

    def __init__(self, filter_: ErrorFilter) -> None:
        super().__init__(filter_)
        self._x = self.zero

    def configure(self, config: ControllerConfig, period: float) -> None:
        """Use other gains; x is preserved, so that another Ki makes no step."""
        ki, n = np.array(config.ki), len(self.zero)
        self._gain = period * ki
        self._tracking = -np.expm1(-period * ki / np.diag(matrix(config.kp, n)))
        self._anti_windup = config.anti_windup

    def reset(self) -> None:
        """Set x = 0."""
        self._x = self.zero

    def initialize(self, now: State, estimate: Array | None) -> None:
        """Set x so that it cancels the estimated perturbation."""
        self._x = self.zero
        if estimate is not None:
            self._x = np.asarray(np.linalg.solve(now.M, estimate), float)

    def terms(self, at: State) -> Terms:
        """Return the terms of (1)."""
        return Terms(at.N, self.zero, -at.M.dot(self._x))

    def advance(self, now: State, applied: Torque, correction: Array | None) -> None:
        """Advance x by (2)."""
        self._x = self._x + self._gain * now.e
        if applied.saturation_error is not None and self._anti_windup:
            lost = np.linalg.solve(now.M, applied.saturation_error)
            self._x = self._x - self._tracking * lost

    def estimate(self, now: State) -> Array:
        """Return M x, which is P where e is at rest."""
        perturbation: Array = now.M.dot(self._x)
        return perturbation


#: What the name of this module stands for.
LAW = Integral
