# Copyright 2026 The ctc_chattering maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Numbers that sum a run up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ctc_chattering.analysis.signals import Series
from ctc_chattering.numerics.time_grid import missing
from ctc_chattering.simulation.closed_loop import Array, Run
import numpy as np
import numpy.typing as npt

#: Part of a run over which errors and torques are evaluated [s], and the least of it that a run
#: must have.
WINDOW = (5.0, 10.0)
_LEAST_WINDOW = 0.5
#: Band of |v_i| that counts as reached [rad/s].
BAND = 0.15
#: Part of the amplitude of a joint's desired motion above which its RMS error is worth a warning.
WARN_ERROR_SHARE = 0.1
#: How much the torque of each joint changes.
_CHANGES = ('torque_variation_nm_per_s', 'max_torque_step_nm', 'max_torque_rate_nm_per_s')


def window_of(t: Array) -> tuple[float, float]:
    """Return `WINDOW`, or the second half of a run that has too little of it, for times [s]."""
    if not len(t):
        return WINDOW
    begin, end = float(t[0]), float(t[-1])
    if min(end, WINDOW[1]) - max(begin, WINDOW[0]) >= _LEAST_WINDOW - 1e-9:
        return WINDOW
    return begin + 0.5 * (end - begin), end


def metrics(run: Run, window: tuple[float, float] = WINDOW, band: float = BAND,
            period: float | None = None, torque: Series | None = None,
            v: Series | None = None) -> dict[str, Any]:
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
        Sample period [s]. Variation, steps and rates of the torque are then those of the
        samples with none missing in between; without it, of all neighbours.
    torque, v : Series, optional
        Torques sent [N·m], and filtered errors [rad/s], in the place of those of `run`.

    Returns
    -------
    dict
        ``rms_error_rad``, ``rms_torque_nm``, ``torque_variation_nm_per_s``,
        ``max_torque_step_nm`` and ``max_torque_rate_nm_per_s`` per joint,
        ``max_error_norm1_rad``, ``window_s``, ``reaching_time_s`` and ``missing_samples``, the
        number of samples missing in the window; None where the run has less than two samples in
        the window, nan for the torque of a joint where none is known. ``notes``: why numbers are
        None, in words.

    """
    inside = within(run.t, window)
    result: dict[str, Any] = {
        'window_s': list(window), 'rms_error_rad': None, 'max_error_norm1_rad': None,
        'rms_torque_nm': None, **dict.fromkeys(_CHANGES),
        'reaching_time_s': reaching_time(*((run.t, run.v) if v is None else v[:2]), band),
        'missing_samples': None, 'notes': []}
    if inside.sum() < 2:
        result['notes'].append(
            f'metrics are computed from {window[0]:g} s to {window[1]:g} s, where this run'
            + (f', from {run.t[0]:.4g} s to {run.t[-1]:.4g} s,' if len(run.t) else '')
            + (' has one sample only' if inside.any() else ' has no sample'))
    else:
        # With the samples of a joint one after the other in memory, sums take a fifth of the time.
        e = np.asfortranarray((run.q_d - run.q)[inside])
        result.update(
            rms_error_rad=rms(e).tolist(),
            max_error_norm1_rad=float(np.abs(e).sum(axis=1).max()),
            missing_samples=int(missing(run.t[inside], period).sum()) if period else 0)
        result.update(_of_torque(run.t[inside], run.tau[inside], period) if torque is None else
                      _of_torque(*_part(torque, window), period, torque.received))
    return result


def error_shares(run: Run, rms_error: Sequence[float]) -> Array:
    """
    Return the RMS error of each joint over the amplitude of its desired motion, shape (n,).

    The amplitude is half the range of the whole run; of a joint that is to rest the share is 0.

    Parameters
    ----------
    run : Run
        With the desired motion.
    rms_error : sequence of float
        Of each joint [rad].

    """
    amplitude = 0.5 * np.ptp(run.q_d, axis=0)
    moves = amplitude > 0.0
    shares: Array = np.where(moves, rms_error, 0.0) / np.where(moves, amplitude, 1.0)
    return shares


def _part(series: Series, window: tuple[float, float]) -> tuple[Array, Array]:
    """Return times and values of the samples in the window."""
    inside = within(series.t, window)
    return series.t[inside], series.values[inside]


def within(t: Array, window: tuple[float, float]) -> npt.NDArray[np.bool_]:
    """Return which of the times `t`, shape (N,) [s], are in the window, its ends included."""
    return (t >= window[0] - 1e-9) & (t <= window[1] + 1e-9)


def _of_torque(t: Array, tau: Array, period: float | None, received: bool = False
               ) -> dict[str, list[float]]:
    """
    Return the numbers of torques, shape (N, n), of which unknown ones are nan.

    These are RMS, Σ|Δτ| over Σ Δt, and the largest |Δτ| and |Δτ| / Δt, of neighbours with no
    sample missing in between; nan without any. Torques that were `received` are all there are, and
    each is in force until the next one; at times of reception two may seem too close, and a rate
    is then one over a period.
    """
    tau = np.asfortranarray(tau)
    square = np.where(np.isfinite(tau), np.square(tau), 0.0).sum(axis=0)
    count = np.isfinite(tau).sum(axis=0)
    step, dt = np.abs(np.diff(tau.T)), np.diff(t)
    are_neighbours = np.isfinite(step)
    if period and not received:
        are_neighbours &= missing(t, period) == 0
    step = np.where(are_neighbours, step, 0.0)
    time = np.where(are_neighbours, dt, 0.0).sum(axis=1)
    rate = step / (np.maximum(dt, period or 0.0) if received else dt)
    changes: Array = np.array([
        step.sum(axis=1) / np.where(time > 0.0, time, np.nan),
        step.max(axis=1, initial=0.0), rate.max(axis=1, initial=0.0)])
    changes[:, ~are_neighbours.any(axis=1)] = np.nan
    return {'rms_torque_nm': np.sqrt(square / np.where(count, count, np.nan)).tolist(),
            **{key: x.tolist() for key, x in zip(_CHANGES, changes)}}


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
