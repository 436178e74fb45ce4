"""Switching `implicit_observer`: `implicit` with an estimate P̂ of the perturbation."""

from __future__ import annotations

from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.perturbation_observer import PerturbationObserver
from ctc_chattering.control.switching.implicit import Implicit
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array


class ImplicitObserver(Implicit):
    """
    The term of `Implicit` for w - P̂ in the place of w; the whole term stays within ±Ka.

    Parameters
    ----------
    ka : array, shape (n,)
        Gains [N·m].
    filter_ : ErrorFilter
        Whose coefficients predict v.
    observer : PerturbationObserver
        Estimates the perturbation.

    """

    observer: PerturbationObserver

    def __init__(self, ka: Array, filter_: ErrorFilter, observer: PerturbationObserver) -> None:
        super().__init__(ka, filter_)
        self.observer = observer

    def term(self, v: Array, u: Array, mass: Array, compensation: Array
             ) -> tuple[Array, Array | None]:
        """Return z for the estimated perturbation, and its clipping error."""
        unclipped = self.unclipped(v, u, mass, compensation) - self.observer.estimate
        z = nearest(mass, unclipped, self._ka)
        return z, None if z is unclipped else unclipped - z
