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

"""The paper's arm, against section 4 in numpy and against its URDF."""

from __future__ import annotations

from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
import numpy as np
from oracles import Generic, paper_c, paper_g, paper_m, states
import pytest

ARM = TwoLink()


def test_matrices_are_the_paper_s() -> None:
    """Check M, C and G against section 4 written in numpy."""
    for q, dq in states(100):
        np.testing.assert_allclose(ARM.mass_matrix(q), paper_m(q), rtol=0, atol=1e-14)
        np.testing.assert_allclose(ARM.coriolis_matrix(q, dq), paper_c(q, dq), rtol=0, atol=1e-14)
        np.testing.assert_allclose(ARM.gravity_torque(q), paper_g(q), rtol=0, atol=1e-12)


def test_closed_forms_are_the_generic_products() -> None:
    """Check every override against the base class, which knows only M, C and G."""
    generic = Generic()
    for q, dq in states(100):
        at = np.array(q), np.array(dq)
        for made, expected in zip(ARM.evaluate(*at), generic.evaluate(*at)):
            np.testing.assert_allclose(made, expected, rtol=0, atol=1e-13)
        for made, expected in zip(ARM.mass_and_bias(*at), generic.mass_and_bias(*at)):
            np.testing.assert_allclose(made, expected, rtol=0, atol=1e-12)


def test_gravity_can_be_off() -> None:
    """Check that g scales G and the potential, and is 9.81 by default."""
    off, moon = TwoLink(0.0), TwoLink(1.62)
    for q, dq in states(10):
        assert list(off.gravity_torque(q)) == [0.0, 0.0] == [off.potential_energy(q)] * 2
        np.testing.assert_allclose(moon.gravity_torque(q), paper_g(q, 1.62))
        assert off.inverse_dynamics(q, dq, [0.0, 0.0]) == pytest.approx(paper_c(q, dq) @ dq)


def test_the_urdf_has_the_model_s_dynamics_but_for_a_constant() -> None:
    text = (config_directory() / 'two_link.urdf').read_text(encoding='utf-8')
    theirs = UrdfModel(text, ('joint1', 'joint2'))
    rng = np.random.default_rng(0)
    for q, dq in rng.uniform(-3.0, 3.0, (20, 2, 2)):
        m, c, g = (np.array(x) for x in ARM.evaluate(q, dq))
        mass, coriolis, gravity = theirs.evaluate(q, dq)
        # No rigid body has the paper's M12, whose constant part is larger than M22.
        assert m - mass == pytest.approx(np.array([[0.0, 0.14], [0.14, 0.0]]))
        assert coriolis == pytest.approx(c)
        assert gravity == pytest.approx(g)


def test_the_torque_is_linear_in_the_parameters() -> None:
    """Check regressor times parameters against the inverse dynamics."""
    rng = np.random.default_rng(3)
    for q, dq, ddq in rng.uniform(-3.0, 3.0, (20, 3, 2)):
        regressor = ARM.torque_regressor(q, dq, ddq, np.array([0.0, 0.0, -9.81]))
        torque = paper_m(q) @ ddq + paper_c(q, dq) @ dq + paper_g(q)
        np.testing.assert_allclose(regressor @ ARM.inertial_parameters(), torque, atol=1e-12)
