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
"""Unit, sign and order of a torque are those of the model, or refused."""

from __future__ import annotations

import dataclasses

from ctc_chattering.errors import CtcError
from ctc_chattering.identification.conventions import (
    angle_between,
    check_order,
    check_sign,
    check_torque,
    estimate_gravity,
    fit_model,
)
from ctc_chattering.identification.findings import Reason, Severity
from ctc_chattering.identification.recording import RecordingFault
from ctc_chattering.identification.stretches import COMMAND, EFFORT
from made_up_windows import arm_windows, observed
import numpy as np
from panda_torques import COULOMB, JOINTS, panda_torque, scaled_torque, turned_base, VISCOUS
import pytest
from refusals import refused
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]
import urdfs


def test_a_torque_in_newton_metres_passes() -> None:
    assert check_torque(scaled_torque(), EFFORT) == ()
    check_sign(scaled_torque(), EFFORT)
    check_order(scaled_torque(), JOINTS)


@pytest.mark.parametrize('factor', [1e-3, 0.08, 12.0])
def test_another_unit_is_refused_with_its_options(factor: float) -> None:
    with pytest.raises(CtcError, match=r'the effort has .* times the weight of the model\. .*'
                       '--effort current .*--torque-constant .*--gravity 0'):
        check_torque(scaled_torque(factor), EFFORT)


def test_a_torque_without_the_weight_is_refused() -> None:
    rows, _, torque = panda_torque()
    with refused(RecordingFault.UNIT):
        check_torque(observed(rows, torque - rows.weight), COMMAND)


def test_a_joint_in_another_unit_is_named() -> None:
    factor = np.ones(7)
    factor[3] = 0.1
    (finding,) = check_torque(scaled_torque(factor), EFFORT)
    assert (finding.reason, finding.severity, finding.joint) == (
        Reason.UNITS, Severity.REFUSED, 3)
    assert finding.values['factor'] == pytest.approx(0.1, rel=0.05)


def test_a_load_at_the_tip_is_no_other_unit() -> None:
    """It multiplies the small weight of the last joints, and adds little to that of the others."""
    rows, _, torque = panda_torque()
    heavier = torque + rows.weight * np.array([0.0, 0.2, 0.3, 0.3, 5.0, 5.0, 5.0])
    findings = check_torque(observed(rows, heavier), EFFORT)
    assert {(x.reason, x.severity) for x in findings} == {(Reason.TOOL, Severity.CARE)}


def test_the_other_sign_is_refused_with_the_option_that_turns_it() -> None:
    with pytest.raises(CtcError, match=r'has the other sign\. .*--torque-constant=-1'):
        check_sign(scaled_torque(-1.0), EFFORT)
    with refused(RecordingFault.SIGN):
        check_sign(scaled_torque(-1.0), COMMAND)


@pytest.mark.parametrize('friction', [True, False])
def test_an_arm_on_the_ceiling_has_its_sign(friction: bool) -> None:
    """Its weight has the other sign; friction tells, or without it the inertia."""
    rows = panda_torque().rows
    ceiling, _ = turned_base(Rotation.from_euler('x', np.pi))
    if not friction:
        away = rows.direction * COULOMB + rows.velocity * VISCOUS
        ceiling = observed(rows, ceiling.torque - away)
    check_sign(ceiling, EFFORT)
    with refused(RecordingFault.SIGN):
        check_sign(observed(rows, -ceiling.torque), EFFORT)


@pytest.mark.parametrize('order', [
    (1, 0, 2, 3, 4, 5, 6), (0, 1, 2, 3, 4, 6, 5), (6, 5, 4, 3, 2, 1, 0), (1, 2, 0, 3, 4, 5, 6)])
def test_another_order_is_refused(order: tuple[int, ...]) -> None:
    rows, _, torque = panda_torque()
    with refused(RecordingFault.ORDER):
        check_order(observed(rows, torque[:, order]), JOINTS)


def test_a_wrong_model_and_a_joint_without_commands_are_no_other_order() -> None:
    rows, _, torque = panda_torque()
    rng = np.random.default_rng(1)
    weight = rows.weight * rng.uniform(0.7, 1.5, 7)
    inertial = (rows.model_torque - rows.weight) * rng.uniform(0.5, 2.0, 7)
    wrong = dataclasses.replace(rows, weight=weight, model_torque=weight + inertial)
    missing = torque.copy()
    missing[:, 2] = np.nan
    check_order(observed(wrong, missing), JOINTS)


@pytest.mark.parametrize('joint', [0, 1, 4])
def test_one_joint_of_the_other_sign_is_refused_alone(joint: int) -> None:
    """The sign is turned for the bodies that other joints share."""
    sign = np.ones(7)
    sign[joint] = -1.0
    found = check_sign(scaled_torque(sign), EFFORT)
    assert found.constant == pytest.approx(sign)
    (finding,) = found.findings
    assert (finding.reason, finding.severity, finding.joint) == (
        Reason.SIGN, Severity.REFUSED, joint)
    option = ','.join(f'{x:g}' for x in sign)
    assert finding.values['option'] == option


def test_a_weight_shows_unless_the_axis_is_vertical() -> None:
    """The first axis is vertical: its torque tells nothing of weight."""
    assert not fit_model(scaled_torque(), 0).factors[0].is_known
    for joint in (1, 3):
        factor = fit_model(scaled_torque(1.3), joint).factors[0]
        assert factor.value == pytest.approx(1.3, abs=3.0 * factor.error)
        assert factor.sign == 1.0


@pytest.mark.parametrize('degrees', [5.0, 30.0, 90.0, 180.0])
@pytest.mark.parametrize('axis', ['x', 'y'])
def test_a_base_that_is_mounted_otherwise(degrees: float, axis: str) -> None:
    data, gravity = turned_base(Rotation.from_euler(axis, degrees, degrees=True))
    found = estimate_gravity(data, np.array([0.0, 0.0, -9.81]))
    assert np.degrees(angle_between(found, gravity)) < 1.0
    assert np.linalg.norm(found) == pytest.approx(9.81)


def test_a_base_that_is_mounted_as_the_urdf_has_it() -> None:
    gravity = np.array([0.0, 0.0, -9.81])
    assert estimate_gravity(scaled_torque(), gravity) is gravity


def test_a_planar_arm_keeps_gravity_across_its_plane() -> None:
    rows, _ = arm_windows(urdfs.two_links(), urdfs.TWO_LINKS, 400)
    down = Rotation.from_euler('y', 60.0, degrees=True).apply([0.0, 0.0, -9.81])
    torque = rows.model_torque + rows.bodies[:, :, -3:] @ (down - [0.0, 0.0, -9.81])
    data = observed(rows, torque + 2.0 * rows.direction)
    found = estimate_gravity(data, np.array([0.0, 0.0, -9.81]))
    assert found == pytest.approx(down, abs=0.05)
