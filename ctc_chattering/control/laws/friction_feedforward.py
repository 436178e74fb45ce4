"""
Law `friction_feedforward`: computed torque plus the friction of the desired velocity.

Armstrong-Hélouvry, Dupont & Canudas de Wit, *A survey of models, analysis tools and compensation
methods for the control of machines with friction*, Automatica 30(7), 1994. Coulomb's friction has
a given level f and is smoothed::

    τ = M (ddq_d + Kv de + Kp e) + C dq + G + f tanh(dq_d / ε)                                (1)

The added term depends on the reference only, so it cannot make the loop unstable, whatever f. The
linear part is stable if, sampled and with M̂ = c M::

    c h Kv < 2     and     h Kp < 2 Kv                                                        (2)
"""

from __future__ import annotations

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.base import Law, State, Terms
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class FrictionFeedforward(Law):
    """Computed torque with the feedforward (1)."""

    symbol = '-f tanh(dq_d / ε)'

    def configure(self, config: ControllerConfig, period: float) -> None:
        """Use other levels."""
        self._level, self._width = np.array(config.friction_level), config.friction_velocity

    def terms(self, at: State) -> Terms:
        """Return the terms of (1)."""
        return Terms(at.N, self.zero, -self.estimate(at))

    def estimate(self, now: State) -> Array:
        """Return f tanh(dq_d / ε)."""
        friction: Array = self._level * np.tanh(now.dq_d / self._width)
        return friction


#: What the name of this module stands for.
LAW = FrictionFeedforward
