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

"""Back to the reference after a pause."""

from __future__ import annotations

from collections.abc import Iterable

from ctc_chattering.controller.desired_motion import DesiredMotion, PAUSE
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.reference import ReferenceConfig, Sinusoid
from hypothesis import given
from hypothesis import strategies as st
import pytest

S = 1_000_000_000
MS = S // 1000
ZERO = (0.0, 0.0)
REFERENCE = Sinusoid(ReferenceConfig())


def following(times: Iterable[int], delay: int = 0) -> DesiredMotion:
    """Return a motion that has the paper's reference at these instants."""
    motion = DesiredMotion(0, PAUSE, delay)
    ordered = sorted(times)
    motion.extend(ordered, [REFERENCE.at(t) for t in ordered])
    return motion


def desired(motion: DesiredMotion, t: int, q: tuple[float, float], duration: float,
            dq: tuple[float, float] = ZERO) -> list[Point]:
    motion.restart_duration = duration
    points = motion.desired(t, q, dq, wait=False)
    assert points is not None
    return points


@given(st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)), st.integers(PAUSE + 1, 100 * S),
       st.floats(0.2, 5.0), st.integers(0, 3))
def test_after_a_pause_the_error_begins_at_zero_and_the_way_is_within_the_hull(
        q: tuple[float, float], pause: int, duration: float, delay: int) -> None:
    """Whatever the reference has done meanwhile; at the end it is the reference itself."""
    t0 = 2 * MS + pause
    motion = following(
        [0, MS, 2 * MS, *(t0 + k * PAUSE for k in range(60 + delay))], delay)
    for t in (0, MS, 2 * MS):
        assert desired(motion, t, q, duration)[0] == REFERENCE.at(t)
        assert motion.way_back is None
    assert desired(motion, t0, q, duration)[0] == (q, ZERO, ZERO)
    for k in range(1, 60):
        t = t0 + k * PAUSE
        for lag, found in enumerate(desired(motion, t, (9.0, 9.0), duration)):
            for x, start, center in zip(found[0], q, ReferenceConfig().center):
                assert min(start, center - 0.5) - 1e-9 <= x <= max(start, center + 0.5) + 1e-9
            if t + lag * PAUSE >= t0 + round(duration * S):
                assert found == REFERENCE.at(t + lag * PAUSE)
        end = t0 + round(duration * S)
        assert (motion.way_back and motion.way_back.end) == (end if t < end else None)


@pytest.mark.parametrize(('gap', 'duration'), [(PAUSE, 1.0), (5 * S, 0.0), (-5 * S, 1.0)])
def test_without_a_pause_or_a_duration_nothing_is_replaced(gap: int, duration: float) -> None:
    motion = following((0, gap))
    desired(motion, 0, (9.0, 9.0), duration)
    assert desired(motion, gap, (9.0, 9.0), duration) == [REFERENCE.at(gap)]
    assert motion.way_back is None


def test_a_controller_that_is_disabled_at_first_joins_a_reference_that_runs() -> None:
    motion = following((0, S, 2 * S, 2 * S + MS))
    for t in (0, S, 2 * S):
        motion.pass_over(t, driven=False)
    assert desired(motion, 2 * S + MS, (0.3, 0.4), 1.0)[0][0] == (0.3, 0.4)
    assert motion.way_back is not None and motion.way_back.end == 3 * S + MS
