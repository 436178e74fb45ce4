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

"""The torque over a window: commands with delay and lag of the drives, or measured effort."""

from __future__ import annotations

from collections.abc import Iterator

from ctc_chattering.bags.recording import Indices, Stretch
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import lfilter  # type: ignore[import-untyped]

#: Sources of the torque.
COMMAND, EFFORT = 'command', 'effort'
#: Samples that are computed one by one, all parts of a stretch at once, at least, and parts at
#: most; time before [s], and the fewest samples, after which it does not matter where they began.
_CHUNK, _CHUNKS, _BEFORE, _FEWEST_BEFORE = 400, 40, 0.5, 60
#: Torques that are computed at once.
_AT_ONCE = 4e6
#: In place of no rate limit [N·m/s].
_UNLIMITED = 1e12


def driven(values: Array, lag: Array, rate: Array | float, period: float) -> Array:
    """
    Return the mean torque of drives with a lag and a rate limit over each period, shape (N, n).

    A command is held for a period h, and the torque follows it with the lag T; with a = exp(-h/T)
    the mean over a period is c[k] + (T/h) (1 - a) (τ[k] - c[k]), and τ[k+1] = a τ[k] + (1-a) c[k].
    With a rate limit R it is that of (DM1).

    Parameters
    ----------
    values : ndarray, shape (N, n)
        Commands c [N·m].
    lag, rate : ndarray, shape (n,)
        T [s], and R [N·m/s], inf for none.
    period : float
        h [s].

    """
    lag = np.broadcast_to(lag, values.shape[1:])
    rate = np.broadcast_to(rate, values.shape[1:])
    if np.isfinite(rate).any():
        return _limited(values, lag, rate, period)
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


def _limited(values: Array, lag: Array, rate: Array, period: float) -> Array:
    """
    Return the mean torque over each period where a rate is limited, shape (..., N, n) [N·m].

    Lags of shape (..., n) are computed all at once.
    """
    n = values.shape[1]
    warm = max(_FEWEST_BEFORE, round(_BEFORE / period))
    length = max(_CHUNK, len(values) // _CHUNKS)
    chunks = -(-len(values) // length)
    last = np.repeat(values[-1:], chunks * length - len(values), axis=0)
    padded = np.concatenate((np.repeat(values[:1], warm, axis=0), values, last))
    # All chunks at once, each from so long before that the drives have caught up.
    pieces = np.ascontiguousarray(
        sliding_window_view(padded, warm + length, axis=0)[::length].transpose(2, 0, 1))
    # Of one shape without gaps, for the speed of the loop.
    full = (*lag.shape[:-1], chunks, n)
    rate = np.broadcast_to(np.minimum(rate, _UNLIMITED), full).copy()
    lag = np.broadcast_to(np.maximum(lag, 1e-9 * period)[..., None, :], full).copy()
    mean = np.empty((length, *full))
    tau = np.broadcast_to(pieces[0], full)
    for k, command in enumerate(pieces):
        gap = command - tau
        ramp = np.minimum(np.maximum(np.abs(gap) / rate - lag, 0.0), period)
        risen = np.copysign(rate * ramp, gap)
        left = gap - risen
        end = left * np.exp((ramp - period) / lag)
        if k >= warm:
            mean[k - warm] = command - (
                ramp * (gap - 0.5 * risen) + lag * (left - end)) / period
        tau = command - end
    return np.moveaxis(mean, 0, -2).reshape(*full[:-2], -1, n)[..., :len(values), :]


def driven_by_lags(values: Array, lags: Array, rate: Array, period: float) -> Iterator[Array]:
    """Yield `driven` for each lag of shape (K,) [s], the same of all joints."""
    if not np.isfinite(rate).any():
        yield from (driven(values, lag, rate, period) for lag in lags)
        return
    several = max(1, int(_AT_ONCE / values.size))
    for part in np.split(lags, range(several, len(lags), several)):
        yield from _limited(values, np.repeat(part[:, None], len(rate), axis=1), rate, period)


def has(stretch: Stretch, source: str) -> Array | None:
    """Return the torques of a source in a stretch, shape (N, n); None without."""
    return stretch.command if source == COMMAND else stretch.effort


def weak_torque(values: Array, delay: float, lag: Array, period: float, phi: TestFunction,
                centres: Indices, rate: Array | float = np.inf) -> Array:
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
    rate : ndarray, shape (n,)
        R [N·m/s], inf for none.

    """
    n, whole = values.shape[1], int(np.floor(delay))
    lag, rate, found = np.broadcast_to(lag, n), np.broadcast_to(rate, n), []
    for i in range(n):  # One by one, for long series.
        one = slice(i, i + 1)
        filtered = driven(values[:, one], lag[one], rate[one], period)
        found.append(phi.sums(filtered, phi.over, centres - whole))
        if delay != whole:
            found[-1] = 0.5 * (found[-1] + phi.sums(filtered, phi.over, centres - whole - 1))
    return np.concatenate(found, axis=1)
