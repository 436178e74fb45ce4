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

"""Late messages are put in order; where a clock is set back, a recording is split."""

from __future__ import annotations

from ctc_chattering.bags.recording import ordered, StampOrder
from ctc_chattering.errors import CtcError
import numpy as np
import pytest

H, N = 1e-3, 6000
T = H * np.arange(N)


def order(t: np.ndarray, keep: np.ndarray | slice = slice(None)) -> StampOrder:
    return ordered('run', t[keep], np.sin(np.arange(N))[keep, None])


def set_back(by: float) -> np.ndarray:
    return np.where(np.arange(N) >= 3000, T - by, T)


@pytest.mark.parametrize('by', [3e-3, 0.35, 0.3503, 3.0])
@pytest.mark.parametrize('jitter', [0.0, 0.03])
def test_a_clock_that_is_set_back_splits(by: float, jitter: float) -> None:
    rng = np.random.default_rng(1)
    found = order(set_back(by) + jitter * H * rng.normal(size=N))
    assert np.array_equal(found.keep, np.arange(N))
    (one,) = found.breaks
    assert one.length == pytest.approx(by, abs=0.2 * H)
    assert one.time == pytest.approx(2.999, abs=H)
    assert 'run back' in one.reason and one.samples == 0
    step = np.diff(found.t)
    assert np.flatnonzero(step > 0.05).tolist() == [2999]


def test_it_splits_where_messages_are_lost_as_well() -> None:
    keep = np.random.default_rng(2).random(N) > 0.17
    found = order(set_back(0.35), keep)
    assert np.array_equal(found.keep, np.arange(keep.sum()))
    assert len(found.breaks) == 1


def test_late_messages_are_no_break() -> None:
    moved = np.arange(N)
    moved[1000:1010] = moved[1000:1010][::-1]
    moved[2000:2003] = moved[[2002, 2000, 2001]]
    found = order(T[moved])
    assert np.array_equal(found.t, T)
    assert np.array_equal(moved[found.keep], np.arange(N))
    assert found.breaks == ()


@pytest.mark.parametrize('stamp', [0.0, 1e6])
def test_one_stamp_of_another_time_is_left_out(stamp: float) -> None:
    t = T.copy()
    t[4000] = stamp
    found = order(t)
    assert len(found.keep) == N - 1 and 4000 not in found.keep
    assert [x.samples for x in found.breaks] == [1]


def test_both_clocks_set_back_leave_out_what_overlaps() -> None:
    """A recorder sorts by its own clock, so that two stretches of time are mixed."""
    t = set_back(0.3504)
    mixed = np.argsort(t, kind='stable')
    found = order(t[mixed])
    assert not np.isin(mixed[found.keep], np.arange(2700, 3300)).any()
    assert len(found.keep) > N - 900
    (one,) = found.breaks
    assert one.samples == N - len(found.keep) and 'two clocks' in one.reason


def test_another_period_is_left_out() -> None:
    found = order(T, (np.arange(N) < 3600) | (np.arange(N) % 2 == 0))
    (one,) = found.breaks
    assert one.time == pytest.approx(3.6, abs=0.05)
    assert '0.002 s, all else every 0.001 s' in one.reason
    assert np.diff(found.t).max() < 1.5 * H


@pytest.mark.parametrize('t', [0.0 * T, np.floor(T / 0.004) * 0.004, T - 0.1 * np.floor(T / 0.2)])
def test_stamps_of_no_use_are_refused(t: np.ndarray) -> None:
    with pytest.raises(CtcError, match='stand still or run back'):
        order(t)
