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

"""Who is obeyed on a topic, against publishers of which the truth is known."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses

from ctc_chattering.ros.topic_ownership import TopicOwnership
from hypothesis import given
from hypothesis import strategies as st

MS = 1_000_000
SECOND = 1000 * MS


@dataclasses.dataclass(frozen=True)
class Publisher:
    """One that is matched from `begin` to `end` [ms] and publishes every `period` [ms]."""

    begin: int
    end: int
    period: int

    def sends(self, t: int) -> bool:
        return self.begin <= t < self.end and (t - self.begin) % self.period == 0


PUBLISHERS = st.builds(
    lambda begin, lasts, period: Publisher(begin, begin + lasts, period),
    st.integers(0, 300), st.integers(1, 300), st.integers(1, 20))


def admitted(publishers: Sequence[Publisher], every: int) -> list[tuple[int, int]]:
    """
    Return time [ms] and sender of the messages that are obeyed.

    What was received is taken `every` so many milliseconds, as by a process that stood still.
    """
    ownership = TopicOwnership()
    queue: list[tuple[int, int]] = []
    obeyed: list[tuple[int, int]] = []
    for t in range(max(p.end for p in publishers) + every):
        queue += [(t, i) for i, p in enumerate(publishers) if p.sends(t)]
        if t % every:
            continue
        # Of the middleware only the present count is known, and only when a message is taken.
        count = sum(p.begin <= t < p.end for p in publishers)
        for received, sender in queue:
            if count != ownership.publishers:
                ownership.update(count, t * MS)
            if ownership.admits(received * MS):
                obeyed.append((received, sender))
        queue = []
    return obeyed


@given(st.lists(PUBLISHERS, min_size=1, max_size=4))
def test_a_message_is_obeyed_while_one_publisher_is_matched(publishers: list[Publisher]) -> None:
    """Check every message of every millisecond, whoever comes and goes."""
    expected: list[tuple[int, int]] = []
    contested_until = -1
    before = 0
    for t in range(max(p.end for p in publishers)):
        matched = [i for i, p in enumerate(publishers) if p.begin <= t < p.end]
        sending = [i for i in matched if publishers[i].sends(t)]
        if sending:  # The count is looked at with each message.
            if before > 1 and len(matched) <= 1:
                contested_until = t
            before = len(matched)
        if len(matched) == 1 and t > contested_until:
            expected += [(t, i) for i in sending]
    assert admitted(publishers, 1) == expected


@given(st.lists(PUBLISHERS, min_size=2, max_size=2), st.integers(2, 200))
def test_what_was_queued_while_there_were_two_is_not_obeyed(
        publishers: list[Publisher], every: int) -> None:
    """The process stands still again and again; one leaves meanwhile, its messages are there."""
    seen_two = {t for t in range(0, 1000, every)
                if all(p.begin <= t < p.end for p in publishers)}
    for received, _ in admitted(publishers, every):
        taken = -(-received // every) * every
        assert taken not in seen_two
        assert taken - every not in seen_two


def test_a_clock_that_was_set_does_not_silence_a_topic() -> None:
    ownership = TopicOwnership()
    ownership.update(2, 1000 * SECOND)
    ownership.update(1, 1001 * SECOND)
    assert not ownership.admits(1001 * SECOND - MS)
    assert ownership.admits(500 * SECOND)
    assert ownership.admits(0)  # The middleware does not tell.
