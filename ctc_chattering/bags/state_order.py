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
Order of recorded states by their stamps.

`order_states` sorts states that arrived late and refuses stamps that have no single period. It is
called with the states of a run (`bags/reader.py`) and of any recording
(`identification/recording.py`).
"""

from __future__ import annotations

import dataclasses

from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array, Flags, Indices
import numpy as np
from scipy.ndimage import median_filter  # type: ignore[import-untyped]


@dataclasses.dataclass(frozen=True)
class StampLimits:
    """
    Limits of regular stamps.

    Attributes
    ----------
    crowd_states : int
        Window of states whose median step decides, so that single late states do not.
    crowded_step_ratio : float
        Least step over two states, as a fraction of two periods. Two series of states interleave
        below it.
    max_shared_fraction : float
        Largest fraction of states with another state's stamp and different content.
    isolating_step_periods : float
        Steps longer than this separate groups of states.
    min_group_states : int
        A smaller group is isolated, as one of wrong stamps is.
    max_bridged_samples : int
        Longest gap that is interpolated.

    """

    crowd_states: int = 21
    crowded_step_ratio: float = 0.625
    max_shared_fraction: float = 0.02
    isolating_step_periods: float = 20.0
    min_group_states: int = 20
    max_bridged_samples: int = 5


STAMP_LIMITS = StampLimits()


def order_states(name: str, t: Array, *contents: Array, period: float | None = None) -> Indices:
    """
    Return the usable states' indices, sorted by stamp, each once.

    Few states with stamps far from all others are left out.

    Parameters
    ----------
    name : str
        Name of the recording, for refusals.
    t : ndarray, shape (N,)
        Stamps in the order of arrival [s].
    contents : ndarray, each of shape (N, m)
        Values of the states. A state that repeats stamp and values is dropped.
    period : float, optional
        Expected step [s]. Without it, the median step.

    Raises
    ------
    CtcError
        If two series of states interleave, as of two publishers or after a clock was set back.

    """
    order: Indices = np.argsort(t, kind='stable')
    stamps = t[order]
    repeats = np.diff(stamps) == 0.0
    for values in contents:
        for column in values.T:  # Column by column, for long series.
            ordered = column[order]
            repeats &= ordered[1:] == ordered[:-1]
    is_new = np.append(True, ~repeats)
    order = order[is_new]
    usual_step = period or _median_step(t[order])
    distinct = np.unique(t)
    isolated = distinct[find_isolated(distinct, usual_step)]
    order = order[~np.isin(t[order], isolated)]
    if len(order) < 3:
        raise CtcError(
            f'{name}: the stamps have no regular period: their median step is {usual_step:.3g} s, '
            'but most states stand alone. Check for two publishers of joint states, and record '
            'the bag again')
    stamps = t[order]
    double_step = stamps[2:] - stamps[:-2]
    smallest = 2.0 * STAMP_LIMITS.crowded_step_ratio * usual_step
    usual = median_filter(double_step, STAMP_LIMITS.crowd_states)
    is_crowded = usual < smallest
    if period is None:
        is_crowded |= _find_alternating(np.diff(stamps), double_step)
    if is_crowded.any():
        begin = stamps[int(is_crowded.argmax())] - stamps[0]
        raise CtcError(
            f'{name}: from {begin:.4g} s after the first state on, stamps are closer than the '
            f'period of {usual_step:.3g} s. Check for a clock that was set back, two publishers '
            'of joint states and stamps coarser than the period, and record the bag again')
    step = np.diff(stamps)
    shared = float((step == 0.0).mean())
    if shared > STAMP_LIMITS.max_shared_fraction:
        resolution = step[step > 0.0].min(initial=np.inf)
        raise CtcError(
            f'{name}: {shared:.0%} of the states share the stamp of another state, because stamps '
            f'have a resolution of {1e3 * resolution:.3g} ms, coarser than the period. '
            'Record the stamps of the driver with all their digits')
    return order[np.diff(stamps, prepend=-np.inf) > 0.0]


def find_isolated(stamps: Array, period: float) -> Flags:
    """Flag sorted stamps in small groups between long steps."""
    is_end = np.diff(stamps) > STAMP_LIMITS.isolating_step_periods * period
    group = np.append(0, np.cumsum(is_end))
    sizes = np.bincount(group)
    is_small = sizes < STAMP_LIMITS.min_group_states
    is_isolated = is_small & (len(sizes) > 1)
    flags: Flags = is_isolated[group]
    return flags


def _median_step(stamps: Array) -> float:
    """Return the median positive step; inf without any."""
    step = np.diff(stamps)
    step = step[step > 0.0]
    return float(np.median(step)) if len(step) else np.inf


def _find_alternating(step: Array, double_step: Array) -> Flags:
    """
    Flag states of two series with one period h.

    Nothing is flagged unless these are most states.

    Their steps are a, h - a, a, h - a, ...

    Parameters
    ----------
    step : ndarray, shape (N - 1,)
        From each state to the next one [s].
    double_step : ndarray, shape (N - 2,)
        From each state to the next but one [s].

    """
    median = np.median(double_step)
    longest = 2.0 * STAMP_LIMITS.crowded_step_ratio * median
    is_regular: Flags = double_step <= longest
    change = np.abs(np.diff(step))
    alternates = change[is_regular] > 0.1 * double_step[is_regular]
    low, high = np.percentile(double_step[is_regular], (10.0, 90.0))
    is_even = high - low < 0.4 * median
    return is_regular & bool(alternates.mean() > 0.8 and is_even)
