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

"""The time with which messages are logged."""

from __future__ import annotations

from ctc_chattering.bags.writer import LogTime
from ctc_chattering.numerics.time_grid import NANOSECONDS as S
from hypothesis import given
from hypothesis import strategies as st

MS = S // 1000


@given(st.lists(st.tuples(st.sampled_from('abc'), st.integers(0, S // 20)), max_size=100),
       st.dictionaries(st.sampled_from('abc'), st.integers(0, S // 2)))
def test_topics_that_are_behind_others_do_not_turn_it_back(
        steps: list[tuple[str, int]], lags: dict[str, int]) -> None:
    time, truth, before = LogTime(), S, 0
    for topic, step in steps:
        truth += step
        time.note(topic, truth - lags.get(topic, 0))
        assert before <= time.now <= truth
        before = time.now
    assert time.now >= truth - S // 2 or not steps


def test_a_run_that_begins_again_is_believed_at_its_second_message() -> None:
    time = LogTime()
    for k in range(5000):
        time.note('states', k * MS)
    time.note('states', 0)
    assert time.now == 4999 * MS
    time.note('states', MS)
    assert time.now == MS
    time.note('clock', 10 * MS)
    assert time.now == 10 * MS


def test_what_was_not_heard_for_a_while_is_believed_at_its_second_message() -> None:
    time = LogTime()
    time.note('states', 5 * S)
    assert time.now == 5 * S
    time.note('states', 9 * S)
    assert time.now == 5 * S
    time.note('states', 9 * S + MS)
    assert time.now == 9 * S + MS


def test_a_stray_message_is_not() -> None:
    time = LogTime()
    time.note('clock', 10 * S)
    for stray in (0, 5 * S, 10 ** 9 * S, S, 20 * S, -S):
        time.note('clock', stray)
        time.note('states', stray)
        assert time.now == 10 * S
        time.note('clock', 10 * S)
        time.note('states', 10 * S)
    assert time.now == 10 * S
