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

"""
Numbers that sum up a run.

They are errors, torques and their variation, and the reaching time.

All but the reaching time are computed over a window in which the start is over.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ctc_chattering.analysis.signals import Series
from ctc_chattering.numerics.time_grid import missing
from ctc_chattering.simulation.closed_loop import Array, Run
import numpy as np
import numpy.typing as npt

#: Part of a run over which errors and torques are evaluated [s].
WINDOW = (5.0, 10.0)
#: Band of |v_i| that counts as reached [rad/s].
BAND = 0.15
#: Warn of an RMS error above this share of the amplitude of the joint's desired motion.
WARN_ERROR_SHARE = 0.1
#: Least amplitude of a joint that is not to rest [rad], above the rounding of a correction.
_LEAST_AMPLITUDE = 1e-12
#: Numbers of the torque's variation, in the order of `_torque_changes`.
_CHANGES = ('torque_variation_nm_per_s', 'max_torque_step_nm', 'max_torque_rate_nm_per_s')


def window_of(t: Array) -> tuple[float, float]:
    """
    Return the window of a run with these times [s].

    It is `WINDOW`, or the second half of a run that has too little of that.
    """
    if not len(t):
        return WINDOW
    begin, end = float(t[0]), float(t[-1])
    # At least half a second is needed.
    if min(end, WINDOW[1]) - max(begin, WINDOW[0]) >= 0.5 - 1e-9:
        return WINDOW
    return begin + 0.5 * (end - begin), end


def within(t: Array, window: tuple[float, float]) -> npt.NDArray[np.bool_]:
    """
    Return the times that are in the window.

    Times have the shape (N,) [s]. The ends of the window belong to it.
    """
    return (t >= window[0] - 1e-9) & (t <= window[1] + 1e-9)


def metrics(
    run: Run,
    window: tuple[float, float] = WINDOW,
    period: float | None = None,
    torque: Series | None = None,
    v: Series | None = None,
) -> dict[str, Any]:
    """
    Return the numbers of one run for ``metrics.json``.

    Parameters
    ----------
    run : Run
        Samples, of any number. Torques that are not known are not finite.
    window : (float, float)
        First and last instant of the samples evaluated [s].
    period : float, optional
        Sample period [s]. Variation, steps and rates of the torque are then those of samples
        between which none is missing. The default takes all neighbours.
    torque, v : Series, optional
        Torques sent [N·m], and filtered errors [rad/s]. The default are those of `run`.

    Returns
    -------
    dict
        Per joint ``rms_error_rad``, ``rms_torque_nm``, ``torque_variation_nm_per_s``,
        ``max_torque_step_nm`` and ``max_torque_rate_nm_per_s``. For the run
        ``max_error_norm1_rad``, ``window_s``, ``reaching_time_s``, and ``missing_samples``, the
        number of samples missing in the window. They are None if the window has fewer than two
        samples, and nan for the torque of a joint if none is known. ``notes``: the reasons for
        None.

    """
    t = run.t
    inside = within(t, window)
    numbers: dict[str, Any] = {
        'window_s': list(window),
        'rms_error_rad': None,
        'max_error_norm1_rad': None,
        'rms_torque_nm': None,
        **dict.fromkeys(_CHANGES),
        'reaching_time_s': reaching_time(t, run.v) if v is None else reaching_time(v.t, v.values),
        'missing_samples': None,
        'notes': [],
    }
    if inside.sum() < 2:
        span = f', from {t[0]:.4g} s to {t[-1]:.4g} s,' if len(t) else ''
        count = 'one sample only' if inside.any() else 'no sample'
        numbers['notes'].append(
            f'metrics are computed from {window[0]:g} s to {window[1]:g} s, '
            f'where this run{span} has {count}'
        )
        return numbers
    # With the samples of a joint one after the other in memory, sums take a fifth of the time.
    e = np.asfortranarray(run.e[inside])
    numbers |= {
        'rms_error_rad': rms(e).tolist(),
        'max_error_norm1_rad': float(np.abs(e).sum(axis=1).max()),
        'missing_samples': int(missing(t[inside], period).sum()) if period else 0,
    }
    if torque is None:
        return numbers | _torque_numbers(t[inside], run.tau[inside], period)
    inside = within(torque.t, window)
    return numbers | _torque_numbers(
        torque.t[inside], torque.values[inside], period, torque.received
    )


def error_shares(run: Run, rms_error: Sequence[float]) -> Array:
    """
    Return the RMS error over the amplitude of the motion.

    There is a share for each joint, shape (n,).

    The amplitude is half the range of the whole run. A joint that is to rest has the share 0.

    Parameters
    ----------
    run : Run
        Samples with the desired motion.
    rms_error : sequence of float
        RMS error of each joint [rad].

    """
    q_d, _, _ = run.desired
    amplitude = 0.5 * np.ptp(q_d, axis=0)
    shares: Array = np.zeros_like(amplitude)
    np.divide(rms_error, amplitude, out=shares, where=amplitude > _LEAST_AMPLITUDE)
    return shares


def _torque_numbers(
    t: Array, tau: Array, period: float | None, received: bool = False
) -> dict[str, list[float]]:
    """
    Return the numbers of torques, shape (N, n).

    Unknown torques are nan.

    The numbers are RMS, Σ|Δτ| over Σ Δt, and the largest |Δτ| and |Δτ| / Δt. Only neighbours with
    no sample missing between them count. A number without any is nan.

    Torques that were `received` are complete, and each is in force until the next one. Two
    times of reception may be too close to each other: a rate is then one over a period.
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
    changes: Array = np.array(
        [
            step.sum(axis=1) / np.where(time > 0.0, time, np.nan),
            step.max(axis=1, initial=0.0),
            rate.max(axis=1, initial=0.0),
        ]
    )
    changes[:, ~are_neighbours.any(axis=1)] = np.nan
    return {
        'rms_torque_nm': np.sqrt(square / np.where(count, count, np.nan)).tolist(),
        **dict(zip(_CHANGES, changes.tolist())),
    }


def rms(x: Array) -> Array:
    """Return the RMS of each column, shape (n,)."""
    mean: Array = np.mean(np.square(x), axis=0)
    return np.sqrt(mean)


def reaching_time(t: Array, v: Array, band: float = BAND) -> float | None:
    """
    Return the reaching time [s].

    From it on, every |v_i| stays within `band` to the end.

    It is None if the last sample is outside, or if there is none.
    """
    outside = np.flatnonzero(~(np.abs(v) <= band).all(axis=1))
    first = outside[-1] + 1 if len(outside) else 0
    return float(t[first]) if first < len(t) else None
