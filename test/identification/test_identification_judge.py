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

"""The judge of identifications: right ones pass, and a wrong number is counted."""

from __future__ import annotations

import dataclasses
from functools import cache

from ctc_chattering.bags.recording import Recording
from ctc_chattering.identification.findings import Estimate, Severity
from faults_of_arms import case, recorded
from faulty_case import Case
from faulty_robots import Played
from identification_judge import judged, Number, Outcome, outcome
import numpy as np
import pytest

_SECONDS = 10.0


@cache
def made() -> tuple[Case, Played, Recording, Outcome]:
    one = case('two_link_urdf', 'plain', 2, _SECONDS)
    seen, recording = recorded(one, 2, _SECONDS)
    return one, seen, recording, outcome(one, recording, 2)


def with_coulomb(made: Outcome, value: float, half: float) -> Outcome:
    assert made.results is not None
    found = made.results.found
    friction = [dataclasses.replace(x, coulomb=Estimate(value, half, 'N*m'))
                for x in found.friction]
    return made._replace(results=dataclasses.replace(
        made.results, found=dataclasses.replace(found, friction=friction)))


def test_a_plain_robot_is_identified_without_a_wrong_number() -> None:
    one, seen, _, right = made()
    row = judged(one, 'plain', seen, right, _SECONDS)
    assert row['wrong'] == []
    assert row['refused'] == 0
    assert all(x == Severity.NOTE for x in right.severity)
    assert np.mean(row['held']) > 0.7


def test_a_wrong_number_is_counted_unless_something_warns_of_its_joint() -> None:
    one, seen, _, right = made()
    true = one.robot.physics.coulomb
    bad = with_coulomb(right, 1.05 * true[0], 0.001)
    row = judged(one, 'plain', seen, bad, _SECONDS)
    assert any(x.startswith('coulomb[0]') for x in row['wrong'])
    wide = with_coulomb(right, 1.05 * true[0], 0.1 * true[0])
    assert not any(x.startswith('coulomb[0]') for x in judged(
        one, 'plain', seen, wide, _SECONDS)['wrong'])
    warned = bad._replace(severity=(Severity.CARE, Severity.CARE))
    row = judged(one, 'plain', seen, warned, _SECONDS)
    assert row['wrong'] == []
    assert any(x.startswith('coulomb[0]') for x in row['warned'])


@pytest.mark.parametrize(('low', 'high', 'holds', 'wrong'), [
    (0.99, 1.02, True, False), (1.005, 1.01, False, False), (1.04, 1.06, False, True),
    (1.04, 1.30, False, False), (0.90, 0.94, False, True)])
def test_wrong_is_beyond_two_halves_and_two_per_cent(
        low: float, high: float, holds: bool, wrong: bool) -> None:
    number = Number('coulomb', 0, low, high, (1.0, 1.0), 1.0)
    assert (number.holds, number.wrong) == (holds, wrong)


def test_a_drift_is_right_anywhere_on_its_way() -> None:
    number = Number('coulomb', 0, 1.09, 1.11, (1.0, 1.2), 1.2)
    assert number.holds
    assert not number.wrong
    assert number._replace(low=1.29, high=1.31).wrong
