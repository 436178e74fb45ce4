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

"""Signals of the last seconds, and the part of them that a plot shows."""

from __future__ import annotations

from ctc_chattering.live.history import envelope, History
from ctc_chattering.live.samples import rms, Samples, since_now
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest


def test_keeps_the_window() -> None:
    history = History(2, window=1.0, capacity=300)
    for k in range(5000):
        history.add(k / 100, (k, -k))
    t, rows = history.read()
    assert t == pytest.approx(np.arange(4899, 5000) / 100)
    assert rows[:, 0] == pytest.approx(np.arange(4899, 5000))
    assert rows[:, 1] == pytest.approx(-rows[:, 0])


def test_keeps_no_more_rows_than_it_may() -> None:
    history = History(1, window=1e9, capacity=100)
    for k in range(12345):
        history.add(k, (k,))
    t, rows = history.read()
    assert t.tolist() == rows[:, 0].tolist() == list(range(12245, 12345))


def test_begins_again_where_time_does() -> None:
    history = History(1)
    for t in (5.0, 6.0, 0.0, 0.5):
        history.add(t, (t,))
    assert history.read()[0].tolist() == [0.0, 0.5]
    assert History(1).read()[0].tolist() == []


@given(st.integers(0, 700), st.integers(1, 60), st.integers(0, 2 ** 31))
def test_no_peak_is_lost(count: int, buckets: int, seed: int) -> None:
    rows = np.random.default_rng(seed).normal(size=(count, 3))
    t, shown = envelope(np.arange(count, dtype=float), rows, buckets)
    assert len(t) == len(shown) <= max(2 * buckets, 1)
    assert (np.diff(t) >= 0.0).all()
    if count:
        assert shown.max(axis=0).tolist() == rows.max(axis=0).tolist()
        assert shown.min(axis=0).tolist() == rows.min(axis=0).tolist()
        assert t[0] == 0.0


def test_rms_is_over_the_last_second() -> None:
    t = np.arange(3001) / 1000
    e = np.where(t > 2.0, 3.0, 100.0)[:, None]
    samples = Samples(t, e, e, e[:, 0], np.zeros((3001, 4, 1)))
    assert rms(samples) == pytest.approx([3.0])
    assert since_now(samples).t[[0, -1]].tolist() == [-3.0, 0.0]
    none = Samples(t[:0], e[:0], e[:0], t[:0], np.zeros((0, 4, 1)))
    assert np.isnan(rms(none)).all()
    assert since_now(none) is none
