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

"""Joints that stick, and gains that help."""

from __future__ import annotations

from itertools import product
from pathlib import Path

from ctc_chattering.configuration import parameter_file
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.identification.excitation.plan import AssumedFriction, gains, sticking
import numpy as np
import pytest

ROOT = Path(__file__).parents[3]


def test_what_friction_holds_is_found_at_a_corner_of_its_box() -> None:
    setup = parameter_file.load(ROOT / 'config' / 'ur5.yaml')
    robot = model_of(setup.controller, setup.descriptions['controller'])
    kp = np.linspace(50.0, 100.0, 6)
    friction = AssumedFriction(np.array([8.0, 8.0, 6.0, 1.5, 1.5, 1.0]), np.zeros(6))
    q = np.array(setup.reference.center)
    mass = np.array(robot.mass_matrix(q.tolist()))
    corners = [np.abs(np.linalg.solve(mass, friction.coulomb * signs)) / kp
               for signs in product((-1.0, 1.0), repeat=6)]
    hold = sticking(robot, q[np.newaxis], kp, friction)
    assert hold == pytest.approx(np.max(corners, axis=0), rel=1e-9)


def test_gains_rise_only_where_friction_holds_too_much_and_with_the_delay() -> None:
    kp, kv, slow = np.array([100.0, 100.0, 100.0]), np.array([50.0, 50.0, 50.0]), np.full(3, 0.3)
    higher, damping = gains(kp, kv, np.array([0.01, 0.6, 60.0]), slow, 0.001)
    assert higher == pytest.approx([100.0, 1000.0, 2500.0])
    assert damping == pytest.approx([50.0, 64.0, 100.0])
    higher, damping = gains(kp, kv, np.array([0.01, 0.6, 60.0]), slow, 0.01)
    assert higher == pytest.approx([100.0, 100.0, 100.0])
    assert damping == pytest.approx(kv)
