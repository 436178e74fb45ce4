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

"""Errors of the model: their columns, causes and words, against differences of models."""

from __future__ import annotations

from ctc_chattering.dynamics.corrected_urdf import with_payload
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.identification.attribution import absurd, CauseKind, causes
from ctc_chattering.identification.findings import Severity
from ctc_chattering.identification.gains import inertia_findings
from ctc_chattering.identification.identify import identify
from ctc_chattering.identification.model_errors import candidates, ErrorColumns, ModelError
from ctc_chattering.identification.weak_form import Dynamics, TestFunction
from ctc_chattering.numerics.linear_algebra import Array
from faults_of_arms import case, recorded
import numpy as np
import pytest
from robots import arm
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]
import urdfs

Q, DQ, DDQ = np.array(((0.3, -0.8), (1.1, 0.4), (-0.5, 2.0)))


@pytest.mark.parametrize(('joints', 'text'), [
    (urdfs.TWO_LINKS, urdfs.two_links()), (urdfs.UR5, urdfs.ur5()),
    (urdfs.PANDA, urdfs.panda())], ids=['two links', 'UR5', 'Panda'])
def test_heavier_links_of_a_urdf_add_up(joints: tuple[str, ...], text: str) -> None:
    model = UrdfModel(text, joints)
    *links, payload = candidates(model, text)
    assert sum(x.change for x in links) == pytest.approx(model.inertial_parameters())
    assert (payload.name, payload.unit, payload.change[::10].sum()) == (
        'payload', 'kg', pytest.approx(1.0))


def test_bodies_are_named_after_their_heaviest_link() -> None:
    names = [x.name for x in candidates(UrdfModel(urdfs.panda(), urdfs.PANDA), urdfs.panda())]
    assert names[0] == 'panda_link1'
    assert len(names) == 8


@pytest.mark.parametrize('lean', [0.0, 0.08])
def test_a_planar_arm_shows_gravity_in_its_plane(lean: float) -> None:
    """A turn in the plane, and what a lean across it takes away; never an angle across it."""
    columns = ErrorColumns.of(UrdfModel(urdfs.two_links(), urdfs.TWO_LINKS))
    assert columns is not None
    shown = columns.directions
    assert np.abs(shown.T @ [0.0, 1.0, 0.0]) == pytest.approx(np.zeros(2), abs=1e-9)
    cause = next(x for x in causes(columns, urdfs.TWO_LINKS, [], np.ones(2))
                 if x.kind == CauseKind.GRAVITY)
    down = Rotation.from_rotvec([lean, 0.06, 0.0]).apply([0.0, 0.0, -9.81])
    change = down - columns.prior[-3:]
    poses = np.random.default_rng(1).normal(size=(20, 2))
    rest = np.zeros(2)
    wanted = np.array([columns.model.gravity_map(q) @ change for q in poses])
    found = np.array([columns.at(q, rest, rest) for q in poses]) @ (
        cause.design[0, :-3] @ (shown.T @ change))
    assert found == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize('joints, text', [
    (urdfs.TWO_LINKS, urdfs.two_links()), (urdfs.PANDA, urdfs.panda())])
def test_a_base_that_is_not_level_is_not_turned_by_much(joints: tuple[str, ...], text: str
                                                        ) -> None:
    columns = ErrorColumns.of(UrdfModel(text, joints))
    assert columns is not None
    cause = next(x for x in causes(columns, joints, [], np.ones(len(joints)))
                 if x.kind == CauseKind.GRAVITY)
    for turn, size, wanted in ((0.2, 1.0, False), (0.3, 1.0, True), (0.1, 0.95, True)):
        down = size * Rotation.from_rotvec([0.0, turn, 0.0]).apply(columns.prior[-3:])
        value = columns.directions.T @ (down - columns.prior[-3:])
        assert absurd(cause, value, columns) == wanted


@pytest.mark.parametrize('name, value, wanted', [
    ('torque scale of a', 0.5, False), ('torque scale of a', -0.7, True),
    ('dead band of a', 0.1, False), ('dead band of a', -0.1, True),
    ('all masses', -0.5, False), ('all masses', -0.95, True)])
def test_a_model_does_not_vanish_and_a_dead_band_gives_no_torque(
        name: str, value: float, wanted: bool) -> None:
    """No torque, no masses and no friction explain every motion."""
    columns = ErrorColumns.of(UrdfModel(urdfs.two_links(), urdfs.TWO_LINKS))
    assert columns is not None
    cause = next(x for x in causes(columns, ('a', 'b'), [], np.ones(2)) if x.name == name)
    assert absurd(cause, np.array([value]), columns) == wanted


def test_a_cause_that_has_all_columns_of_another_contains_it() -> None:
    columns = ErrorColumns.of(UrdfModel(urdfs.two_links(), urdfs.TWO_LINKS))
    named = {x.name: x for x in causes(columns, ('a', 'b'), [], np.ones(2))}
    one, whole = named['rotor inertia of a'], named['rotor inertia of all joints']
    body = named['mass, centre and inertia of body of b']
    assert whole.contains(one) and not one.contains(whole) and not whole.contains(body)
    assert body.contains(named['centre of mass of body of b'])
    assert named['dead band of all joints'].contains(named['dead band of b'])
    assert not named['torque scale of all joints'].contains(named['torque scale of b'])


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


def test_a_rotor_that_the_model_lacks_is_compared_with_its_inertia() -> None:
    one = case('two_link_urdf', 'rotor', 1100, 8.0)
    recording = recorded(one, 1100, 8.0)[1].checked()
    urdf = arm('two_link_urdf').urdf
    model = UrdfModel(urdf, one.robot.joints)
    found = identify([recording], model, candidates(model, urdf, {}))
    every = np.median([np.diagonal(model.mass_matrix(q.tolist()))
                       for q in recording.q[::200]], axis=0)
    true = 1.0 + one.robot.physics.rotor / every
    assert true[0] < 1.9 and true[1] > 2.1
    (finding,) = inertia_findings(found, model)
    assert (finding.severity, finding.joint) == (Severity.REFUSED, 1)
    assert float(finding.reason.split()[5]) == pytest.approx(true[1], rel=0.02)
