"""The contract of a switching: a way to evaluate the chattering term of law (6)."""

from __future__ import annotations

from abc import ABC, abstractmethod

from ctc_chattering.control.perturbation_observer import PerturbationObserver
from ctc_chattering.numerics.linear_algebra import Array


class Switching(ABC):
    """
    Evaluates the chattering term z in the place of Ka sgn(v).

    Attributes
    ----------
    observer : PerturbationObserver or None
        What estimates the perturbation for the term, kept up to date by the control step.

    """

    observer: PerturbationObserver | None = None

    @abstractmethod
    def term(self, v: Array, u: Array, mass: Array, compensation: Array
             ) -> tuple[Array, Array | None]:
        """
        Return z and its clipping error, each of shape (n,) [N·m]; |z| is within Ka.

        Parameters
        ----------
        v : array, shape (n,)
            Filtered error [rad/s].
        u : array, shape (n,)
            Kv de + Kp e [rad/s²].
        mass : array, shape (n, n)
            M [kg·m²].
        compensation : array, shape (n,)
            C v [N·m].

        Returns
        -------
        z : array
        clipping_error : array or None
            What the bound ±Ka has taken from the term, for the observer; None for nothing.

        """
