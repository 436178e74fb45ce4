"""
Law `slotine_li`: the passivity-based adaptive law; what it adapts is the level of friction.

Slotine & Li, *On the adaptive control of robot manipulators*, IJRR 6(3), 1987, with Coulomb's
friction f as the one unknown parameter of each joint::

    dq_r = dq_d + Λ e,     ddq_r = ddq_d + Λ de,     s = dq_r - dq = de + Λ e                 (1)
    τ[k] = M ddq_r + C dq_r + G + K s + f̂[k] tanh(dq_r / ε)                                   (2)
    f̂[k+1] = max(0, f̂[k] + h Γ tanh(dq_r / ε) s[k])                                           (3)

Λ = Kv⁻¹ Kp and K = diag(D) Kv, so that K s = diag(D) (Kv de + Kp e), with the inertia
D_i = 1 / (M⁻¹)_ii that a joint has while the others are free: the same gains suit every robot. A
joint whose torque is at its limit does not adapt. The regressor has the velocity dq_r, not the
measured one, whose sign rattles near rest. V = ½ sᵀ M s + ½ Σ (f - f̂)² / Γ falls for ε → 0::

    dV/dt = -sᵀ K s + Σ f_i (sgn dq_i - sgn dq_r,i) (dq_r,i - dq_i)  ≤  -sᵀ K s               (4)

since sgn is monotone; with ε > 0 a rest of at most 0.28 f ε per joint remains. The eigenvalues of
M⁻¹ diag(D) are n or less: sampled, with diagonal gains, s and f̂ are stable if::

    h Γ < K_ii     and     h Kv < 2 / n                                                       (5)
"""

from __future__ import annotations

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.laws.base import free_inertia, Law, State, Terms, Torque
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import matrix
import numpy as np

#: Part of the level that the friction of a joint must show for the level to be taken from it.
_MOVING = 0.5


class SlotineLi(Law):
    """The adaptive law with the levels f̂ [N·m]."""

    symbol = '-f̂ tanh(dq_r / ε)'

    def __init__(self, filter_: ErrorFilter) -> None:
        super().__init__(filter_)
        self._level = self._given = self.zero

    def configure(self, config: ControllerConfig, period: float) -> None:
        """Use other gains; f̂ is preserved unless another level is given."""
        n = len(self.zero)
        self._slope = np.linalg.pinv(matrix(config.kv, n)).dot(matrix(config.kp, n))
        self._width = config.friction_velocity
        self._gain = period * np.array(config.adaptation_gain)
        self._anti_windup = config.anti_windup
        given = np.array(config.friction_level)
        if (given != self._given).any():
            self._level = self._given = given

    def reset(self) -> None:
        """Set f̂ to the given level."""
        self._level = self._given

    def initialize(self, now: State, estimate: Array | None) -> None:
        """Take f̂ from the estimate on joints that move; without one, go on from the last own."""
        if estimate is not None:
            y = self._regressor(now)
            moving = np.abs(y) > _MOVING
            self._level = np.where(
                moving, np.maximum(estimate / np.where(moving, y, 1.0), 0.0), self._level)

    def terms(self, at: State) -> Terms:
        """Return the terms of (2)."""
        ddq_r, dq_r = at.ddq_d + self._slope.dot(at.de), at.dq_d + self._slope.dot(at.e)
        model = at.M.dot(ddq_r) + at.C.dot(dq_r) + at.G + free_inertia(at.M) * at.u
        return Terms(model, self.zero, -self._level * self._regressor(at))

    def advance(self, now: State, applied: Torque, correction: Array | None) -> None:
        """Adapt f̂ by (3)."""
        change = self._gain * self._regressor(now) * (now.de + self._slope.dot(now.e))
        if applied.saturation_error is not None and self._anti_windup:
            change = np.where(applied.saturation_error == 0.0, change, 0.0)
        self._level = np.maximum(self._level + change, 0.0)

    def estimate(self, now: State) -> Array:
        """Return f̂ tanh(dq_r / ε)."""
        return self._level * self._regressor(now)

    def _regressor(self, at: State) -> Array:
        """Return tanh(dq_r / ε), shape (n,)."""
        y: Array = np.tanh((at.dq_d + self._slope.dot(at.e)) / self._width)
        return y


#: What the name of this module stands for.
LAW = SlotineLi
