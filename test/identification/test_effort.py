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

from ctc_chattering.bags.recording import Recording, stretches
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.identification.drives import COMMAND, EFFORT, weak_torque
from ctc_chattering.identification.effort import (
    check_commands,
    check_order,
    in_torques,
    torque_shape,
    torque_source,
)
from ctc_chattering.identification.findings import Finding, Severity
from ctc_chattering.identification.least_squares import Data
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import joined, Rows
from ctc_chattering.numerics.linear_algebra import Array
from identified_robots import record, Recorded
import numpy as np
import pytest

VALUES = np.array([[1.0, 2.0], [3.0, -4.0], [0.0, 5.0]])
MEASURED = Recording('measured', ('a', 'b'), np.arange(3.0), np.zeros((3, 2)), effort=VALUES)
BARE = Recording('bare', ('a', 'b'), np.arange(3.0), np.zeros((3, 2)), command=VALUES)


@pytest.mark.parametrize('side, constant, factor, then', [
    ('', None, [1.0, 1.0], ''), ('link', None, [1.0, 1.0], 'link'),
    ('current', None, [1.0, 1.0], 'current'), ('motor', [100.0, 50.0], [100.0, 50.0], 'motor'),
    ('current', [10.0, -5.0], [10.0, -5.0], 'motor')])
def test_the_effort_becomes_the_torque_at_the_joint(
        side: str, constant: list[float] | None, factor: list[float], then: str) -> None:
    (found, bare), now = in_torques([MEASURED, BARE], side, constant)
    assert found.effort == pytest.approx(VALUES * factor, rel=1e-15)
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


def source(command: Array | None, effort: Array | None, declared: str = ''
           ) -> tuple[str, tuple[Finding, ...]]:
    recording = dataclasses.replace(made().recording, command=command, effort=effort).checked()
    mine, phi = rows()
    return torque_source(list(stretches(recording, 1e-3)), [mine], phi, made().recording.joints,
                         declared)


def test_an_effort_counts_only_if_the_user_says_that_it_is_of_the_motor() -> None:
    tau = made().run.tau
    assert source(tau, None) == (COMMAND, ())
    for declared in ('', 'link', 'current'):
        assert source(tau, measured(tau), declared) == (COMMAND, ())
    assert source(tau, measured(tau), 'motor') == (EFFORT, ())


def test_an_effort_alone_is_refused_unless_it_is_that_of_the_motor() -> None:
    tau = made().run.tau
    for declared in ('', 'link', 'current'):
        with pytest.raises(CtcError, match=r'give --effort motor; .*record the commanded'):
            source(None, measured(tau), declared)
    assert source(None, measured(tau), 'motor') == (EFFORT, ())


def test_what_is_declared_is_held_against_the_data() -> None:
    tau = made().run.tau
    signal, (found,) = source(tau, measured(tau - friction()), 'motor')
    assert (signal, found.severity) == (COMMAND, Severity.CARE)
    assert '0.00 of the friction' in found.reason.replace('-0.00', '0.00')


def test_commands_without_weight_or_in_another_unit_are_refused() -> None:
    tau = made().run.tau
    with pytest.raises(CtcError, match='compensates its weight itself, give --gravity 0'):
        source(tau - weight(), measured(tau - friction()))
    with pytest.raises(CtcError, match=r'0\.08 of the weight.*no torques in N\*m'):
        source(0.08 * tau, None)
    with pytest.raises(CtcError, match=r'-1\.00 of the weight'):
        source(-tau, None)


def windows(way: Array, weight: Array, inertia: Array, velocity: Array) -> Data:
    return dataclasses.replace(
        Data.at(way, velocity, 0.0 * way, np.empty((*way.shape, 0))), gravity=weight,
        base=weight + inertia)


def test_a_load_at_the_tip_is_no_other_unit() -> None:
    """It multiplies the small weight of the last joints, and adds little to that of the others."""
    rng = np.random.default_rng(1)
    way = np.sign(rng.normal(size=(400, 4)))
    weight = rng.normal(size=(400, 4)) * (60.0, 30.0, 0.5, 0.5)
    inertia, velocity = rng.normal(size=(2, 400, 4))
    mine = windows(way, weight, inertia, way * np.abs(velocity))
    check_commands(torque_shape(mine, weight * (1.3, 1.5, 6.0, 8.0) + inertia + 3.0 * way))
    with pytest.raises(CtcError, match=r'0\.10 of the weight'):
        check_commands(torque_shape(mine, 0.1 * (weight + inertia + 3.0 * way)))


@cache
def panda() -> tuple[Rows, Array, tuple[str, ...]]:
    """Return windows and weak commands of a Panda."""
    made, phi = record('panda', 1, 6.0, controller={'kp': [400.0] * 7}), TestFunction(1e-3)
    parts = list(stretches(dataclasses.replace(made.recording).checked(), 1e-3))
    rows = [Rows.of(part, made.model, phi) for part in parts]
    torque = [weak_torque(np.asarray(part.command), 0.0, np.zeros(7), 1e-3, phi, mine.centres)
              for part, mine in zip(parts, rows)]
    return joined(rows), np.concatenate(torque), made.recording.joints


@pytest.mark.parametrize('order', [
    (1, 0, 2, 3, 4, 5, 6), (0, 1, 2, 3, 4, 6, 5), (6, 5, 4, 3, 2, 1, 0), (1, 2, 0, 3, 4, 5, 6)])
def test_another_order_is_refused(order: tuple[int, ...]) -> None:
    rows, torque, joints = panda()
    with pytest.raises(CtcError, match=r'give --joints in their order$'):
        check_order(rows, torque[:, order], joints)
    check_order(rows, torque, joints)


def test_a_wrong_model_noise_and_a_joint_without_commands_change_nothing() -> None:
    rows, torque, joints = panda()
    rng = np.random.default_rng(1)
    weight = rows.gravity * rng.uniform(0.5, 2.0, 7)
    wrong = dataclasses.replace(
        rows, gravity=weight,
        base=weight + (rows.base - rows.gravity) * rng.uniform(0.2, 5.0, 7))
    noisy = torque + rng.normal(size=torque.shape) * 0.5 * torque.std(axis=0)
    noisy[:, 2] = 0.0
    check_order(wrong, noisy, joints)
    check_order(wrong, np.full_like(torque, np.nan), joints)
    with pytest.raises(CtcError, match='--joints'):
        check_order(wrong, torque[:, ::-1], joints)


def test_the_part_of_the_weight_in_a_torque() -> None:
    rows, torque, _ = panda()
    shape = torque_shape(rows, torque)
    # The first axis is vertical: its torque tells nothing of weight.
    assert np.isinf(shape.error[0])
    assert shape.weight[1:] == pytest.approx(np.ones(6), abs=0.01)
    assert np.isnan(torque_shape(rows, np.random.default_rng(1).normal(size=torque.shape))).all()
