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
"""Unit, sign and order of a torque, mounting of the base, and torque constants."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import NamedTuple

from ctc_chattering.errors import CtcError
from ctc_chattering.identification.conventions import (
    angle_between,
    check_order,
    check_sign,
    check_torque,
    constants_of_currents,
    mounted_gravity,
    payload_scale,
    shape,
)
from ctc_chattering.identification.findings import Reason, Severity
from ctc_chattering.identification.prior import BodyPrior
from ctc_chattering.identification.regression import Observations
from ctc_chattering.identification.windows import Windows
from ctc_chattering.numerics.linear_algebra import Array
from made_up_windows import arm_windows, observed
import numpy as np
import pytest
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]
import urdfs

#: Friction, weight and inertia of a geared arm: Coulomb [N·m], viscous [N·m·s/rad].
COULOMB = np.array([4.0, 4.0, 3.0, 3.0, 1.0, 1.0, 0.5])
VISCOUS = 0.3 * COULOMB
JOINTS = urdfs.PANDA


class Panda(NamedTuple):
    """Windows, the prior of the bodies, and the torque of the robot [N·m]."""

    rows: Windows
    prior: BodyPrior
    torque: Array


@cache
def panda() -> Panda:
    rows, regressor = arm_windows(urdfs.panda(), JOINTS, 500)
    friction = rows.direction * COULOMB + rows.velocity * VISCOUS
    noise = 0.05 * np.random.default_rng(1).normal(size=friction.shape)
    return Panda(rows, BodyPrior.of(regressor, 0.2), rows.model_torque + friction + noise)


def signal(factor: Array | float = 1.0) -> Observations:
    return observed(panda().rows, panda().torque * factor)


def turned(rotation: Rotation, sign: float = 1.0) -> tuple[Observations, Array]:
    """Return the torque of the arm on a turned base, and gravity in its frame."""
    rows, _, torque = panda()
    gravity = rotation.apply([0.0, 0.0, -9.81])
    change = rows.bodies[:, :, -3:] @ (gravity - [0.0, 0.0, -9.81])
    return observed(rows, sign * (torque + change)), gravity


def test_a_torque_in_newton_metres_passes() -> None:
    assert check_torque(signal(), 'effort') == ()
    check_sign(signal(), JOINTS, 'effort')
    check_order(signal(), JOINTS)


@pytest.mark.parametrize('factor', [1e-3, 0.08, 12.0])
def test_another_unit_is_refused_with_its_options(factor: float) -> None:
    with pytest.raises(CtcError, match=r'the effort has .* times the weight of the model: .*'
                       '--effort current; .*--torque-constant; .*--gravity 0'):
        check_torque(signal(factor), 'effort')


def test_a_torque_without_the_weight_is_refused() -> None:
    rows, _, torque = panda()
    with pytest.raises(CtcError, match='carries its weight itself --gravity 0'):
        check_torque(observed(rows, torque - rows.weight), 'commanded torque')


def test_a_joint_in_another_unit_is_named() -> None:
    factor = np.ones(7)
    factor[3] = 0.1
    (finding,) = check_torque(signal(factor), 'effort')
    assert (finding.reason, finding.severity, finding.joint) == (
        Reason.UNITS, Severity.REFUSED, 3)
    assert finding.values['factor'] == pytest.approx(0.1, rel=0.05)


def test_a_load_at_the_tip_is_no_other_unit() -> None:
    """It multiplies the small weight of the last joints, and adds little to that of the others."""
    rows, _, torque = panda()
    heavier = torque + rows.weight * np.array([0.0, 0.2, 0.3, 0.3, 5.0, 5.0, 5.0])
    findings = check_torque(observed(rows, heavier), 'effort')
    assert {(x.reason, x.severity) for x in findings} == {(Reason.TOOL, Severity.CARE)}


def test_the_other_sign_is_refused_with_the_option_that_turns_it() -> None:
    with pytest.raises(CtcError, match=r'has the other sign: .*--torque-constant=-1'):
        check_sign(signal(-1.0), JOINTS, 'effort')
    with pytest.raises(CtcError, match=r'has the other sign: .* sign of the recorded commands'):
        check_sign(signal(-1.0), JOINTS, 'commanded torque')


@pytest.mark.parametrize('friction', [True, False])
def test_an_arm_on_the_ceiling_has_its_sign(friction: bool) -> None:
    """Its weight has the other sign; friction tells, or without it the inertia."""
    rows = panda().rows
    ceiling, _ = turned(Rotation.from_euler('x', np.pi))
    if not friction:
        away = rows.direction * COULOMB + rows.velocity * VISCOUS
        ceiling = observed(rows, ceiling.torque - away)
    check_sign(ceiling, JOINTS, 'effort')
    with pytest.raises(CtcError, match='the other sign'):
        check_sign(observed(rows, -ceiling.torque), JOINTS, 'effort')


@pytest.mark.parametrize('degrees', [5.0, 30.0, 90.0, 180.0])
@pytest.mark.parametrize('axis', ['x', 'y'])
def test_a_base_that_is_mounted_otherwise(degrees: float, axis: str) -> None:
    data, gravity = turned(Rotation.from_euler(axis, degrees, degrees=True))
    found = mounted_gravity(data, np.array([0.0, 0.0, -9.81]))
    assert np.degrees(angle_between(found, gravity)) < 1.0
    assert np.linalg.norm(found) == pytest.approx(9.81)


def test_a_base_that_is_mounted_as_the_urdf_has_it() -> None:
    gravity = np.array([0.0, 0.0, -9.81])
    assert mounted_gravity(signal(), gravity) is gravity


def test_a_planar_arm_keeps_gravity_across_its_plane() -> None:
    rows, _ = arm_windows(urdfs.two_links(), urdfs.TWO_LINKS, 400)
    down = Rotation.from_euler('y', 60.0, degrees=True).apply([0.0, 0.0, -9.81])
    torque = rows.model_torque + rows.bodies[:, :, -3:] @ (down - [0.0, 0.0, -9.81])
    data = observed(rows, torque + 2.0 * rows.direction)
    found = mounted_gravity(data, np.array([0.0, 0.0, -9.81]))
    assert found == pytest.approx(down, abs=0.05)


@pytest.mark.parametrize('order', [
    (1, 0, 2, 3, 4, 5, 6), (0, 1, 2, 3, 4, 6, 5), (6, 5, 4, 3, 2, 1, 0), (1, 2, 0, 3, 4, 5, 6)])
def test_another_order_is_refused(order: tuple[int, ...]) -> None:
    rows, _, torque = panda()
    with pytest.raises(CtcError, match=r'give --joints in their order$'):
        check_order(observed(rows, torque[:, order]), JOINTS)


def test_a_wrong_model_and_a_joint_without_commands_are_no_other_order() -> None:
    rows, _, torque = panda()
    rng = np.random.default_rng(1)
    weight = rows.weight * rng.uniform(0.7, 1.5, 7)
    inertial = (rows.model_torque - rows.weight) * rng.uniform(0.5, 2.0, 7)
    wrong = dataclasses.replace(rows, weight=weight, model_torque=weight + inertial)
    missing = torque.copy()
    missing[:, 2] = np.nan
    check_order(observed(wrong, missing), JOINTS)


def test_currents_get_their_constants_from_the_model() -> None:
    """A joint whose current shows neither weight nor inertia is refused."""
    constant = np.array([20.0, -8.0, 5.0, 5.0, 3.0, 3.0, 2.0])
    rows, _, torque = panda()
    current = torque / constant
    current[:, 6] = np.random.default_rng(0).normal(size=len(current))
    found = constants_of_currents(
        observed(rows, current), JOINTS, np.zeros_like(current), np.zeros(7))
    assert found.constant[:4] == pytest.approx(constant[:4], rel=0.05)
    for value, estimate, error in zip(constant[:6], found.estimates(), found.errors):
        assert estimate.value == pytest.approx(value, abs=2.5 * error)
    assert [(x.reason, x.severity) for x in found.findings] == [
        *[(Reason.URDF_CONSTANT, Severity.CARE)] * 6, (Reason.NO_CONSTANT, Severity.REFUSED)]


def test_a_rotor_that_may_be_all_the_inertia_gives_no_constant() -> None:
    """Of the light last joint, which carries no weight; the others stay as they are."""
    rows, _, torque = panda()
    rotors = np.zeros((7, 7))
    rotors[6, 6] = 1.0
    felt = rows.bodies[:, :, 70:77] @ rotors.sum(axis=0)
    data = observed(rows, (torque + felt) / 2.0)
    sure, doubtful = (
        constants_of_currents(data, JOINTS, x, np.zeros(7)) for x in (0.0 * felt, felt))
    assert sure.findings[6].severity == Severity.CARE and sure.constant[6] < 0.2
    assert doubtful.findings[6].severity == Severity.REFUSED
    assert doubtful.constant[:4] == pytest.approx(2.0, rel=0.05)
    limits = np.array([80.0, 80.0, 80.0, 80.0, 40.0, 40.0, 20.0])
    assumed = constants_of_currents(data, JOINTS, felt, limits)
    assert assumed.constant[6] == pytest.approx(0.5, rel=0.1)
    assert assumed.errors[6] == 0.5 * assumed.constant[6]
    assert (assumed.findings[6].reason, assumed.findings[6].severity) == (
        Reason.OTHERS_CONSTANT, Severity.CARE)


def test_the_shape_of_a_torque() -> None:
    """The first axis is vertical: its torque tells nothing of weight."""
    assert not shape(signal(), 0).shows_weight
    for joint in (1, 3):
        factor = shape(signal(1.3), joint).weight
        assert factor.value == pytest.approx(1.3, abs=3.0 * factor.error)
        assert factor.sign == 1.0


def test_a_known_payload_tells_torque_constants_from_masses() -> None:
    """Half of the windows have it; without it a scale and the masses look the same."""
    rows, prior, torque = panda()
    loaded, _ = arm_windows(urdfs.panda(), JOINTS, 500)
    extra = 0.3 * loaded.weight
    extra[:250] = 0.0
    heavy = dataclasses.replace(rows, model_torque=rows.model_torque + extra,
                                weight=rows.weight + extra)
    scale = np.array([0.9, 1.1, 1.0, 0.95, 1.0, 1.05, 1.0])
    data, constants = payload_scale(observed(heavy, (torque + extra) * scale), prior)
    for joint in (1, 3):
        assert constants[joint].value == pytest.approx(1.0 / scale[joint], rel=0.02)
        assert data.torque[:, joint] == pytest.approx(
            (torque + extra)[:, joint], rel=0.05, abs=0.5)


@pytest.mark.parametrize('joint', [0, 1, 4])
def test_one_joint_of_the_other_sign_is_refused_alone(joint: int) -> None:
    """The sign is turned for the bodies that other joints share."""
    sign = np.ones(7)
    sign[joint] = -1.0
    found = check_sign(signal(sign), JOINTS, 'effort')
    assert found.constant == pytest.approx(sign)
    (finding,) = found.findings
    assert (finding.reason, finding.severity, finding.joint) == (
        Reason.SIGN, Severity.REFUSED, joint)
    option = ','.join(f'{x:g}' for x in sign)
    assert finding.values['option'] == option
