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

"""When a plant goes on: answers in lockstep that may be late."""

from __future__ import annotations

from ctc_chattering.controller.lockstep_exchange import LockstepExchange
from hypothesis import given
from hypothesis import strategies as st

MS = 1_000_000


@given(st.lists(st.tuples(st.integers(0, 1), st.integers(0, 3)), min_size=1, max_size=30))
def test_every_state_is_answered_once(states: list[tuple[int, int]]) -> None:
    """
    Repeat states, each of which gets an answer that comes late.

    The torque is 0 or 1, so that many answers in a row are equal; further answers to a state come
    after the first and before that to the next one.
    """
    exchange, now, late, last = LockstepExchange(0), 0, 0, 0
    for tau, repeats in states:
        exchange.sent_at = now
        for _ in range(repeats):
            now += 201 * MS
            assert exchange.repeat_due(now)
            assert not exchange.repeat_due(now + 199 * MS)
        assert not any(exchange.accept((float(last),)) for _ in range(late))
        assert exchange.accept((float(tau),))
        last, late = tau, repeats
        now += MS
