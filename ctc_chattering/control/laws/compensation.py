"""
Law `compensation`, equation (2) of the paper: computed torque and compensation.

::

    τ = M (ddq_d + Kv de + Kp e) + C dq + G - C v                                             (2)

With M̂ = c M in the place of M the sampled linear part is stable for c h Kv < 2 and h Kp < 2 Kv.
Friction is not cancelled: v settles where λ M v balances it.
"""

from __future__ import annotations

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.base import Law, State, Terms


class Compensation(Law):
    """Law (2)."""

    of_the_paper = acts_on_v = True

    def configure(self, config: ControllerConfig, period: float) -> None:
        """Do nothing: the gains are in the state."""

    def terms(self, at: State) -> Terms:
        """Return the terms of (2)."""
        return Terms(at.N, at.C.dot(at.v), self.zero)


#: What the name of this module stands for.
LAW = Compensation
