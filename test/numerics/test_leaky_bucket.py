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

"""Limits of the time for parameter requests and of the messages of a page."""

from __future__ import annotations

from ctc_chattering.live.server import MESSAGE_BURST, MESSAGE_RATE_HZ
from ctc_chattering.numerics.leaky_bucket import LeakyBucket
from ctc_chattering.ros.parameters import MAX_SET_BURST_S, MAX_SET_SHARE
import pytest


def set_bucket() -> LeakyBucket:
    """Return the limit of the time that setting parameters takes."""
    return LeakyBucket(MAX_SET_SHARE, MAX_SET_BURST_S)


@pytest.mark.parametrize(('takes', 'period', 'refused'), [
    (6e-3, 1 / 60, 0.0),     # A slider that is moved.
    (10e-3, 20e-3, 0.0),     # Half of the time.
    (12e-3, 20e-3, 0.17),    # A sixth of such requests must be refused.
    (5e-3, 5e-3, 0.5)])      # A flood: half of the time is left.
def test_it_limits_the_share_of_the_time(takes: float, period: float, refused: float) -> None:
    bucket, end, count = set_bucket(), 0.0, 20_000
    refusals = 0
    for k in range(count):
        begin = max(k * period, end)
        if bucket.fill(0.0, begin):
            refusals += 1
            end = begin
        else:
            end = begin + takes
            bucket.fill(takes, begin)
    assert refusals / count == pytest.approx(refused, abs=0.02)


def test_a_burst_is_taken_at_once_and_again_after_a_pause() -> None:
    bucket, now = set_bucket(), 100.0
    for _ in range(2):
        count = 0
        while not bucket.fill(0.0, now):
            bucket.fill(0.01, now)
            now += 0.01
            count += 1
        assert count == pytest.approx(200, abs=2)
        now += 10.0


def test_a_page_that_is_used_waits_for_nothing_and_one_that_floods_does() -> None:
    bucket = LeakyBucket(MESSAGE_RATE_HZ, MESSAGE_BURST)
    # A slider or a camera that is moved for ten seconds.
    assert [bucket.fill(1.0, 50.0 + k / 60.0) for k in range(600)] == [0.0] * 600
    bucket, now = LeakyBucket(MESSAGE_RATE_HZ, MESSAGE_BURST), 50.0
    for _ in range(1000):
        now += bucket.fill(1.0, now) / MESSAGE_RATE_HZ
    assert now - 50.0 == pytest.approx((1000 - MESSAGE_BURST) / MESSAGE_RATE_HZ, rel=1e-3)
