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

"""Log times follow the stamps of several topics, and lost messages are counted."""

from __future__ import annotations

from itertools import pairwise
from operator import itemgetter
import random

from ctc_chattering.bags.arrivals import LogTime, SequenceTracker
from ctc_chattering.numerics.time_grid import NANOSECONDS as S
from hypothesis import given
from hypothesis import strategies as st
import pytest

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


@given(st.lists(st.tuples(st.sampled_from('abc'), st.integers(0, 10 * MS)),
                min_size=60, max_size=90),
       st.lists(st.integers(0, 90), min_size=1, max_size=4))
def test_messages_that_are_late_by_any_time_do_not_turn_it_back(
        sent: list[tuple[str, int]], blocked: list[int]) -> None:
    """A recorder that slept receives a whole topic before the next one."""
    stamps = [(topic, S + 100 * k * MS + jitter) for k, (topic, jitter) in enumerate(sent)]
    time, before = LogTime(), 0
    bounds = sorted({0, len(stamps), *(min(x, len(stamps)) for x in blocked)})
    for begin, end in pairwise(bounds):
        for topic, stamp in sorted(stamps[begin:end], key=itemgetter(0)):
            time.note(topic, stamp)
            assert before <= time.now
            before = time.now


@given(st.permutations(range(60)), st.integers(0, 59), st.integers(-S, 20 * S))
def test_a_late_topic_with_some_other_stamps_does_not_turn_it_back(
        order: list[int], index: int, stray: int) -> None:
    """Check neighbours in another order, and one that is stray."""
    late = [2 * S + k * MS for k in sorted(range(60), key=lambda k: k + order[k] % 3)]
    late[index] = stray
    time = LogTime()
    for topic, stamps in (('states', [S, S + MS]), ('clock', range(S, 10 * S, S // 100)),
                          ('states', late)):
        for stamp in stamps:
            time.note(topic, stamp)
    assert time.now >= 10 * S - S // 100


@pytest.mark.parametrize('heard', [
    [('states', 4999 * MS, 4999), ('states', 0, 4999), ('states', MS, 1), ('clock', 10 * MS, 10)],
    [('states', 5 * S, 5000), ('states', 9 * S, 5000), ('states', 9 * S + MS, 9001)],
    [('clock', 10 * S, 10_000), *(
        (topic, t, 10_000) for stray in (0, 5 * S, 10 ** 9 * S, S, 20 * S, -S)
        for t in (stray, 10 * S) for topic in ('clock', 'states'))]])
def test_a_run_that_begins_again_is_believed_at_its_second_message(
        heard: list[tuple[str, int, int]]) -> None:
    """And what was not heard for a while; a stray message is not believed."""
    time = LogTime()
    for topic, stamp, now in heard:
        time.note(topic, stamp)
        assert time.now == now * MS


def lost(numbering: SequenceTracker, number: int, publishers: int) -> int:
    """Return what the recorder counts."""
    return numbering.lost(number, lambda: publishers)


def test_what_one_publisher_loses_is_counted() -> None:
    rng = random.Random(1)
    numbering, found, expected = SequenceTracker(), 0, 0
    lost(numbering, 41, 1)  # Who comes late has missed nothing.
    for number in range(42, 1000):
        if number < 999 and rng.random() < 0.3:
            expected += 1
        else:
            found += lost(numbering, number, 1)
    assert found == expected > 100


def test_a_second_publisher_loses_nothing_by_coming_and_going() -> None:
    """The last messages of one that has left are not taken for those of the other."""
    numbering = SequenceTracker()
    assert not any(lost(numbering, k, 1) for k in range(1, 1000))
    for k in range(1, 50):
        assert lost(numbering, 999 + k, 2) == lost(numbering, k, 2) == 0
    # Messages of both still arrive, but the second one has left the graph.
    assert not any(lost(numbering, k, 1) for k in (50, 1049, 1050))
    assert lost(numbering, 1054, 1) == 3


def test_a_publisher_that_restarts_loses_nothing() -> None:
    numbering = SequenceTracker()
    for _ in range(40):
        assert not any(lost(numbering, k, 1) for k in range(1, 20))
    assert lost(numbering, 22, 1) == 2
