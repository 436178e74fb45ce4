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

"""What an effort is follows from its friction, its weight, and the commands; their order."""

from __future__ import annotations

import dataclasses
from functools import cache

from ctc_chattering.bags.recording import Recording, Stretch, stretches
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.identification.drives import COMMAND
from ctc_chattering.identification.effort import (
    check_commands,
    in_torques,
    placed_unevenly,
    torque_sides,
    TorqueSides,
    TorqueWindows,
    weak_torques,
)
from ctc_chattering.identification.findings import Severity
from ctc_chattering.identification.identify import identify
from ctc_chattering.identification.model_errors import candidates
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import Rows
from ctc_chattering.numerics.linear_algebra import Array
from identified_robots import record, Recorded
import numpy as np
import pytest

EFFORT = np.array([[1.0, 2.0], [3.0, -4.0], [0.0, 5.0]])
MEASURED = Recording('measured', ('a', 'b'), np.arange(3.0), np.zeros((3, 2)), effort=EFFORT)
BARE = Recording('bare', ('a', 'b'), np.arange(3.0), np.zeros((3, 2)), command=EFFORT)


@pytest.mark.parametrize('side, constant, factor, then', [
    ('', None, [1.0, 1.0], ''), ('link', None, [1.0, 1.0], 'link'),
    ('current', None, [1.0, 1.0], 'current'), ('motor', [100.0, 50.0], [100.0, 50.0], 'motor'),
    ('current', [10.0, -5.0], [10.0, -5.0], 'motor')])
def test_the_effort_becomes_the_torque_at_the_joint(
        side: str, constant: list[float] | None, factor: list[float], then: str) -> None:
    (found, bare), now = in_torques([MEASURED, BARE], side, constant)
    assert found.effort == pytest.approx(EFFORT * factor, rel=1e-15)
    assert bare.effort is None and bare.command is BARE.command
    assert now == then


@pytest.mark.parametrize('side', ['', 'link'])
def test_what_contradicts_is_refused(side: str) -> None:
    with pytest.raises(CtcError, match=r'^torque_constant needs an effort that is of the motor'):
        in_torques([MEASURED], side, [0.1, 0.1])
    with pytest.raises(CtcError, match=r'^effort motor: bare has no effort$'):
        in_torques([BARE], 'motor', None)


@pytest.mark.parametrize('wrong', [0, [1.0], [1.0, 0.0], [1.0, np.nan], np.inf, ['a', 'b'], True])
def test_a_factor_that_is_none_is_refused(wrong: object) -> None:
    with pytest.raises(ParameterError, match=r'^torque_constant: '):
        in_torques([MEASURED], 'motor', wrong)  # type: ignore[arg-type]


def test_recordings_of_other_joints_are_named() -> None:
    one = Recording('one', ('a',), np.arange(3.0), np.zeros((3, 1)), effort=np.ones((3, 1)))
    with pytest.raises(CtcError, match=r'^one: 1 joints; measured has 2$'):
        in_torques([MEASURED, one], 'motor', [2.0, 2.0])


@cache
def made() -> Recorded:
    return record('two_link', 1, 12.0)


def friction() -> Array:
    """Return the friction of the plant [N·m], as it slides."""
    plant, dq = made().plant, made().run.dq
    return np.sign(dq) * plant.coulomb_friction + dq * plant.viscous_friction


def weight() -> Array:
    model = made().model
    return np.array([model.gravity_torque(q) for q in made().run.q])


def measured(torque: Array) -> Array:
    """Return what a sensor shows: the torque with noise."""
    found: Array = torque + np.random.default_rng(1).normal(0.0, 0.05, torque.shape)
    return found


@cache
def rows() -> tuple[Rows, TestFunction]:
    phi = TestFunction(1e-3)
    (part,) = stretches(made().recording.checked(), 1e-3)
    return Rows.of(part, made().model, phi), phi


def sides(command: Array | None, effort: Array | None, declared: str = '', source: str = ''
          ) -> TorqueSides:
    recording = dataclasses.replace(made().recording, command=command, effort=effort).checked()
    mine, phi = rows()
    return torque_sides(list(stretches(recording, 1e-3)), [mine], phi, made().recording.joints,
                        declared, source)


def test_an_effort_counts_only_if_its_friction_and_weight_are_those_of_the_commands() -> None:
    tau = made().run.tau
    assert sides(tau, None) == TorqueSides('')
    assert sides(tau, measured(tau)) == TorqueSides('')
    for effort in (tau - friction(), 0.08 * tau, tau - weight()):
        found = sides(tau, measured(effort))
        assert found.source == 'command'
        assert [x.severity for x in found.findings] == [Severity.NOTE]
        assert '--effort says what it is' in found.findings[0].cure


def test_a_part_of_the_friction_in_the_effort_is_not_enough() -> None:
    tau = made().run.tau
    found = sides(tau, measured(tau - 0.3 * friction()))
    assert found.source == 'command'
    assert '0.70 of the friction' in found.findings[0].reason


def test_an_echo_of_the_command_is_no_measurement() -> None:
    tau = made().run.tau
    for delay in (0, 1, 3):
        (found,) = sides(tau, np.roll(tau, delay, axis=0)).findings
        assert f'{delay} samples later: it is not measured' in found.reason


