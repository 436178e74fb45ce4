"""
Law `chattering`, equation (6) of the paper: computed torque, compensation and chattering.

::

    τ = M (ddq_d + Kv de + Kp e) + C dq + G - C v - z                                         (6)

with z in the place of Ka sgn(v), evaluated by one of `control/switching`. v reaches 0 and stays
there if Ka exceeds the perturbation on every joint. docs/theory.md derives the sampled loop, and
what it tolerates.
"""

from __future__ import annotations

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.laws.base import Law, State, Terms, Torque
from ctc_chattering.control.perturbation_observer import PerturbationObserver
from ctc_chattering.control.switching import make_switching
from ctc_chattering.control.switching.base import Switching
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class Chattering(Law):
    """
    Law (6).

    Attributes
    ----------
    observer : PerturbationObserver
        Of switching implicit_observer.

    """

    symbol = 'chattering term z'
    of_the_paper = acts_on_v = True
    _switching: Switching

    def __init__(self, filter_: ErrorFilter) -> None:
        super().__init__(filter_)
        self.observer = PerturbationObserver(len(filter_.state))

    def configure(self, config: ControllerConfig, period: float) -> None:
        """Use another switching or other gains; the estimate is preserved."""
        self._ka = np.array(config.ka)
        self.observer.configure(config.observer_bandwidth, period, config.b, self._ka)
        self._switching = make_switching(
            config.switching, self._ka, config.boundary_layer, self.filter, self.observer)

    def reset(self) -> None:
        """Forget the estimate."""
        self.observer.reset()

    def initialize(self, now: State, estimate: Array | None) -> None:
        """Go on from the estimate of the other law, within ±Ka; without one, from the last own."""
        if estimate is not None:
            self.observer.estimate = nearest(now.M, estimate, self._ka)

    def update(self, now: State) -> None:
        """Improve the estimate, if the switching uses it."""
        if self._switching.observer is not None:
            self.observer.update(now.v)

    def terms(self, at: State) -> Terms:
        """Return the terms of (6)."""
        compensation = at.C.dot(at.v)
        z, clipping_error = self._switching.term(at.v, at.u, at.M, compensation)
        return Terms(at.N, compensation, z, clipping_error)

    def advance(self, now: State, applied: Torque, correction: Array | None) -> None:
        """Predict the next sample for the observer."""
        if self._switching.observer is not None:
            self.observer.predict(
                now.M, self.filter.nominal_response(now.v, now.u, correction),
                now.N - applied.tau, applied.terms.clipping_error)

    def estimate(self, now: State) -> Array | None:
        """Return P̂ of switching implicit_observer."""
        return None if self._switching.observer is None else self.observer.estimate


#: What the name of this module stands for.
LAW = Chattering
