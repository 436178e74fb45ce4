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
"""Regressors of the torque, against Pinocchio's own and differences of models."""

from __future__ import annotations

from ctc_chattering.dynamics.payload import with_payload
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.identification.regressor import BodyRegressor
from ctc_chattering.identification.weak_form import Dynamics, TestFunction
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pinocchio as pin
import pytest
import urdfs

H = 1e-3
T = H * np.arange(600)[:, None]
PHI = TestFunction(H)
CENTRES = PHI.centres(len(T), 10)
ARMS = pytest.mark.parametrize(('joints', 'text'), [
    (urdfs.TWO_LINKS[::-1], urdfs.two_links()), (urdfs.TWO_LINKS, urdfs.two_links('prismatic')),
    (urdfs.PANDA, urdfs.panda())], ids=['turned', 'prismatic', 'Panda'])


def motion(n: int) -> tuple[Array, Array]:
    """Return positions and velocities of a smooth motion."""
    k = np.arange(float(n))
    pace, angle = 1.0 + 0.3 * k, (1.0 + 0.3 * k) * T + k ** 2
    return np.sin(angle), np.asarray(pace * np.cos(angle), float)


def weak(regressor: BodyRegressor) -> Array:
    q, dq = motion(regressor.model.n)
    return regressor.weak(q, dq, dq, PHI, CENTRES)


@ARMS
def test_columns_of_bodies_are_those_of_pinocchio(joints: tuple[str, ...], text: str) -> None:
    """In Pinocchio's order of joints, which is that from the root outwards."""
    whole = pin.buildModelFromXML(text)
    others = [k for k in range(1, whole.njoints) if whole.names[k] not in joints]
    model = pin.buildReducedModel(whole, others, pin.neutral(whole))
    order = [joints.index(name) for name in model.names[1:]]
    regressor = BodyRegressor.of(UrdfModel(text, joints))
    assert regressor is not None
    n = len(joints)
    q, dq, ddq = np.random.default_rng(1).normal(size=(3, n))
    expected = pin.computeJointTorqueRegressor(
        model, model.createData(), q[order], dq[order], ddq[order])
    found = regressor.torque(q, dq, ddq)[:, :10 * n].reshape(n, n, 10)
    assert found[order][:, order].reshape(n, -1) == pytest.approx(expected, abs=1e-9)


@ARMS
def test_weak_columns_are_differences_of_models(joints: tuple[str, ...], text: str) -> None:
    """Of the model, and one with a payload."""
    model = UrdfModel(text, joints)
    regressor = BodyRegressor.of(model)
    assert regressor is not None
    outwards = [name for name in Tree(text).ends if name in joints]
    loaded = UrdfModel(with_payload(text, outwards, 1.0), joints)
    q, dq = motion(model.n)
    without, with_load = (
        Dynamics.along(q, dq, H, x).weak(dq, PHI, CENTRES) for x in (model, loaded))
    change = loaded.inertial_parameters() - model.inertial_parameters()
    found = weak(regressor)[:, :, :len(change)] @ change
    assert found == pytest.approx(with_load - without,
                                  abs=5e-4 * np.abs(with_load - without).max())


def test_a_rotor_and_a_tilt_have_their_torques() -> None:
    """A rotor has Ia ddq; under gravity along x the arm has the moments of its masses."""
    regressor = BodyRegressor.of(TwoLink())
    assert regressor is not None
    columns, first = weak(regressor), regressor.inertial_count
    q, dq = motion(2)
    ddq = np.gradient(dq, H, axis=0)
    assert columns[:, 1, first + 1] == pytest.approx(
        PHI.sums(ddq, PHI.values, CENTRES)[:, 1], abs=1e-3)
    assert not columns[:, 0, first + 1].any()
    second = 0.63 * np.cos(q.sum(axis=1))
    torque = -np.stack((7.6 * np.cos(q[:, 0]) + second, second), axis=1)
    assert columns[:, :, -3] == pytest.approx(PHI.sums(torque, PHI.values, CENTRES), abs=1e-4)


class Springy(TwoLink):
    """An arm with a spring, which no inertial parameter is."""

    def inverse_dynamics(self, q, dq, a):  # type: ignore[no-untyped-def]
        return [x + 2.0 * y for x, y in zip(super().inverse_dynamics(q, dq, a), q)]


def test_a_regressor_that_does_not_hold_is_not_used() -> None:
    assert BodyRegressor.of(Springy()) is None
