"""Switching `sign`: the paper's term, discontinuous at v = 0."""

from __future__ import annotations

from ctc_chattering.control.switching.base import Switching
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class Sign(Switching):
    """
    Ka sgn(v), with sgn(0) = 0 as in the paper.

    Parameters
    ----------
    ka : array, shape (n,)
        Gains [N·m].

    """

    def __init__(self, ka: Array) -> None:
        self._ka = ka

    def term(self, v: Array, u: Array, mass: Array, compensation: Array) -> tuple[Array, None]:
        """Return Ka sgn(v)."""
        del u, mass, compensation
        return self._ka * np.sign(v), None
