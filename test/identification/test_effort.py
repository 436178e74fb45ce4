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

import dataclasses

from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.identification.effort import (
    choose_source,
    convert_effort,
    estimate_current_constants,
    scale_by_payload,
)
from ctc_chattering.identification.findings import Reason, Severity
from ctc_chattering.identification.recording import Recording, RecordingFault
from ctc_chattering.identification.stretches import COMMAND, EFFORT, Stretch
from ctc_chattering.numerics.linear_algebra import Array
from made_up_windows import arm_windows, observed
import numpy as np
from panda_torques import JOINTS, panda_torque
import pytest
from refusals import refused
import urdfs

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


def test_currents_get_their_constants_from_the_model() -> None:
    """A joint whose current shows neither weight nor inertia is refused."""
    constant = np.array([20.0, -8.0, 5.0, 5.0, 3.0, 3.0, 2.0])
    rows, _, torque = panda_torque()
    current = torque / constant
    current[:, 6] = np.random.default_rng(0).normal(size=len(current))
    found = estimate_current_constants(
        observed(rows, current), np.zeros_like(current), np.zeros(7))
    assert found.constant[:4] == pytest.approx(constant[:4], rel=0.05)
    for value, estimate in zip(constant[:6], found.estimates):
        assert estimate.value == pytest.approx(value, abs=1.25 * estimate.half)
    assert [(x.reason, x.severity) for x in found.findings] == [
        *[(Reason.URDF_CONSTANT, Severity.CARE)] * 6, (Reason.NO_CONSTANT, Severity.REFUSED)]


def test_a_rotor_that_may_be_all_the_inertia_gives_no_constant() -> None:
    """Of the light last joint, which carries no weight; the others stay as they are."""
    rows, _, torque = panda_torque()
    rotors = np.zeros((7, 7))
    rotors[6, 6] = 1.0
    felt = rows.bodies[:, :, 70:77] @ rotors.sum(axis=0)
    data = observed(rows, (torque + felt) / 2.0)
    sure, doubtful = (
        estimate_current_constants(data, x, np.zeros(7)) for x in (0.0 * felt, felt))
    assert sure.findings[6].severity == Severity.CARE and sure.constant[6] < 0.2
    assert doubtful.findings[6].severity == Severity.REFUSED
    assert doubtful.constant[:4] == pytest.approx(2.0, rel=0.05)
    limits = np.array([80.0, 80.0, 80.0, 80.0, 40.0, 40.0, 20.0])
    assumed = estimate_current_constants(data, felt, limits)
    assert assumed.constant[6] == pytest.approx(0.5, rel=0.1)
    assert assumed.estimates[6].half == assumed.constant[6]
    assert (assumed.findings[6].reason, assumed.findings[6].severity) == (
        Reason.OTHERS_CONSTANT, Severity.CARE)


def test_a_known_payload_tells_torque_constants_from_masses() -> None:
    """Half of the windows have it; without it a scale and the masses look the same."""
    rows, prior, torque = panda_torque()
    loaded, _ = arm_windows(urdfs.panda(), JOINTS, 500)
    extra = 0.3 * loaded.weight
    extra[:250] = 0.0
    heavy = dataclasses.replace(rows, model_torque=rows.model_torque + extra,
                                weight=rows.weight + extra)
    scale = np.array([0.9, 1.1, 1.0, 0.95, 1.0, 1.05, 1.0])
    data, constants = scale_by_payload(observed(heavy, (torque + extra) * scale), prior)
    for joint in (1, 3):
        assert constants[joint].value == pytest.approx(1.0 / scale[joint], rel=0.02)
        assert data.torque[:, joint] == pytest.approx(
            (torque + extra)[:, joint], rel=0.05, abs=0.5)
