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

"""A payload enters the model of a running controller smoothly, plain and compiled."""

from __future__ import annotations

from ctc_chattering.control.controller import Controller
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.payload_ramp import PayloadRamp
from ctc_chattering.controller.trips import check_change
from ctc_chattering.dynamics.model import Model, PointMass
from ctc_chattering.dynamics.payload import with_payload
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.errors import CtcError, ParameterError
import numpy as np
import pytest
from urdfs import PANDA, panda

MS = 1_000_000
REST = (0.0,) * 7
POSTURE = (0.1, -0.4, 0.2, -1.8, 0.3, 1.8, 0.5)
CENTER = (0.02, -0.01, 0.1)


def config(**values: object) -> ControllerConfig:
    """Return a configuration of a Panda under `pd_gravity`."""
    return ControllerConfig.from_mapping({
        'joint_names': list(PANDA), 'model': 'urdf', 'law': 'pd_gravity', 'kp': 100.0,
        'kv': 20.0, 'compiled': False, **values})


class TwoLinkOfSeven(TwoLink):
    """A model of its own in the place of that of a description."""

    n = 7


def gravity(model: Model) -> np.ndarray:
    return np.array(model.gravity_torque(POSTURE))


def test_a_payload_is_a_point_mass_at_its_centre() -> None:
    """As the body that a URDF has there, but for the moments of its sphere."""
    arm = UrdfModel(panda(), PANDA)
    mass = 2.0
    loaded = arm.with_payload([PointMass(mass, (0.0, 0.0, 0.0))])
    described = UrdfModel(with_payload(panda(), PANDA, mass), PANDA)
    assert gravity(loaded) == pytest.approx(gravity(described), abs=1e-12)
    sphere = 0.4 * mass * 0.05 ** 2
    difference = np.array(described.mass_matrix(POSTURE)) - loaded.mass_matrix(POSTURE)
    assert np.linalg.eigvalsh(difference).min() > -1e-12
    assert difference[-1, -1] == pytest.approx(sphere)
    assert np.abs(gravity(arm) - gravity(loaded)).max() > 5.0
    assert gravity(UrdfModel(panda(), PANDA)) == pytest.approx(gravity(arm), abs=0.0)


def test_a_payload_enters_within_a_second_by_steps_of_a_hundredth() -> None:
    arm = UrdfModel(panda(), PANDA)
    ramp = PayloadRamp(arm, config(), MS)
    ramp.request(config(payload_mass=3.0, payload_center=CENTER))
    torques = []
    while ramp.changing:
        ramp.advance()
        torques.append(gravity(ramp.model))
    assert len(torques) == 1000
    full = gravity(arm.with_payload([PointMass(3.0, CENTER)])) - gravity(arm)
    assert torques[-1] == pytest.approx(gravity(arm) + full, abs=1e-12)
    steps = np.diff([gravity(arm), *torques], axis=0)
    assert np.abs(steps).max() == pytest.approx(0.01 * np.abs(full).max(), rel=1e-6)


def test_a_payload_that_is_replaced_on_its_way_goes_on_without_a_step() -> None:
    arm = UrdfModel(panda(), PANDA)
    ramp = PayloadRamp(arm, config(payload_mass=1.0), MS)
    ramp.request(config(payload_mass=3.0, payload_center=CENTER))
    for _ in range(400):
        ramp.advance()
    before = gravity(ramp.model)
    ramp.request(config())
    ramp.advance()
    assert gravity(ramp.model) == pytest.approx(before, abs=1e-12)
    while ramp.changing:
        ramp.advance()
    assert ramp.model is arm


@pytest.mark.parametrize('scale', [1.0, 0.9])
def test_a_running_controller_carries_a_payload_that_was_set(scale: float) -> None:
    """Also with scaled models. Gains set meanwhile keep it."""
    arm = UrdfModel(panda(), PANDA)
    running = config(gravity_scale=scale)
    law = Controller(running, arm)
    point = POSTURE, REST, REST
    law.step(POSTURE, REST, *point)
    law.configure(running.changed({'payload_mass': 3.0, 'payload_center': CENTER}))
    torques = [law.step(POSTURE, REST, *point).tau for _ in range(1100)]
    loaded = arm.with_payload([PointMass(3.0, CENTER)])
    assert torques[0] == pytest.approx(scale * gravity(arm), rel=1e-9, abs=1e-9)
    assert torques[-1] == pytest.approx(scale * gravity(loaded), rel=1e-9, abs=1e-9)
    first = Controller(running.changed({'payload_mass': 3.0, 'payload_center': CENTER}), arm)
    assert first.step(POSTURE, REST, *point).tau == pytest.approx(torques[-1], abs=1e-9)
    law.configure(law.config.changed({'kp': 50.0}))
    assert law.step(POSTURE, REST, *point).tau == pytest.approx(torques[-1], abs=1e-9)


def test_only_an_arm_of_a_description_carries_a_payload() -> None:
    with pytest.raises(ParameterError, match='payload_mass: 1'):
        ControllerConfig().changed({'payload_mass': 1.0})
    with pytest.raises(ParameterError, match='payload_center'):
        config(payload_center=[0.1, 0.2])
    law = Controller(config(), TwoLinkOfSeven())
    with pytest.raises(CtcError, match='only the model of a description'):
        law.check(config(payload_mass=1.0))
    model = Controller(ControllerConfig()).model
    with pytest.raises(CtcError, match='only the model of a description'):
        model.with_payload([PointMass(1.0, CENTER)])


def test_a_payload_that_is_set_without_a_torque_is_there_with_the_first_one() -> None:
    """A tool is changed while the brakes hold the arm."""
    arm = UrdfModel(panda(), PANDA)
    law = Controller(config(), arm)
    law.configure(config(payload_mass=3.0, payload_center=CENTER))
    held = tuple(gravity(arm))
    law.reset(True, held)
    assert gravity(law.model) == pytest.approx(gravity(arm), abs=1e-12)
    law.reset(True)
    loaded = gravity(arm.with_payload([PointMass(3.0, CENTER)]))
    assert law.step(POSTURE, REST, POSTURE, REST, REST).tau == pytest.approx(loaded)


def test_any_payload_may_be_set_at_once() -> None:
    """It enters smoothly, and other parameters may still be set beside it."""
    running = config(payload_mass=5.0, payload_center=CENTER)
    check_change(running, running.changed({
        'payload_mass': 0.01, 'payload_center': [9.0, 0.0, 0.0]}))
    with pytest.raises(ParameterError, match='kp'):
        check_change(running, running.changed({'kp': 1e6}))
