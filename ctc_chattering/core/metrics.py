"""Numbers that sum a run up."""

from __future__ import annotations

from typing import Any

import numpy as np

from ctc_chattering.core.simulation import Array, Run

#: Part of a run over which errors and torques are judged [s].
WINDOW = (5.0, 10.0)
#: Band of |v_i| that counts as reached [rad/s].
BAND = 0.15


def metrics(run: Run, window: tuple[float, float] = WINDOW, band: float = BAND) -> dict[str, Any]:
    """
    Return the numbers of one run, as they stand in ``metrics.json``.

    Parameters
    ----------
    run : Run
        Any length.
    window : (float, float)
        First and last instant of the samples judged [s].
    band : float
        Band of |v_i| for the reaching time [rad/s].

    Returns
    -------
    dict
        ``rms_error_rad``, ``rms_torque_nm`` and ``torque_variation_nm_per_s`` per joint,
        ``max_error_norm1_rad``, ``window_s`` and ``reaching_time_s``; None where the run has no
        sample in the window.

    """
    inside = (run.t >= window[0] - 1e-9) & (run.t <= window[1] + 1e-9)
    result: dict[str, Any] = {
        'window_s': list(window), 'rms_error_rad': None, 'max_error_norm1_rad': None,
        'rms_torque_nm': None, 'torque_variation_nm_per_s': None,
        'reaching_time_s': reaching_time(run.t, run.v, band)}
    if inside.sum() > 1:
        e, tau, t = (run.q_d - run.q)[inside], run.tau[inside], run.t[inside]
        variation = np.abs(np.diff(tau, axis=0)).sum(axis=0) / (t[-1] - t[0])
        result.update(
            rms_error_rad=rms(e).tolist(),
            max_error_norm1_rad=float(np.abs(e).sum(axis=1).max()),
            rms_torque_nm=rms(tau).tolist(),
            torque_variation_nm_per_s=variation.tolist())
    return result


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
