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
Which command answers which state, by the times at which a recorder received both.

Commands have no stamps. A controller answers each state once, after a time that changes little;
what a recorder adds to that is jitter. The stamps of the states show how unevenly the recorder
received them. In lockstep, where time goes as fast as the answers come, their order tells.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.bags.recording import Indices
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt
from scipy.ndimage import median_filter  # type: ignore[import-untyped]

#: States over which the time between stamp and reception is taken.
_AROUND = 201
#: Part by which the time between states differs from that of their stamps in lockstep; commands
#: on each side over which their count is taken, and the part of those that are heard beside it
#: beyond which it is in doubt.
_PACED, _COUNTED, _DOUBTFUL = 0.02, 500, 0.2
#: Part of a period beyond which, from the usual time after a state, it is not sure which one is
#: answered; and part of the commands for which that does not matter.
_SURE, _NEGLIGIBLE = 0.35, 0.002
#: Least and most commands for each state that are answers to it, one for one.
_ANSWERS = (0.6, 1.45)
#: Length of the mean direction of the times after a state, on a circle, below which there is no
#: usual one.
_USUAL = 0.5
#: Periods after which a command is no longer held.
_HELD = 20


class Answers(NamedTuple):
    """
    Commands in the places of the states.

    Attributes
    ----------
    command : ndarray, shape (N, n)
        In force after each state [N·m], nan where it is unknown.
    late : tuple of (float, float)
        Samples by which they may be later than they stand here, at least and at most.
    own : ndarray of bool, shape (N,)
        Whether it answers this state, and not one before.

    """

    command: Array
    late: tuple[float, float]
    own: npt.NDArray[np.bool_]


def answers(values: Array, times: Indices, stamps: Indices, received: Indices) -> Answers:
    """
    Return the commands in the places of the states that they answer.

    Parameters
    ----------
    values : ndarray, shape (M, n)
        Commands [N·m].
    times : ndarray, shape (M,)
        At which they were received [ns].
    stamps, received : ndarray, shape (N,)
        Stamps of the states, and times at which they were received, in this order [ns].

    """
    if (np.diff(times) < 0).any():
        order = np.argsort(times, kind='stable')
        values, times = values[order], times[order]
    raw = np.searchsorted(received, times, side='right') - 1
    if not _in_real_time(stamps, received):
        return _counted(values, raw, stamps)
    if _twice(raw) <= _NEGLIGIBLE:
        return placed(values, raw, stamps, 0.0)
    ahead = (received - received[0]) - (stamps - stamps[0]).astype(float)
    expected = np.maximum.accumulate((stamps - stamps[0]) + median_filter(
        ahead, min(_AROUND, len(ahead)), mode='nearest'))
    period = max(float(np.median(np.diff(expected))), 1.0)
    at = (times - received[0]).astype(float)
    before = np.searchsorted(expected, at, side='right') - 1
    phase = (at - expected[np.maximum(before, 0)]) / period % 1.0
    mean = np.exp(2j * np.pi * phase).mean()
    ratio = len(times) / len(received)
    if abs(mean) >= _USUAL and _ANSWERS[0] < ratio < _ANSWERS[1]:
        usual = float(np.angle(mean) / (2.0 * np.pi)) % 1.0
        middle = at - (usual - 0.5) * period
        which = np.searchsorted(expected, middle) - 1
        after = (middle - expected[np.maximum(which, 0)]) / period
        unsure = float((np.abs((after % 1.0) - 0.5) > _SURE).mean())
        # What answers a state that is not in the recording is none to the one before it.
        which = np.where(after > 1.0, -1, which)
        return placed(values, _apart(which, after, len(received)), stamps, unsure)
    return _counted(values, raw, stamps)


def _in_real_time(stamps: Indices, received: Indices) -> bool:
    """Return whether states are received as fast as their stamps go on."""
    wall, theirs = (np.diff(x[::_AROUND].astype(float)) for x in (received, stamps))
    return not len(wall) or bool(
        np.median(np.abs(wall - theirs)) <= _PACED * np.median(np.abs(theirs)))


