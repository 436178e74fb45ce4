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

"""The study of arms in MuJoCo: its plant against formulas, and its promises on one draw."""

from __future__ import annotations

from arms_study import Arm, Case, mass_matrix, rows, springs
from ctc_chattering.configuration.arm_knowledge import ArmFacts
import numpy as np
from oracles import random_spd
import pytest
from robots import DESCRIBED
import urdfs

NAME = 'xarm7'
JOINTS = DESCRIBED[NAME][1]
#: A seed that the page does not have.
SEED = 907


def arm(case: Case) -> Arm:
    ones = np.ones(len(JOINTS))
    return Arm(urdfs.robot(DESCRIBED[NAME][0]), JOINTS, 40.0 * ones, 3.0 * ones, 0.3 * ones, case,
               SEED)


def test_the_lowest_resonance_with_motors_held_is_as_asked_for() -> None:
    mass = random_spd(np.random.default_rng(2), 4)
    stiffness, damping = springs(mass, np.array([4.0, 3.0, 2.0, 1.0]), 20.0)
    squares = np.linalg.eigvals(np.linalg.inv(mass) @ np.diag(stiffness)).real
    assert np.sqrt(squares.min()) / (2.0 * np.pi) == pytest.approx(20.0)
    assert (damping > 0.0).all()


def test_rotors_are_on_the_diagonal_of_the_mass_matrix() -> None:
    """Rigid: with the armature, the same bodies are heavier by just that; drawn in the range."""
    heavy, light = arm(Case()), arm(Case((1e-9, 1.0000001e-9)))
    assert (heavy.rotor >= 0.001 * 40.0).all()
    assert (heavy.rotor <= 0.006 * 40.0).all()
    for each in (heavy, light):
        each.start(0.3 * np.ones(len(JOINTS)), np.zeros(len(JOINTS)))
    more = mass_matrix(heavy.model, heavy.data) - mass_matrix(light.model, light.data)
    assert more == pytest.approx(np.diag(heavy.rotor), abs=1e-6)


@pytest.mark.slow
def test_a_drawn_arm_is_followed_if_rigid_and_stopped_if_it_oscillates() -> None:
    """From the URDF alone: the errors and times that docs promise."""
    cases = ['rigid', 'elastic 20 Hz, encoder at the motor']
    rigid, elastic = rows(NAME, cases, ['observer_feedback'], [SEED], ArmFacts(), False)
    assert rigid['trip'] == ''
    assert rigid['rms'] < 3e-4
    assert 'oscillates at' in elastic['trip']
    assert elastic['trip_time'] < 2.3
