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

from __future__ import annotations

from ctc_chattering.bags.recording import Recording
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.identification.effort import in_torques
import numpy as np
import pytest

EFFORT = np.array([[1.0, 2.0], [3.0, -4.0], [0.0, 5.0]])
MEASURED = Recording('measured', ('a', 'b'), np.arange(3.0), np.zeros((3, 2)), effort=EFFORT)
BARE = Recording('bare', ('a', 'b'), np.arange(3.0), np.zeros((3, 2)), command=EFFORT)


@pytest.mark.parametrize('side, ratio, constant, factor, then', [
    ('', None, None, [1.0, 1.0], ''), ('link', None, None, [1.0, 1.0], 'link'),
    ('current', None, None, [1.0, 1.0], 'current'),
    ('motor', 100, None, [100.0, 100.0], 'motor'),
    ('current', None, [2.0, 3.0], [2.0, 3.0], 'motor'),
    ('current', [100.0, -50.0], 0.1, [10.0, -5.0], 'motor')])
def test_the_effort_becomes_the_torque_at_the_joint(
        side: str, ratio: list[float] | None, constant: list[float] | None, factor: list[float],
        then: str) -> None:
    (found, bare), now = in_torques([MEASURED, BARE], side, ratio, constant)
    assert found.effort == pytest.approx(EFFORT * factor, rel=1e-15)
    assert bare.effort is None and bare.command is BARE.command
    assert now == then


@pytest.mark.parametrize('side, ratio, constant, words', [
    ('', 100, None, r'^gear_ratio needs side motor or side current: what is the effort\?$'),
    ('link', 100, None, r'behind the gear it is 1$'),
    ('motor', None, 0.1, r'^torque_constant needs side current$'),
    ('current', 100, None, r'^gear_ratio of currents needs torque_constant$')])
def test_what_contradicts_is_refused(
        side: str, ratio: float | None, constant: float | None, words: str) -> None:
    with pytest.raises(CtcError, match=words):
        in_torques([MEASURED], side, ratio, constant)
    with pytest.raises(CtcError, match=r'^side motor: bare has no effort$'):
        in_torques([BARE], 'motor', None, None)


@pytest.mark.parametrize('wrong', [0, [1.0], [1.0, 0.0], [1.0, np.nan], np.inf, ['a', 'b'], True])
def test_a_factor_that_is_none_is_refused(wrong: object) -> None:
    with pytest.raises(ParameterError, match=r'^gear_ratio: '):
        in_torques([MEASURED], 'motor', wrong, None)  # type: ignore[arg-type]


def test_recordings_of_other_joints_are_named() -> None:
    one = Recording('one', ('a',), np.arange(3.0), np.zeros((3, 1)), effort=np.ones((3, 1)))
    with pytest.raises(CtcError, match=r'^one: 1 joints; measured has 2$'):
        in_torques([MEASURED, one], 'motor', 2.0, None)
