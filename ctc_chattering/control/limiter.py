"""
Limits of the torque and of its rate, and the anti-windup of the filter (3).

The saturation error, what the limits take from the torque, acts in the closed loop (8) like a
perturbation: over one period it changes v by -b h M⁻¹ times itself. Added to ξ with the opposite
sign, it leaves v as it would be without limits.
"""

from __future__ import annotations

from math import inf

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class Limiter:
    """
    Limits torques, one after the other.

    Parameters
    ----------
    n : int
        Number of joints.

    Attributes
    ----------
    held : array, shape (n,)
        Torque sent last [N·m].

    """

    def __init__(self, n: int) -> None:
        self.held: Array = np.zeros(n)

    def configure(self, effort: Array, change: Array, anti_windup: float) -> None:
        """
        Set the limits; the torque sent last is preserved.

        Parameters
        ----------
        effort : array, shape (n,)
            Largest torque [N·m]; inf for unlimited.
        change : array, shape (n,)
            Largest change of the torque within one period [N·m]; inf for unlimited.
        anti_windup : float
            b h of the filter [s]; 0 for no anti-windup.

        """
        self._effort, self._change, self._anti_windup = effort, change, anti_windup
        self._active = min(effort.min(), change.min()) < inf

    def reset(self, held: Array) -> None:
        """Go on from the torque `held`, shape (n,) [N·m]."""
        self.held = held

    def limit(self, unsaturated: Array) -> tuple[Array, Array | None]:
        """Return the torque to send and the saturation error, (n,) [N·m]; None where it is 0."""
        tau, saturation_error = unsaturated, None
        if self._active:
            low, high = self.held - self._change, self.held + self._change
            tau = np.minimum(np.maximum(unsaturated, low), high)
            tau = np.minimum(np.maximum(tau, -self._effort), self._effort)
            if (tau != unsaturated).any():
                saturation_error = unsaturated - tau
        self.held = tau
        return tau, saturation_error

    def correction(self, mass: Array, saturation_error: Array | None) -> Array | None:
        """Return the anti-windup correction of ξ and v, (n,) [rad/s]; None where it is 0."""
        if saturation_error is None or not self._anti_windup:
            return None
        return self._anti_windup * np.asarray(np.linalg.solve(mass, saturation_error), float)
