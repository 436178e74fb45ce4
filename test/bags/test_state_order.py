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

"""Stamps put states in order; those of two series or of no use are refused."""

from __future__ import annotations

from ctc_chattering.bags.state_order import order_states
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Indices
import numpy as np
import pytest

H, N = 1e-3, 6000
T = H * np.arange(N)


def order(t: np.ndarray, keep: np.ndarray | slice = slice(None)) -> Indices:
    return order_states('run', t[keep], np.sin(np.arange(N))[keep, None])


def set_back(by: float) -> np.ndarray:
    return np.where(np.arange(N) >= 3000, T - by, T)


@pytest.mark.parametrize('by', [0.012, 0.35, 0.3503, 3.0])
@pytest.mark.parametrize('jitter', [0.0, 0.03, 0.1])
@pytest.mark.parametrize('loss', [0.0, 0.17])
def test_a_clock_that_is_set_back_is_refused(by: float, jitter: float, loss: float) -> None:
    rng = np.random.default_rng(1)
    t = set_back(by) + jitter * H * rng.normal(size=N)
    with pytest.raises(CtcError, match='a clock that was set back'):
        order(t, rng.random(N) >= loss)
    with pytest.raises(CtcError, match='a clock that was set back'):  # A recorder may sort by it.
        order(np.sort(t))


@pytest.mark.parametrize('loss', [0.0, 0.17])
def test_jitter_and_losses_are_no_second_clock(loss: float) -> None:
    rng = np.random.default_rng(3)
    kept = rng.random(N) >= loss
    t = T + 0.2 * H * rng.normal(size=N)
    assert np.array_equal(order(t, kept), np.argsort(t[kept]))


def test_late_messages_are_put_in_order() -> None:
    moved = np.arange(N)
    moved[1000:1010] = moved[1000:1010][::-1]
    moved[2000:2003] = moved[[2002, 2000, 2001]]
    assert np.array_equal(moved[order(T[moved])], np.arange(N))


@pytest.mark.parametrize('stamp', [0.0, 1e6])
def test_one_stamp_of_another_time_is_left_out(stamp: float) -> None:
    t = T.copy()
    t[4000] = stamp
    assert np.array_equal(order(t), np.delete(np.arange(N), 4000))


def test_a_slower_part_has_missing_samples() -> None:
    found = order(T, (np.arange(N) < 3600) | (np.arange(N) % 2 == 0))
    assert np.array_equal(found, np.arange(4800))


@pytest.mark.parametrize('t', [0.0 * T, np.floor(T / 0.004) * 0.004, T - 0.1 * np.floor(T / 0.2)])
def test_stamps_of_no_use_are_refused(t: np.ndarray) -> None:
    with pytest.raises(CtcError, match=r'closer than the period.*coarser than the period'):
        order(t)


def test_states_that_all_stand_alone_are_refused() -> None:
    """Most steps are far shorter than the period, as between publishers that answer each other."""
    bursts = np.repeat(T, 3) + np.tile([0.0, 1e-6, 2e-6], N)
    with pytest.raises(CtcError, match=r'no regular period.*two publishers of joint states'):
        order_states('run', bursts)
