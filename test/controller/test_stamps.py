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

"""Verdicts on stamps, against time lines of which the truth is known."""

from collections.abc import Sequence
import dataclasses

from ctc_chattering.controller.stamps import (
    BACKWARD,
    GAP,
    JUMP,
    NEXT,
    REPEATED,
    RESTART,
    STALE,
    Stamps,
    TAKEN,
)
from hypothesis import assume, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

MS = 1_000_000
LIMIT = 20 * MS
PERIODS = st.integers(100_000, 10 * MS)
CLOCKS = st.integers(-10 ** 18, 10 ** 18)


@dataclasses.dataclass
class Line:
    """
    A source and its way to us: what really happens.

    Attributes
    ----------
    period : int
        Of the source [ns].
    offset : int
        Its clock less ours [ns].
    delay : int
        Shortest delay [ns].

    """

    period: int = MS
    offset: int = 10 ** 17
    delay: int = 300_000

    def __post_init__(self) -> None:
        self.stamps = Stamps(LIMIT)
        self.t = 0

    def say(self, late: int = 0, jump: int = 0, simulated: bool = False) -> str:
        """Return the verdict on the state of now, which comes `late` [ns] after it should."""
        self.offset += jump
        return self.stamps.classify(
            self.t + self.offset, self.t + self.delay + late, simulated)

    def go(self, count: int, simulated: bool = False) -> list[str]:
        """Let `count` periods pass, one state each, and return the verdicts."""
        found = []
        for _ in range(count):
            self.t += self.period
            found.append(self.say(simulated=simulated))
        return found

    def burst(self, stall: int) -> list[tuple[str, int]]:
        """Let us stand still for `stall` [ns]; return each state's verdict and how late it was."""
        start = self.t
        rows = []
        for k in range(1, stall // self.period + 1):
            self.t = start + k * self.period
            late = start + stall - self.t
            rows.append((self.say(late), late))
        return rows


@given(PERIODS, CLOCKS, st.lists(st.integers(0, LIMIT), min_size=5, max_size=200))
def test_regular_with_jitter(period: int, offset: int, late: list[int]) -> None:
    """Check that whatever comes in order and late by no more than the limit is taken."""
    line = Line(period, offset)
    arrived, found = 0, []
    for x in late:
        line.t += period
        arrived = max(arrived, line.t + x)
        found.append(line.say(arrived - line.t))
    assert found == [RESTART] + [NEXT] * (len(late) - 1)


@given(PERIODS, CLOCKS, st.lists(st.tuples(
    st.sampled_from(['run', 'outage', 'stall']), st.integers(0, 400 * MS)), max_size=8))
def test_any_mixture_takes_what_is_fresh_and_nothing_else(
        period: int, offset: int, story: list[tuple[str, int]]) -> None:
    """Check every state of runs, outages and stalls against how late it truly was."""
    line = Line(period, offset)
    line.go(1)
    duration = MS + sum(length for _, length in story)
    for kind, length in story:
        if kind == 'run':
            verdicts = line.go(length // (5 * period))
            assert set(verdicts) <= {NEXT, GAP}
            assert GAP not in verdicts[1:]
        elif kind == 'outage':
            line.t += length
            assert line.go(1) == [NEXT if length + period <= LIMIT else GAP]
        else:
            for verdict, late in line.burst(length):
                assert verdict in {NEXT, GAP, STALE}
                if late <= LIMIT:
                    assert verdict != STALE
                if late > LIMIT + duration // 1000:
                    assert verdict == STALE


@given(PERIODS, st.integers(0, 10_000 * MS), st.booleans())
def test_an_outage_is_a_gap(period: int, silence: int, simulated: bool) -> None:
    """Check a source that was silent: at once in real time, confirmed in simulated time."""
    line = Line(period)
    line.go(10, simulated)
    line.t += silence
    verdicts = line.go(10, simulated)
    if silence + period <= LIMIT:
        assert verdicts == [NEXT] * 10
    elif simulated:
        assert verdicts == [JUMP, GAP] + [NEXT] * 8
    else:
        assert verdicts == [GAP] + [NEXT] * 9


@given(PERIODS, st.integers(-10_000 * MS, 10_000 * MS), st.booleans())
def test_a_clock_that_is_set(period: int, jump: int, simulated: bool) -> None:
    """Check that one state is lost, and that lateness is then measured by the new clock."""
    assume(abs(abs(jump) - LIMIT) > MS // 10)
    assume(abs(2 * period + jump) > period)  # Else the next one is beyond the last one again.
    line = Line(period)
    line.go(50, simulated)
    line.t += period
    step = period + jump
    first = line.say(jump=jump, simulated=simulated)
    after = line.go(20, simulated)
    if 0 < step <= LIMIT and (jump > -LIMIT or simulated):
        assert [first, *after] == [NEXT] * 21
    elif 0 < jump < LIMIT and not simulated:
        assert [first, *after] == [GAP] + [NEXT] * 20
    else:
        assert first == (BACKWARD if step < 0 else JUMP)
        assert after == [RESTART if step < 0 else GAP] + [NEXT] * 19
    if abs(jump) > LIMIT and not simulated:
        line.t += period
        assert line.say(late=LIMIT // 2) == NEXT
        line.t += period
        assert line.say(late=LIMIT + 2 * MS) == STALE


@given(st.integers(2, 60), st.integers(-10 ** 12, -LIMIT) | st.integers(2 * LIMIT, 10 ** 12),
       st.booleans())
def test_a_single_message_out_of_order(at: int, away: int, simulated: bool) -> None:
    """Check that it is refused and disturbs no other, wherever it points to but shortly ahead."""
    line = Line()
    line.go(at, simulated)
    now = line.t + line.delay + 1000
    verdict = line.stamps.classify(line.t + line.offset + away, now, simulated)
    assert verdict == (BACKWARD if away < 0 else JUMP)
    assert line.go(60, simulated) == [NEXT] * 60


def _drifting(rate: float, minutes: float, period: int = 10 * MS) -> list[str]:
    """Return the verdicts where our clock runs faster than the source's by `rate`."""
    stamps = Stamps(LIMIT)
    rng = np.random.default_rng(0)
    sent = np.arange(round(minutes * 60e9 / period)) * period
    arrivals = np.round(sent * (1.0 + rate)).astype(np.int64)
    arrivals += rng.integers(0, period // 2, len(sent))
    return [stamps.classify(t, now, False) for t, now in zip(sent.tolist(), arrivals.tolist())]


@pytest.mark.parametrize('rate', [-200e-6, 500e-6])
def test_clocks_that_drift_apart(rate: float) -> None:
    """Check that nothing is called stale in ten minutes, and that the leak is bounded."""
    verdicts = _drifting(rate, 10.0)
    assert set(verdicts[1:]) == {NEXT}
    assert len(verdicts) * 10 * MS * abs(rate) > 5 * LIMIT
    assert STALE in _drifting(5e-3, 1.0)


@pytest.mark.parametrize('rate', [200e-6, -200e-6])
def test_drift_over_an_outage(rate: float) -> None:
    """Check that the first state after an hour of silence is taken, whatever the clocks did."""
    stamps, start = Stamps(LIMIT), 3_600_000 * MS
    stamps.classify(0, 0, False)
    assert stamps.classify(round((1.0 + rate) * start), start, False) == GAP


@pytest.mark.parametrize('limits', [40, 60])
def test_a_delay_that_stays_is_believed_at_last(limits: int) -> None:
    """Check that a way that became longer is refused for fifty limits, and then goes on."""
    line = Line()
    line.go(100)
    line.delay += 2 * LIMIT
    verdicts = line.go(limits * LIMIT // MS)
    refused = verdicts.count(STALE)
    assert verdicts[:refused] == [STALE] * refused
    assert refused == pytest.approx(min(limits, 50) * LIMIT / MS, abs=2)
    assert verdicts[refused:] == [GAP] * (limits > 50) + [NEXT] * (len(verdicts) - refused - 1)


@settings(max_examples=200)
@given(st.lists(st.tuples(st.integers(-50, 50), st.integers(0, 50)), max_size=60), st.booleans())
def test_nothing_is_taken_twice(steps: Sequence[tuple[int, int]], simulated: bool) -> None:
    """Check of any stamps at all that those taken go forward between two new runs."""
    stamps, t, now, last = Stamps(LIMIT), 0, 0, None
    for step, wait in steps:
        t, now = t + step * MS, now + wait * MS
        verdict = stamps.classify(t, now, simulated)
        if verdict in TAKEN:
            assert last is None or verdict == RESTART or t > last
            assert (verdict == NEXT) <= (last is not None and t - last <= LIMIT)
            last = t
        else:
            assert last is not None
            assert (verdict == REPEATED) == (t == last)
            assert verdict != BACKWARD or t < last
            assert verdict not in (JUMP, STALE) or t > last
