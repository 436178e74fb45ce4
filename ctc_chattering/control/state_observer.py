"""
An observer of position, velocity and perturbation that is driven by position and torque.

Its model has the drives (`drive_model`), so that it knows the torque that acts, and Coulomb's
friction f of the level K̂, implicit as in docs/theory.md. Over a period::

    f ∈ K̂ Sgn(dq⁺),   a = M⁻¹ (τ - C dq - G - f - P̂),   dq⁺ = dq + h a,   P̂⁺ = P̂ + h Ṗ̂     (1)

and q⁺ likewise, each with its own mean of τ and P̂ over the period. The measured position
corrects this; the velocity is not measured. With ε = q - q̂ and θ = exp(-ω h)::

    q̂  += (1 - θ⁴) ε
    dq̂ += (1 - θ)² (11 + 14 θ + 11 θ²) ε / (6 h)
    P̂  -= M 2 (1 - θ)³ (1 + θ) ε / h²
    Ṗ̂  -= M (1 - θ)⁴ ε / h³                                                             (2)

which puts the four poles of the error at θ: the cubic fading-memory filter (Morrison 1969).
The slope Ṗ̂ leaves of a perturbation of the frequency w, for w « ω, 6 (w / ω)²; without it there
would be 3 w / ω. P̂ is within ±Ka in the metric of M⁻¹; at a bound, Ṗ̂ does not lead out.
"""

from __future__ import annotations

from math import exp
from typing import NamedTuple

import numpy as np

from ctc_chattering.control.drive_model import DriveModel
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array


class Observed(NamedTuple):
    """A state of robot and drives; arrays of shape (n,)."""

    #: Position [rad] and velocity [rad/s].
    q: Array
    dq: Array
    #: Torque of the drives [N·m].
    torque: Array
    #: P̂ [N·m] and its slope [N·m/s].
    perturbation: Array
    slope: Array


class StateObserver:
    """
    Estimates the state, sample by sample.

    Parameters
    ----------
    drives : DriveModel
        Between command and torque.
    bandwidth : float
        ω [rad/s].
    period : float
        h [s].
    bound : array, shape (n,)
        Ka [N·m].

    """

    def __init__(self, drives: DriveModel, bandwidth: float, period: float, bound: Array) -> None:
        self._drives, self._period, self._bound = drives, period, bound
        h, pole = period, exp(-bandwidth * period)
        rest = 1.0 - pole
        self._position = 1.0 - pole ** 4
        self._velocity = rest ** 2 * (11.0 + 14.0 * pole + 11.0 * pole ** 2) / (6.0 * h)
        self._acceleration = 2.0 * rest ** 3 * (1.0 + pole) / h ** 2
        self._jerk = rest ** 4 / h ** 3

    def predict(self, at: Observed, mass: Array, bias: Array, level: Array, command: Array
                ) -> Observed:
        """
        Return the state a period later, by (1).

        Parameters
        ----------
        at : Observed
            The state now.
        mass, bias : array, shape (n, n) and (n,)
            M [kg·m²] and C dq + G [N·m] there.
        level : array, shape (n,)
            K̂ [N·m].
        command : array, shape (n,)
            Torque commanded for the period [N·m].

        """
        h, drive = self._period, self._drives.response(at.torque, command)
        load = bias + at.perturbation
        mean = drive.mean - (load + 0.5 * h * at.slope)
        friction = nearest(mass, mass.dot(at.dq) / h + mean, level)
        weighted = drive.weighted - (load + h / 3.0 * at.slope)
        a, weighted = np.linalg.solve(
            mass, np.array((mean - friction, weighted - friction)).T).T
        return Observed(at.q + h * at.dq + 0.5 * h * h * weighted, at.dq + h * a, drive.end,
                        at.perturbation + h * at.slope, at.slope)

    def correct(self, at: Observed, mass: Array, q: Array) -> Observed:
        """Return the state with what the measured position `q`, shape (n,) [rad], says, by (2)."""
        error = q - at.q
        force = mass.dot(error)
        P, slope = (at.perturbation - self._acceleration * force, at.slope - self._jerk * force)
        bounded = nearest(mass, P, self._bound)
        leads_out = (np.abs(bounded) >= self._bound) & (slope * bounded > 0.0)
        return Observed(at.q + self._position * error, at.dq + self._velocity * error, at.torque,
                        bounded, np.where(leads_out, 0.0, slope))
