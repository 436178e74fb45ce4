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

"""Unseen torque of real arms is predicted as well as by a plain regression of bodies."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from real_recordings import Case, CASES, FOLDER, Row, rows

pytestmark = [pytest.mark.slow, pytest.mark.skipif(
    FOLDER not in os.environ, reason=f'{FOLDER} is not set: the folder of the recordings')]
#: What is left of unseen torque over what the reference fit leaves.
MOST = 1.1
#: Part of the recorded torque that a reference leaves which explains nothing.
EXPLAINS_NOTHING = 0.8
#: Published Coulomb friction of the axes of a TX40 [N·m].
PUBLISHED = {'joint_1': 7.1, 'joint_2': 8.3, 'joint_3': 6.3, 'joint_4': 2.5}


def explained(case: Case) -> list[Row]:
    """Return the rows of joints whose torque the reference explains."""
    found = list(rows(case, Path(os.environ[FOLDER])))
    return [row for row in found if row.reference < EXPLAINS_NOTHING * row.recording]


@pytest.mark.parametrize('case', CASES, ids=lambda case: case.bag)
def test_a_joint_that_the_reference_explains_is_predicted_as_well(case: Case) -> None:
    joints = explained(case)
    assert len(joints) >= 4
    for row in joints:
        assert row.verdict != 'not usable', row
        assert row.ratio <= MOST, row
    assert sum(row.ratio < 1.0 for row in joints) >= 0.5 * len(joints)


def test_published_friction_is_within_the_intervals() -> None:
    (case,) = [case for case in CASES if case.bag.startswith('tx40')]
    friction = {row.joint: row.coulomb for row in explained(case)}
    for joint, published in PUBLISHED.items():
        assert friction[joint].value == pytest.approx(published, abs=friction[joint].half)
