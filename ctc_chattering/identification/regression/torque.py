"""The torque over a window: commands with delay and lag of the drives, or measured effort."""

from __future__ import annotations

from ctc_chattering.analysis.recording import Indices, Stretch
from ctc_chattering.identification.regression.weak_form import TestFunction
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.signal import lfilter  # type: ignore[import-untyped]

#: Sources of the torque.
COMMAND, EFFORT = 'command', 'effort'


def lagged(values: Array, lag: Array, period: float) -> Array:
    """
    Return the mean torque of drives with a lag over each period, shape (N, n) [N·m].

    A command is held for a period h, and the torque follows it with the lag T; with a = exp(-h/T)
    the mean over a period is c[k] + (T/h) (1 - a) (τ[k] - c[k]), and τ[k+1] = a τ[k] + (1-a) c[k].

    Parameters
    ----------
    values : ndarray, shape (N, n)
        Commands c [N·m].
    lag : ndarray, shape (n,)
        T [s].
    period : float
        h [s].

    """
    lag = np.broadcast_to(lag, values.shape[1:])
    if not lag.any():
        return values
    ratio = period / np.maximum(lag, 1e-3 * period)
    a = np.exp(-ratio)
    share = (1.0 - a) / ratio
    total = np.column_stack([
        lfilter([1.0], [1.0, -decay], column) for decay, column in zip(a, values.T)])
    before = np.concatenate((np.zeros_like(values[:1]), total[:-1]))
    mean: Array = (1.0 - share) * values + share * (1.0 - a) * before
    return np.where(lag > 0.0, mean, values)


def has(stretch: Stretch, source: str) -> Array | None:
    """Return the torques of a source in a stretch, shape (N, n); None without."""
    return stretch.command if source == COMMAND else stretch.effort


def weak_torque(values: Array, delay: float, lag: Array, period: float, phi: TestFunction,
                centres: Indices) -> Array:
    """
    Return ∫ φ tau dt over each window, shape (J, n) [N·m].

    Parameters
    ----------
    values : ndarray, shape (N, n)
        Torque of each sample [N·m].
    delay : float
        Samples after which a torque acts: over the period from sample k + `delay` on. An effort
        that shows the torque of the period before has -1, one at the instant between both -0.5.
    lag : ndarray, shape (n,)
        T [s].
    period : float
        h [s].
    phi, centres
        Test function, and samples at the centres of the windows.

    """
    filtered = lagged(values, lag, period)
    whole = int(np.floor(delay))
    found = phi.sums(filtered, phi.over, centres - whole)
    if delay != whole:
        found = 0.5 * (found + phi.sums(filtered, phi.over, centres - whole - 1))
    return found
