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

"""What holds of every law with its defaults."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.laws.registry import LAWS
from laws import check_delay, variation
from oracles import Array
import pytest

PANDA = Path(__file__).resolve().parents[3] / 'config' / 'panda.yaml'


@cache
def on_the_panda(law: str) -> Array:
    """Return the torque variation of each joint over the second second [N·m/s]."""
    return variation(simulate(parameter_file.load(PANDA, {
        'controller': {'law': law}, 'plant': {'duration': 2.0}})).run)


def some(*sampled: str, of: Iterable[str] = LAWS) -> list[Any]:
    """Return laws; `.ci/run` runs those that are not sampled."""
    return [law if law in sampled else pytest.param(law, marks=pytest.mark.slow) for law in of]


@pytest.mark.parametrize('law', some(
    'observer_feedback', of=(x for x in LAWS if x != 'chattering')))
def test_none_rattles_on_an_arm_with_strongly_coupled_joints(law: str) -> None:
    """Check the Panda, where diag(M)⁻¹ M has an eigenvalue of 0.017, against law (2)."""
    assert (on_the_panda(law) < 3.0 * on_the_panda('compensation')).all()


@pytest.mark.parametrize('law', some(
    'chattering', 'slotine_li', of=(x for x in LAWS if x != 'extended_state_observer')))
def test_a_known_delay_of_two_samples_costs_little(law: str) -> None:
    check_delay(law)
