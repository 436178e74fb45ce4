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
Torque that drives give for their commands, and its mean over windows.

A command is held for a period h. The torque follows it with the lag T, by (DM1), and changes by at
most the rate R. It acts some samples after the state that it answers.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from ctc_chattering.bags.recording import Indices, Stretch
from ctc_chattering.dynamics.drive_response import response
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
import numpy.typing as npt

Flags = npt.NDArray[np.bool_]
#: Source of the torque: what was commanded.
COMMAND = 'command'
#: Source of the torque: what was measured.
EFFORT = 'effort'
#: Time after which it does not matter from where a drive began [s].
MEMORY_S = 0.5
#: Fewest samples of that time.
LEAST_MEMORY = 60
#: Fewest samples that are computed one by one; all chunks of a series are computed at once.
LEAST_CHUNK = 400
#: Most chunks of a series.
MOST_CHUNKS = 1000
#: Most torques that are computed at once.
MOST_AT_ONCE = 1_000_000
#: Rate in the place of no rate limit [N·m/s].
UNLIMITED_RATE = 1e12


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


def driven(values: Array, lag: Array, rate: Array | float, period: float) -> Array:
    """
    Return the mean torque over each period, shape (..., N, n) [N·m].

    Without a rate limit and with a = exp(-h/T) the mean over a period is
    c[k] + (T/h) (1 - a) (τ[k] - c[k]), and τ[k+1] = a τ[k] + (1 - a) c[k].

    Parameters
    ----------
    values : ndarray, shape (N, n)
        Commands c [N·m]; nan counts as 0.
    lag : ndarray, shape (..., n)
        T [s]; several are computed at once.
    rate : ndarray, shape (n,), or float
        R [N·m/s], inf for none.
    period : float
        h [s].

    """
    if not lag.any() and not np.isfinite(rate).any():
        return np.broadcast_to(np.nan_to_num(values), (*lag.shape[:-1], *values.shape))
    n = values.shape[1]
    memory = max(LEAST_MEMORY, round(MEMORY_S / period))
    length = max(LEAST_CHUNK, len(values) // MOST_CHUNKS)
    chunks = -(-len(values) // length)
    padding = np.repeat(values[-1:], chunks * length - len(values), axis=0)
    padded = np.nan_to_num(
        np.concatenate((np.repeat(values[:1], memory, axis=0), values, padding)), copy=False)
    # All chunks at once, each from so long before that the drives have caught up.
    commands = sliding_window_view(padded, memory + length, axis=0)[::length].transpose(2, 0, 1)
    # Of one shape without gaps, for the speed of the loop.
    shape = (*lag.shape[:-1], chunks, n)
    rates = np.broadcast_to(np.minimum(rate, UNLIMITED_RATE), shape).copy()
    lag = np.broadcast_to(np.maximum(lag, 1e-9 * period)[..., None, :], shape).copy()
    mean = np.empty((*shape[:-1], length, n))
    torque = np.broadcast_to(commands[0], shape)
    for k, command in enumerate(commands):
        error, area = response(command - torque, lag, rates, period)
        if k >= memory:
            mean[..., k - memory, :] = command + area / period
        torque = command + error
    return mean.reshape(*shape[:-2], -1, n)[..., :len(values), :]


def driven_by_lags(values: Array, lags: Array, rate: Array, period: float) -> Iterator[Array]:
    """Yield `driven` for each lag of shape (K,) [s], the same of all joints."""
    at_once = max(1, MOST_AT_ONCE // values.size)
    for some in np.split(lags, range(at_once, len(lags), at_once)):
        yield from driven(values, np.repeat(some[:, None], len(rate), axis=1), rate, period)


def has(stretch: Stretch, source: str) -> Array | None:
    """Return the torques of a source in a stretch, shape (N, n); None without."""
    return stretch.command if source == COMMAND else stretch.effort


def complete(values: Array, centres: Indices, before: int, after: int) -> Flags:
    """Return at which centres values, (N, n), are known from so many samples before to after."""
    low, high = (np.clip(centres + x, 0, len(values) - 1) for x in (-before - 1, after))
    # Joint by joint, for long series.
    unknown = (np.cumsum(~np.isfinite(column)) for column in values.T)
    return np.stack([count[low] == count[high] for count in unknown], axis=1)


def weak_torque(values: Array, drive: Drive, period: float, phi: TestFunction, centres: Indices
                ) -> Array:
    """
    Return ∫ φ tau dt over each window, shape (J, n) [N·m].

    Parameters
    ----------
    values : ndarray, shape (N, n)
        Torque of each sample [N·m]; nan counts as 0.
    drive : Drive
        From these values to the torque.
    period : float
        h [s].
    phi, centres
        Test function, and samples at the centres of the windows.

    """
    whole, columns = int(np.floor(drive.delay)), []
    for joint in range(values.shape[1]):  # One by one, for long series.
        here = slice(joint, joint + 1)
        torque = driven(values[:, here], drive.lag[here], drive.rate[here], period)
        mean = phi.sums(torque, phi.over, centres - whole)
        if drive.delay != whole:
            mean = 0.5 * (mean + phi.sums(torque, phi.over, centres - whole - 1))
        columns.append(mean)
    return np.concatenate(columns, axis=1)


def known_torque(stretch: Stretch, centres: Indices, source: str, phi: TestFunction, drive: Drive
                 ) -> Array:
    """Return the weak torque of windows, shape (J, n) [N·m]; nan where it is not known."""
    values = np.asarray(has(stretch, source))
    torque = weak_torque(values, drive, stretch.period, phi, centres)
    late = int(np.ceil(drive.delay))
    early = int(np.floor(drive.delay))
    known = complete(values, centres, phi.half + late, phi.half - early)
    return np.where(known, torque, np.nan)
