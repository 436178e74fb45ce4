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

"""The URDF of the paper's arm: its dynamics by Pinocchio against the model."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.two_link_urdf import two_link_urdf
from ctc_chattering.dynamics.urdf_model import UrdfModel
import numpy as np
import pytest

CONFIG = Path(__file__).resolve().parents[2] / 'config'


def test_has_the_model_s_dynamics_but_for_a_constant() -> None:
    ours, theirs = TwoLink(), UrdfModel(two_link_urdf(), ('joint1', 'joint2'))
    rng = np.random.default_rng(0)
    for q, dq in rng.uniform(-3.0, 3.0, (20, 2, 2)):
        m, c, g = (np.array(x) for x in ours.evaluate(q, dq))
        mass, coriolis, gravity = theirs.evaluate(q, dq)
        # No rigid body has the paper's M12, whose constant part is larger than M22.
        assert m - mass == pytest.approx(np.array([[0.0, 0.14], [0.14, 0.0]]))
        assert coriolis == pytest.approx(c)
        assert gravity == pytest.approx(g)


def test_the_file_of_the_package_is_the_generated_one() -> None:
    assert (CONFIG / 'two_link.urdf').read_text(encoding='utf-8') == two_link_urdf()


def test_joints_may_have_any_name() -> None:
    names = ('"><x>', 'a & b\'\n"')
    robot = ElementTree.fromstring(two_link_urdf(names))
    assert [x.get('name') for x in robot if x.tag == 'joint'] == [*names]
    assert {x.tag for x in robot} == {'link', 'joint'}
