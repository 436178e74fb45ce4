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

"""Commands that belong to other joints are noticed, and the order that fits is named."""

from __future__ import annotations

import dataclasses
from functools import cache

from ctc_chattering.bags.recording import stretches
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.drives import COMMAND
from ctc_chattering.identification.effort import TorqueWindows, weak_torques
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import Rows
from ctc_chattering.numerics.linear_algebra import Array
from identified_robots import record
import numpy as np
import pytest


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
def test_the_order_that_fits_is_named(order: tuple[int, ...]) -> None:
    windows, torque, joints = panda()
    named = ','.join(joints[i] for i in order)
    with pytest.raises(CtcError, match=f'--joints {named}$'):
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
