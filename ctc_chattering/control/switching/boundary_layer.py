"""Switching `boundary_layer`: a slope in the place of the jump."""

from __future__ import annotations

from ctc_chattering.control.switching.base import Switching
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class BoundaryLayer(Switching):
    """
    Ka sat(v / width).

    Parameters
    ----------
    ka : array, shape (n,)
        Gains [N·m].
    width : float
        Half the width of the layer around v = 0 [rad/s].

    """

    def __init__(self, ka: Array, width: float) -> None:
        self._ka, self._width = ka, width

    def term(self, v: Array, u: Array, mass: Array, compensation: Array) -> tuple[Array, None]:
        """Return Ka sat(v / width)."""
        del u, mass, compensation
        return self._ka * np.minimum(np.maximum(v / self._width, -1.0), 1.0), None
