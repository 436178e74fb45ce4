"""Numbers that sum a run up."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ctc_chattering.numerics.gaps import missing
from ctc_chattering.simulation.closed_loop import Array, Run

#: Part of a run over which errors and torques are evaluated [s].
WINDOW = (5.0, 10.0)
#: Band of |v_i| that counts as reached [rad/s].
BAND = 0.15


def metrics(run: Run, window: tuple[float, float] = WINDOW, band: float = BAND,
            period: float | None = None) -> dict[str, Any]:
    """
    Return the numbers of one run, as they stand in ``metrics.json``.

    Parameters
    ----------
    run : Run
        Any length. Torques that are not known are not finite.
    window : (float, float)
        First and last instant of the samples evaluated [s].
    band : float
        Band of |v_i| for the reaching time [rad/s].
    period : float, optional
        Sample period [s]. The torque variation is then that of the samples with none missing
        in between; without it, neighbours are neighbours whatever their times.

    Returns
    -------
    dict
        ``rms_error_rad``, ``rms_torque_nm`` and ``torque_variation_nm_per_s`` per joint,
        ``max_error_norm1_rad``, ``window_s``, ``reaching_time_s`` and ``missing_samples``, the
        number of samples missing in the window; None where the run has no sample in the window,
        nan for the torque of a joint where none is known.

    """
    inside = within(run.t, window)
    result: dict[str, Any] = {
        'window_s': list(window), 'rms_error_rad': None, 'max_error_norm1_rad': None,
        'rms_torque_nm': None, 'torque_variation_nm_per_s': None,
        'reaching_time_s': reaching_time(run.t, run.v, band), 'missing_samples': None}
    if inside.sum() > 1:
        e, tau, t = (run.q_d - run.q)[inside], run.tau[inside], run.t[inside]
        gaps = missing(t, period) if period else np.zeros(len(t) - 1, np.int64)
        result.update(
            rms_error_rad=rms(e).tolist(),
            max_error_norm1_rad=float(np.abs(e).sum(axis=1).max()),
            rms_torque_nm=[float(rms(x[np.isfinite(x)])) if np.isfinite(x).any() else np.nan
                           for x in tau.T],
            torque_variation_nm_per_s=_variation(t, tau, gaps == 0).tolist(),
            missing_samples=int(gaps.sum()))
    return result


def within(t: Array, window: tuple[float, float]) -> npt.NDArray[np.bool_]:
    """Return which of the times `t`, shape (N,) [s], are in the window, its ends included."""
    return (t >= window[0] - 1e-9) & (t <= window[1] + 1e-9)


def _variation(t: Array, tau: Array, neighbours: npt.NDArray[np.bool_]) -> Array:
    """Return Σ|Δτ| over Σ Δt of the known torques of neighbours, shape (n,); nan without any."""
    step = np.abs(np.diff(tau, axis=0))
    known = np.isfinite(step) & neighbours[:, np.newaxis]
    time = np.where(known, np.diff(t)[:, np.newaxis], 0.0).sum(axis=0)
    way: Array = np.where(known, step, 0.0).sum(axis=0)
    return way / np.where(time > 0.0, time, np.nan)


def rms(x: Array) -> Array:
    """Return the root of the mean square of each column, shape (n,)."""
    mean: Array = np.mean(np.square(x), axis=0)
    return np.sqrt(mean)


def reaching_time(t: Array, v: Array, band: float = BAND) -> float | None:
    """
    Return the first time [s] from which every |v_i| stays within `band` to the end.

    None if the last sample is outside, or there is none.
    """
    outside = np.flatnonzero(~(np.abs(v) <= band).all(axis=1))
    if not len(t) or (len(outside) and outside[-1] == len(t) - 1):
        return None
    return float(t[outside[-1] + 1] if len(outside) else t[0])
