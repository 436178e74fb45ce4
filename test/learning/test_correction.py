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


"""The correction as a motion."""

from __future__ import annotations

from ctc_chattering.learning.correction import ConstantCorrection, CorrectedMotion, Correction
from ctc_chattering.learning.motion import RepeatedMotion
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig
from ctc_chattering.trajectory.transitions import TimedMotion
import numpy as np
import pytest

#: Path time at which the motion begins, and duration of a pass [ns].
BEGIN, DURATION = 3 * NANOSECONDS, 2 * NANOSECONDS
COUNT = 400
STEP_NS = 10_000


def repeated(is_periodic: bool) -> RepeatedMotion:
    motion = make_motion(ReferenceConfig())
    return RepeatedMotion('motion', motion, BEGIN, DURATION, is_periodic, BEGIN)


def rows() -> Array:
    phase = 2.0 * np.pi * np.arange(COUNT) / COUNT
    return 1e-3 * np.column_stack([np.sin(phase), np.cos(3.0 * phase) - 0.5])


def numbers(motion: TimedMotion, t: int) -> Array:
    return np.array(motion.at(t))


@pytest.mark.parametrize('is_periodic', [True, False])
@pytest.mark.parametrize('corrected', [True, False])
def test_derivatives_are_those_of_the_position(is_periodic: bool, corrected: bool) -> None:
    correction: TimedMotion = Correction(repeated(is_periodic), rows())
    if corrected:
        correction = CorrectedMotion(make_motion(ReferenceConfig()), correction)
    h = STEP_NS / NANOSECONDS
    for t in range(BEGIN + 1_000_003, BEGIN + DURATION - 1_000_000, DURATION // 37):
        before, now, after = (numbers(correction, t + k * STEP_NS) for k in (-1, 0, 1))
        differences = (after - before)[:2] / (2.0 * h)
        assert now[1:] == pytest.approx(differences, rel=1e-4, abs=2e-5)


def test_it_goes_through_its_rows() -> None:
    correction = Correction(repeated(is_periodic=True), rows())
    for k in (0, 1, 133, COUNT - 1):
        assert numbers(correction, BEGIN + k * DURATION // COUNT)[0] == pytest.approx(rows()[k])


def test_a_periodic_one_is_continuous_up_to_the_acceleration() -> None:
    """At the end of a pass, and the same in each pass, also before the first."""
    correction = Correction(repeated(is_periodic=True), rows())
    end = BEGIN + DURATION
    gap = np.abs(numbers(correction, end) - numbers(correction, end - 1))
    assert gap.max(axis=1) == pytest.approx(np.zeros(3), abs=1e-8)
    for t in (BEGIN + 123_456_789, end - 1):
        for turns in (-1, 2):
            again = numbers(correction, t + turns * DURATION)
            assert np.array_equal(again, numbers(correction, t))


def test_waypoints_keep_the_ends_of_their_correction() -> None:
    """The velocity passes into 0 there."""
    ends = rows()
    ends[-1] = 2e-3
    correction = Correction(repeated(is_periodic=False), ends)
    for t, row in ((BEGIN - 1, ends[0]), (BEGIN + DURATION, ends[-1]), (10 * BEGIN, ends[-1])):
        q, dq, ddq = numbers(correction, t)
        assert q == pytest.approx(row)
        assert not dq.any() and not ddq.any()
    _, dq, _ = numbers(correction, BEGIN + DURATION - 1)
    assert dq == pytest.approx([0.0, 0.0], abs=1e-6)


def test_without_a_correction_the_motion_is_itself() -> None:
    motion = make_motion(ReferenceConfig())
    corrected = CorrectedMotion(motion, ConstantCorrection((0.0, 0.0)))
    assert np.array_equal(numbers(corrected, 12345), numbers(motion, 12345))
