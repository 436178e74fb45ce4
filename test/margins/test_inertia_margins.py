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

"""Rotors and masses within given ratios, where they have a closed form."""

from __future__ import annotations

from ctc_chattering.margins.inertia_margins import ArmInertia, ArmMargins
from ctc_chattering.margins.loop_margins import StableRange
import numpy as np
import pytest

#: Range of the eigenvalues of M̂ M⁻¹.
RATIOS = StableRange(0.5, 4.0)
#: Inertia of the bodies of one joint at two positions [kg·m²].
BODIES = [np.array([[2.0]]), np.array([[3.0]])]


def inertia(rotor: float, effort: float = np.inf) -> ArmInertia:
    return ArmInertia(BODIES, np.array([[rotor]]), np.array([[effort]]))


def test_one_joint_has_the_ranges_of_its_ratios() -> None:
    margins = inertia(4.0).margins(RATIOS)
    assert margins.lacking is None
    assert margins.rotors is not None
    # (2 + 4) / (2 + 4 x) >= 1/2, and (2 + 4) / (2 + 4 x) <= 4 but for rotors of 0.
    assert margins.rotors.high == pytest.approx(2.5)
    assert margins.masses is not None
    # (3 + 4) / (3 x + 4) >= 1/2.
    assert margins.masses.high == pytest.approx(10.0 / 3.0)


def test_a_model_without_rotors_may_lack_some_by_its_effort() -> None:
    margins = inertia(0.0, 50.0).margins(RATIOS)
    assert margins.rotors is None
    # 2 / (2 + 50 x) >= 1/2.
    assert margins.lacking == pytest.approx(0.04)


def test_without_a_stable_ratio_there_is_no_margin() -> None:
    assert inertia(4.0).margins(None) == ArmMargins(None, None, None)
    assert inertia(0.0).margins(RATIOS).lacking is None
