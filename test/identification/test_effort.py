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

"""The torque that is used: commands or an effort, in N·m at the joints."""

from __future__ import annotations

from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.identification.effort import choose_source, convert_effort
from ctc_chattering.identification.recording import Recording, RecordingFault
from ctc_chattering.identification.stretches import COMMAND, EFFORT, Stretch
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest
from refusals import refused

VALUES = np.array([[1.0, 2.0], [3.0, -4.0], [0.0, 5.0]])
MEASURED = Recording('measured', ('a', 'b'), np.arange(3.0), np.zeros((3, 2)), effort=VALUES)
BARE = Recording('bare', ('a', 'b'), np.arange(3.0), np.zeros((3, 2)), command=VALUES)


@pytest.mark.parametrize('side, constant, factor, then', [
    ('', None, [1.0, 1.0], ''), ('link', None, [1.0, 1.0], 'link'),
    ('current', None, [1.0, 1.0], 'current'), ('motor', [100.0, 50.0], [100.0, 50.0], 'motor'),
    ('current', [10.0, -5.0], [10.0, -5.0], 'motor'),
    ('link', [-1.0, -1.0], [-1.0, -1.0], 'link')])
def test_the_effort_becomes_the_torque_at_the_joint(
        side: str, constant: list[float] | None, factor: list[float], then: str) -> None:
    (found, bare), now = convert_effort([MEASURED, BARE], side, constant)
    assert found.effort == pytest.approx(VALUES * factor, rel=1e-15)
    assert bare.effort is None and bare.command is BARE.command
    assert now == then


def test_arguments_that_contradict_each_other_are_refused() -> None:
    with pytest.raises(CtcError, match=r'^torque_constant needs --effort'):
        convert_effort([MEASURED], '', [0.1, 0.1])
    with pytest.raises(CtcError, match=r'^effort motor: bare has no effort$'):
        convert_effort([BARE], 'motor', None)


@pytest.mark.parametrize('wrong', [0, [1.0], [1.0, 0.0], [1.0, np.nan], np.inf, ['a', 'b'], True])
def test_a_wrong_torque_constant_is_refused(wrong: object) -> None:
    with pytest.raises(ParameterError, match=r'^torque_constant: '):
        convert_effort([MEASURED], 'motor', wrong)  # type: ignore[arg-type]


def test_recordings_of_other_joints_are_named() -> None:
    one = Recording('one', ('a',), np.arange(3.0), np.zeros((3, 1)), effort=np.ones((3, 1)))
    with refused(RecordingFault.JOINTS):
        convert_effort([MEASURED, one], 'motor', [2.0, 2.0])


def stretch(effort: Array | None, command: Array | None) -> Stretch:
    return Stretch(0.0, 1e-3, np.zeros((3, 2)), effort, command)


@pytest.mark.parametrize(('effort', 'command', 'side', 'source'), [
    (None, VALUES, '', COMMAND), (VALUES, VALUES, '', COMMAND), (VALUES, VALUES, 'link', COMMAND),
    (VALUES, VALUES, 'motor', EFFORT), (VALUES, VALUES, 'current', EFFORT),
    (VALUES, None, 'motor', EFFORT), (VALUES, None, 'link', EFFORT),
    (VALUES, None, 'current', EFFORT)])
def test_commands_count_unless_an_effort_is_of_the_motor(
        effort: Array | None, command: Array | None, side: str, source: str) -> None:
    assert choose_source([stretch(effort, command)], side, 'bag') == source


def test_an_effort_of_unknown_kind_is_refused() -> None:
    with refused(RecordingFault.TORQUE):
        choose_source([stretch(VALUES, None)], '', 'bag')
