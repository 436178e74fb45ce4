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
Torque that drives give for their commands.

A command is held for a period h. The torque follows it with the lag T, by (DM1), and changes by at
most the rate R. It acts some samples after the state that it answers. `identify` takes the torque
of all windows from here, `drive_search.py` those of many delays, lags and rates.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from ctc_chattering.dynamics.drive_response import response
from ctc_chattering.identification.stretches import Stretch
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.numerics.linear_algebra import Array, Flags, Indices
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view


class Drive(NamedTuple):
    """
    Drives of n joints.

    Attributes
    ----------
    delay : float
        Samples after which a torque acts: over the period from sample k + `delay` on. An effort
        that shows the torque of the period before has -1, one at the instant between both -0.5.
    lag : ndarray, shape (n,)
        T [s].
    rate : ndarray, shape (n,)
        R [N·m/s], inf for none.

    """

    delay: float
    lag: Array
    rate: Array

    @classmethod
    def ideal(cls, n: int, delay: float = 0.0) -> Drive:
        """Return drives that follow at once."""
        return cls(delay, np.zeros(n), np.full(n, np.inf))


def mean_drive_torque(
        values: Array,
        lag: Array,
        rate: Array | float,
        period: float) -> Array:
    """
    Return the mean torque of each period, (..., N, n) [N·m].

    Without a rate limit and with a = exp(-h/T) the mean over a period is
    c[k] + (T/h) (1 - a) (τ[k] - c[k]), and τ[k+1] = a τ[k] + (1 - a) c[k].

    Parameters
    ----------
    values : ndarray, shape (N, n)
        Commands c [N·m]. nan counts as 0.
    lag : ndarray, shape (..., n)
        T [s]. Several are computed at once.
    rate : ndarray, shape (n,), or float
        R [N·m/s], inf for none.
    period : float
        h [s].

    """
    if not lag.any() and not np.isfinite(rate).any():
        return np.broadcast_to(np.nan_to_num(values), (*lag.shape[:-1], *values.shape))
    count, n = values.shape
    # All chunks are computed at once. Each begins half a second early, so that drives catch up.
    memory = max(60, round(0.5 / period))
    length = max(400, count // 1000)
    chunks = -(-count // length)
    start = np.repeat(values[:1], memory, axis=0)
    padding = np.repeat(values[-1:], chunks * length - count, axis=0)
    padded = np.concatenate((start, values, padding))
    np.nan_to_num(padded, copy=False)
    windows = sliding_window_view(padded, memory + length, axis=0)
    commands = windows[::length].transpose(2, 0, 1)
    # Arrays of one shape without gaps make the loop fast.
    shape = (*lag.shape[:-1], chunks, n)
    finite_rate = np.minimum(rate, 1e12)
    rates = np.broadcast_to(finite_rate, shape).copy()
    positive_lag = np.maximum(lag, 1e-9 * period)
    lags = np.broadcast_to(positive_lag[..., None, :], shape).copy()
    mean = np.empty((*shape[:-1], length, n))
    torque = np.broadcast_to(commands[0], shape)
    for k, command in enumerate(commands):
        change, area = response(command - torque, lags, rates, period)
        if k >= memory:
            mean[..., k - memory, :] = command + area / period
        torque = command + change
    whole = mean.reshape(*shape[:-2], -1, n)
    return whole[..., :count, :]


def iterate_lags(values: Array, lags: Array, rate: Array, period: float) -> Iterator[Array]:
    """Yield `mean_drive_torque` for lags of all joints, shape (K,) [s]."""
    # A million numbers at once, to limit the memory.
    at_once = max(1, 1_000_000 // values.size)
    for block in np.split(lags, range(at_once, len(lags), at_once)):
        same_lags = np.repeat(block[:, None], len(rate), axis=1)
        yield from mean_drive_torque(values, same_lags, rate, period)


def find_complete(
        values: Array,
        centres: Indices,
        samples_before: int,
        samples_after: int) -> Flags:
    """
    Flag the centres around which values are known, shape (J, n).

    Parameters
    ----------
    values : ndarray, shape (N, n)
        Values, nan where they are not known.
    centres : ndarray, shape (J,)
        Samples at the centres.
    samples_before, samples_after : int
        Samples around a centre that must be known.

    """
    last = len(values) - 1
    low = np.clip(centres - samples_before - 1, 0, last)
    high = np.clip(centres + samples_after, 0, last)
    # Joint by joint, for long series.
    unknown = (np.cumsum(~np.isfinite(column)) for column in values.T)
    return np.stack([count[low] == count[high] for count in unknown], axis=1)


def weak_torque(
        values: Array,
        drive: Drive,
        period: float,
        phi: TestFunction,
        centres: Indices) -> Array:
    """
    Return ∫ φ tau dt of each window, (J, n) [N·m].

    Parameters
    ----------
    values : ndarray, shape (N, n)
        Torque of each sample [N·m]. nan counts as 0.
    drive : Drive
        From these values to the torque.
    period : float
        h [s].
    phi, centres
        Test function, and samples at the centres of the windows.

    """
    whole = int(np.floor(drive.delay))
    columns = []
    for joint in range(values.shape[1]):  # Joint by joint, for long series.
        column = slice(joint, joint + 1)
        torque = mean_drive_torque(
            values[:, column],
            drive.lag[column],
            drive.rate[column],
            period)
        mean = phi.sums(torque, phi.over, centres - whole)
        if drive.delay != whole:
            mean = 0.5 * (mean + phi.sums(torque, phi.over, centres - whole - 1))
        columns.append(mean)
    return np.concatenate(columns, axis=1)


def known_torque(
        stretch: Stretch,
        centres: Indices,
        source: str,
        phi: TestFunction,
        drive: Drive) -> Array:
    """Return the weak torque or nan, shape (J, n) [N·m]."""
    values = np.asarray(stretch.torque(source))
    torque = weak_torque(values, drive, stretch.period, phi, centres)
    samples_before = phi.half + int(np.ceil(drive.delay))
    samples_after = phi.half - int(np.floor(drive.delay))
    is_known = find_complete(values, centres, samples_before, samples_after)
    return np.where(is_known, torque, np.nan)
