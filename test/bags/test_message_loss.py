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

"""Messages lost, against a network that is played through."""

from __future__ import annotations

import random

from ctc_chattering.bags.writer import SequenceTracker


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
