"""
Law `pd_gravity`: a PD controller for each joint, with gravity compensated.

Takegaki & Arimoto, *A new feedback method for dynamic control of manipulators*, ASME J. Dynamic
Systems, Measurement and Control 103, 1981. The gains are Kp and Kv times the inertia
D_i = 1 / (M⁻¹)_ii that a joint has while the others are free, so that the same numbers suit every
robot::

    τ = diag(D) (Kp e + Kv de) + G                                                            (1)

At a constant q_d all positive definite Kp, Kv make e = 0 asymptotically stable (locally; globally
where D is constant). In motion e is not 0, since M ddq_d + C dq is left out. The eigenvalues of
M⁻¹ diag(D) are n or less, so that sampled, with diagonal gains, the loop is stable if::

    h Kv < 2 / n     and     h Kp < 2 Kv                                                      (2)
"""

from __future__ import annotations

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.base import free_inertia, Law, State, Terms


class PdGravity(Law):
    """PD with gravity."""

    def configure(self, config: ControllerConfig, period: float) -> None:
        """Do nothing: the gains are in the state."""

    def terms(self, at: State) -> Terms:
        """Return the terms of (1)."""
        return Terms(free_inertia(at.M) * at.u + at.G, self.zero, self.zero)


#: What the name of this module stands for.
LAW = PdGravity