def test_commands_that_the_effort_repeats_at_different_delays_are_in_wrong_places() -> None:
    tau = np.random.default_rng(1).normal(size=(400, 2))
    for share, late in ((0.0, (0.0, 0.0)), (0.05, (0.0, 1.0))):
        effort = np.roll(tau, 2, axis=0)
        some = np.arange(400) < share * 400
        effort[some] = np.roll(tau, 1, axis=0)[some]
        (found,) = placed_unevenly([Stretch(0.0, 1e-3, tau, effort, tau)])
        assert found.late == late


def test_an_effort_alone_is_refused_unless_it_is_that_of_the_motor() -> None:
    tau = made().run.tau
    for declared in ('', 'link', 'current'):
        with pytest.raises(CtcError, match=r'give --effort motor; .*record the commanded'):
            sides(None, measured(tau), declared)
        # Commands that the user does not want do not help.
        with pytest.raises(CtcError, match='--torque-constant'):
            sides(tau, measured(tau), declared, source='effort')
    assert sides(None, measured(tau), 'motor') == TorqueSides('')


def test_what_is_declared_is_held_against_the_data() -> None:
    tau = made().run.tau
    assert sides(tau, measured(tau), 'link').source == 'command'
    with pytest.raises(CtcError, match='behind the gear'):
        sides(None, measured(tau), 'link')
    found = sides(tau, measured(tau - friction()), 'motor')
    assert found.source == 'command'
    assert found.findings[0].severity == Severity.CARE
    assert '0.00 of the friction' in found.findings[0].reason.replace('-0.00', '0.00')


def test_commands_without_weight_or_in_another_unit_are_refused() -> None:
    tau = made().run.tau
    with pytest.raises(CtcError, match='compensates its weight itself; give --gravity 0'):
        sides(tau - weight(), measured(tau - friction()))
    with pytest.raises(CtcError, match=r'0\.08 of the weight.*no torques in N\*m'):
        sides(0.08 * tau, None)
    with pytest.raises(CtcError, match=r'-1\.00 of the weight'):
        sides(-tau, None)


def test_a_torque_behind_the_gear_does_not_make_friction_zero() -> None:
    """Against what would be reported if the effort were taken, since it fits the model better."""
    recording = dataclasses.replace(
        made().recording, effort=measured(made().run.tau - friction())).checked()
    found = identify([recording], made().model, candidates(made().model))
    assert (found.side, found.timing.source) == ('', 'command')
    for joint, coulomb in zip(found.friction, made().plant.coulomb_friction):
        assert joint.coulomb.value == pytest.approx(coulomb, rel=0.02)


def test_a_load_at_the_tip_is_no_other_unit() -> None:
    """It multiplies the small weight of the last joints, and adds little to that of the others."""
    rng = np.random.default_rng(1)
    way = np.sign(rng.normal(size=(400, 4)))
    weight = rng.normal(size=(400, 4)) * (60.0, 30.0, 0.5, 0.5)
    inertia, velocity = rng.normal(size=(2, 400, 4))
    windows = TorqueWindows(way, weight, inertia, way * np.abs(velocity))
    loaded = windows.shape(weight * (1.3, 1.5, 6.0, 8.0) + inertia + 3.0 * way)
    check_commands(loaded)
    with pytest.raises(CtcError, match=r'0\.10 of the weight'):
        check_commands(windows.shape(0.1 * (weight + inertia + 3.0 * way)))


@cache
def panda() -> tuple[TorqueWindows, Array, tuple[str, ...]]:
    """Return windows and weak commands of a Panda."""
    made, phi = record('panda', 1, 6.0, controller={'kp': [400.0] * 7}), TestFunction(1e-3)
    parts = list(stretches(dataclasses.replace(made.recording).checked(), 1e-3))
    rows = [Rows.of(part, made.model, phi) for part in parts]
    torque = weak_torques(parts, rows, phi, COMMAND)
    assert torque is not None
    return TorqueWindows.of(rows), torque, made.recording.joints


@pytest.mark.parametrize('order', [
    (1, 0, 2, 3, 4, 5, 6), (0, 1, 2, 3, 4, 6, 5), (6, 5, 4, 3, 2, 1, 0), (1, 2, 0, 3, 4, 5, 6)])
def test_another_order_is_refused(order: tuple[int, ...]) -> None:
    windows, torque, joints = panda()
    with pytest.raises(CtcError, match=r'give --joints in their order$'):
        windows.check_order(torque[:, order], joints)
    windows.check_order(torque, joints)


def test_a_wrong_model_noise_and_a_joint_without_commands_change_nothing() -> None:
    windows, torque, joints = panda()
    rng = np.random.default_rng(1)
    wrong = dataclasses.replace(
        windows, weight=windows.weight * rng.uniform(0.5, 2.0, 7),
        inertia=windows.inertia * rng.uniform(0.2, 5.0, 7))
    noisy = torque + rng.normal(size=torque.shape) * 0.5 * torque.std(axis=0)
    noisy[:, 2] = 0.0
    wrong.check_order(noisy, joints)
    wrong.check_order(np.full_like(torque, np.nan), joints)
    with pytest.raises(CtcError, match='--joints'):
        wrong.check_order(torque[:, ::-1], joints)


def test_the_parts_of_the_model_in_a_torque() -> None:
    windows, torque, _ = panda()
    shape = windows.shape(torque)
    assert shape.inertia == pytest.approx(np.ones(7), abs=0.01)
    # The first axis is vertical: its torque tells nothing of weight.
    assert np.isinf(shape.weight_error[0])
    assert shape.weight[1:] == pytest.approx(np.ones(6), abs=0.01)
    assert np.isnan(windows.shape(np.random.default_rng(1).normal(size=torque.shape))).all()
