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

"""The columns of a model's errors, against differences of models and of the inverse dynamics."""

from __future__ import annotations

from ctc_chattering.dynamics.corrected_urdf import with_payload
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.identification.model_errors import candidates, ErrorColumns, ModelError
from ctc_chattering.identification.weak_form import Dynamics, TestFunction
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest
import urdfs

H = 1e-3
T = H * np.arange(600)[:, None]
PHI = TestFunction(H)
CENTRES = PHI.centres(len(T), 10)


def motion(n: int) -> tuple[Array, Array]:
    """Return positions and velocities of a smooth motion."""
    k = np.arange(float(n))
    pace, angle = 1.0 + 0.3 * k, (1.0 + 0.3 * k) * T + k ** 2
    return np.sin(angle), np.asarray(pace * np.cos(angle), float)


def columns(errors: ErrorColumns) -> Array:
    q, dq = motion(errors.model.n)
    return errors.weak(q, dq, dq, PHI, CENTRES)


@pytest.mark.parametrize(('joints', 'text'), [
    (urdfs.TWO_LINKS[::-1], urdfs.two_links()), (urdfs.PANDA, urdfs.panda())],
    ids=['turned', 'Panda'])
def test_columns_are_differences_of_models(joints: tuple[str, ...], text: str) -> None:
    """Of the model, and others with a heavier link, or a payload."""
    model = UrdfModel(text, joints)
    errors = ErrorColumns.of(model)
    assert errors is not None
    found, (q, dq) = columns(errors), motion(model.n)
    base = Dynamics.along(q, dq, H, model).weak(dq, PHI, CENTRES)
    outwards = [name for name in Tree(text).ends if name in joints]
    others = [*urdfs.heavier_links(text, joints),
              ('payload', with_payload(text, outwards, 1.0))]
    known = candidates(model, text)
    assert [x.name for x in known] == [name for name, _ in others]
    for (_, other), error in zip(others, known):
        wanted = Dynamics.along(q, dq, H, UrdfModel(other, joints)).weak(dq, PHI, CENTRES) - base
        assert found @ errors.coordinates(direction(errors, error)) == pytest.approx(
            wanted, abs=5e-4 * np.abs(wanted).max())


def direction(errors: ErrorColumns, error: ModelError) -> Array:
    return np.append(error.change, np.zeros(len(errors.sizes) - errors.count))


def test_a_rotor_and_a_tilt_have_their_torques() -> None:
    """A rotor has Ia ddq; under gravity along x the arm has the moments of its masses."""
    errors = ErrorColumns.of(TwoLink())
    assert errors is not None
    q, dq = motion(2)
    more = columns(errors)
    rotor = np.zeros(11)
    rotor[7] = 0.3
    ddq = np.gradient(dq, H, axis=0)
    wanted = PHI.sums(0.3 * ddq * (0.0, 1.0), PHI.at, CENTRES)
    assert more @ errors.coordinates(rotor) == pytest.approx(wanted, abs=1e-4)
    tilt = np.zeros(11)
    tilt[8] = 2.0
    second = 0.63 * np.cos(q.sum(axis=1))
    torque = -2.0 * np.stack((7.6 * np.cos(q[:, 0]) + second, second), axis=1)
    assert more @ errors.coordinates(tilt) == pytest.approx(
        PHI.sums(torque, PHI.at, CENTRES), abs=1e-4)


class Springy(TwoLink):
    """An arm with a spring, which no inertial parameter is."""

    def inverse_dynamics(self, q, dq, a):  # type: ignore[no-untyped-def]
        return [x + 2.0 * y for x, y in zip(super().inverse_dynamics(q, dq, a), q)]


def test_a_regressor_that_does_not_hold_is_not_used() -> None:
    assert ErrorColumns.of(Springy()) is None


def test_a_long_recording_has_no_more_windows() -> None:
    long = TestFunction(H, 600.0)
    assert len(long.centres(600_000, 10)) <= 6100
    assert TestFunction(H, 60.0).step == PHI.step
