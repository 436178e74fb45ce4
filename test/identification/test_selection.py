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

"""Intervals of friction that contain what the data do not tell."""

from __future__ import annotations

import dataclasses

from ctc_chattering.identification import friction
from ctc_chattering.identification.friction import joint_friction, select
from ctc_chattering.identification.model_errors import causes
import numpy as np
import pytest
from random_windows import COULOMB, random_windows


def held(blur: float = 0.0, **faults: float) -> list[bool]:
    """Return whether the intervals of Coulomb friction contain the truth; load is blurred."""
    data, columns = random_windows(np.zeros(2), **faults)
    data = dataclasses.replace(data, load=np.hypot(data.load, blur))
    found = select(data, ('a', 'b'), columns, causes(columns, 2, [], np.ones(2)))
    numbers = [joint_friction(found, i).coulomb for i in range(2)]
    assert all(x.value is not None for x in numbers)
    return [abs((x.value or 0.0) - COULOMB) <= x.half for x in numbers]


@pytest.mark.parametrize('most', [3, 0])
def test_a_scale_of_all_torques_is_in_the_intervals(
        most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Named, or beside all errors of the model; without the doubt it is missed."""
    monkeypatch.setattr(friction, '_CAUSES', most)
    assert all(held(scale=0.95))
    if not most:
        monkeypatch.setattr(friction, '_COMMON', 0.0)
        assert not any(held(scale=0.95))


def test_a_load_that_is_not_known_at_its_change_of_sign_is_in_the_intervals(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """Blurred by 0.1 N·m, as by the average over a window; without the doubt it is missed."""
    assert all(held(0.1, gear=0.1))
    monkeypatch.setattr(friction, '_FORM', 0.0)
    monkeypatch.setattr(friction, '_TRUSTED', 0.0)
    assert not any(held(0.1, gear=0.1))
