"""The perturbation P of a run, which the chattering term must hold, and its prediction."""

from __future__ import annotations

import dataclasses

from ctc_chattering.identification.regression.identify import Identification
from ctc_chattering.identification.regression.least_squares import (
    Data,
    Fit,
    stribeck_velocity,
    TermKind,
)
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt

#: Part of the friction that an unexplained torque may have on a run not used for the fit.
_GOOD = 0.05


@dataclasses.dataclass(frozen=True)
class MeasuredPerturbation:
    """
    P over the windows of a run; J windows, n joints.

    Attributes
    ----------
    t : ndarray, shape (J,)
        Centres of the windows [s].
    measured, predicted : ndarray, shape (J, n)
        Torque less the model's, and friction plus errors of the model as identified, nan where a
        joint does not slide [N·m].
    envelope : ndarray, shape (J, n)
        Largest |P| that what was identified allows at the state of a window, at a stop or
        a break-away as well [N·m].

    """

    t: Array
    measured: Array
    predicted: Array
    envelope: Array

    @property
    def peak(self) -> Array:
        """Largest |P| of each joint, measured or allowed, shape (n,) [N·m]."""
        found: Array = np.maximum(np.abs(self.measured).max(axis=0), self.envelope.max(axis=0))
        return found

    def misfit(self) -> tuple[Array, Array]:
        """Return the RMS of P and of what is not predicted of it, each of shape (n,) [N·m]."""
        known = np.isfinite(self.predicted)
        count = np.maximum(known.sum(axis=0), 1)
        rest = np.where(known, self.measured - np.where(known, self.predicted, 0.0), 0.0)
        whole = np.where(known, self.measured, 0.0)
        return (np.sqrt(np.square(whole).sum(axis=0) / count),
                np.sqrt(np.square(rest).sum(axis=0) / count))

    def good(self) -> npt.NDArray[np.bool_]:
        """Return for which joints what was identified predicts P, shape (n,)."""
        whole, rest = self.misfit()
        found: npt.NDArray[np.bool_] = rest <= _GOOD * whole
        return found


def perturbation(found: Identification, data: Data | None = None) -> MeasuredPerturbation:
    """
    Return P of the identified run, or of another one.

    Parameters
    ----------
    found : Identification
        What was identified.
    data : Data, optional
        Windows of the other run, with the same joints and errors of the model.

    """
    fit, data = found.selected.fit, data or found.data
    # The slopes of Stribeck columns are 0, and in the fit for the sake of intervals.
    predicted = np.where(data.used(), data.columns(fit.terms) @ fit.value, np.nan)
    return MeasuredPerturbation(data.t, data.residual, predicted, _envelope(fit, data))


def _envelope(fit: Fit, data: Data) -> Array:
    """Return the largest |P| that the fit allows in each window, shape (J, n)."""
    n = data.way.shape[1]
    error = np.zeros_like(data.way)
    friction = np.zeros_like(data.way)
    level = np.zeros(n)
    for term, value in zip(fit.terms, fit.value):
        i = term.joint
        if term.kind == TermKind.MODEL:
            error += value * data.more[:, :, int(term.which)]
        elif term.kind == TermKind.SCALE:
            error += value * data.columns([term])[:, :, 0]
        elif term.kind in (TermKind.FORWARDS, TermKind.BACKWARDS):
            level[i] = max(level[i], abs(value))
        elif term.kind == TermKind.VISCOUS:
            friction[:, i] += value * np.abs(data.velocity[:, i])
        elif term.kind == TermKind.LOAD:
            friction[:, i] += value * data.load[:, i]
        elif term.kind == TermKind.STRIBECK:
            speed = np.abs(data.velocity[:, i]) / stribeck_velocity(term.which)
            friction[:, i] += value * np.exp(-np.square(speed))
    return np.abs(error) + friction + level