def _counted(values: Array, raw: Indices, stamps: Indices) -> Answers:
    """
    Return commands by their order, as in lockstep, where each state follows an answer.

    So it does not matter how long these take. What a recorder hears too late, or not at all,
    moves one by the median over those around it.
    """
    numbers = _numbers(stamps)
    count = np.arange(len(raw))
    ahead = np.where(raw < 0, -1, numbers[np.maximum(raw, 0)]) - count
    ends = tuple(int(np.median(x)) for x in (ahead[:_AROUND], ahead[-_AROUND:]))
    usual = median_filter(np.pad(ahead, _COUNTED, constant_values=ends), 2 * _COUNTED + 1
                          )[_COUNTED:-_COUNTED]
    place = count + usual
    which = np.searchsorted(numbers, place)
    lost = (place < 0) | (numbers[np.minimum(which, len(numbers) - 1)] != place)
    beside = [float((x > 0).mean()) for x in (usual - ahead, ahead - usual)]
    # Where commands are missing, it is not sure which ones.
    unsure = sum(beside) if np.ptp(usual) else 0.0
    before, after = (1.0 if x > _DOUBTFUL else unsure for x in beside)
    return placed(values, np.where(lost, -1, which), stamps, before, after)


def _numbers(stamps: Indices) -> Indices:
    """Return the number of each state, counting those that were not recorded."""
    step = np.diff(stamps)
    period = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    found: Indices = np.concatenate(([0], np.cumsum(np.clip(np.rint(step / period), 1, _HELD))
                                     )).astype(int)
    return found


def _twice(which: Indices) -> float:
    """Return for which part of all commands there is another one in their place."""
    return float((np.diff(which) == 0).mean()) if len(which) > 1 else 0.0


def _apart(which: Indices, after: Array, count: int) -> Indices:
    """Return the places of commands, those of two in one place moved to a free one beside it."""
    found: Indices = which.copy()
    taken = np.bincount(found[found >= 0], minlength=count + 1)
    for k in np.flatnonzero((np.diff(which) == 0) & (which[1:] >= 0)).tolist():
        place = int(which[k])
        first = after[k] + after[k + 1] < 1.0
        for free, mine in ((place - 1, k), (place + 1, k + 1))[::1 if first else -1]:
            if 0 <= free < count and not taken[free]:
                found[mine] = free
                taken[free], taken[place] = 1, taken[place] - 1
                break
    return found


def placed(values: Array, which: Indices, stamps: Indices, before: float,
           after: float | None = None) -> Answers:
    """
    Return for each state its command, or the one before if it has none.

    Parameters
    ----------
    values : ndarray, shape (M, n)
        Commands [N·m].
    which : ndarray, shape (M,)
        State that each answers; none outside of their range.
    stamps : ndarray, shape (N,)
        Of the states [ns].
    before, after : float
        Part of the commands that may answer the state before, and the one after; the same
        without the second.

    """
    count = len(stamps)
    last = np.full(count, -1)
    inside = (which >= 0) & (which < count)
    np.maximum.at(last, which[inside], np.flatnonzero(inside))
    own = last >= 0
    last = np.maximum.accumulate(last)
    found = values[np.maximum(last, 0)].astype(float, copy=False)
    samples = _numbers(stamps)
    age = samples - samples[np.clip(which[np.maximum(last, 0)], 0, count - 1)]
    known = (last >= 0) & (age <= _HELD)
    found[~known] = np.nan
    # Where a command was not recorded, one that is older stands in its place.
    older = float(age[known].mean()) if known.any() else 0.0
    less, more = (x if x > _NEGLIGIBLE else 0.0
                  for x in (before, before if after is None else after))
    return Answers(found, (-less - (older if older > _NEGLIGIBLE else 0.0), more), own)
