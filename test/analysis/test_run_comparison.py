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

"""Two runs of one arm beside each other."""

from __future__ import annotations

import dataclasses

from ctc_chattering.analysis.result import Result, simulate
from ctc_chattering.analysis.run_comparison import (
    comparison_rows,
    compensated_friction,
    motion_lags,
)
from ctc_chattering.configuration.parameter_file import load_parameters
import numpy as np
import pytest


def run(**controller: object) -> Result:
    """Return a run of 3 s with friction of 9.9 N·m, evaluated in its second half."""
    return simulate(load_parameters('friction', {
        'plant': {'duration': 3.0}, 'controller': controller}))


@pytest.fixture(scope='module')
def runs() -> list[Result]:
    return [run(law='chattering', switching='implicit_observer'), run(law='compensation', kp=90.0)]


def test_the_lag_is_that_of_a_motion_that_was_shifted(runs: list[Result]) -> None:
    shifted = runs[0].run.q_d.copy()
    shifted[7:] = runs[0].run.q_d[:-7]
    late = dataclasses.replace(runs[0], run=dataclasses.replace(runs[0].run, q=shifted))
    assert motion_lags(late) == pytest.approx([7e-3, 7e-3], rel=2e-3)
    still = dataclasses.replace(runs[0].run, dq_d=np.zeros_like(runs[0].run.dq_d))
    assert np.isnan(motion_lags(dataclasses.replace(runs[0], run=still))).all()


def test_the_friction_is_what_the_law_compensated(runs: list[Result]) -> None:
    assert compensated_friction(runs[0]) == pytest.approx([9.9, 9.9], rel=0.1)
    assert np.isnan(compensated_friction(runs[1])).all()


def test_runs_are_compared_by_joint_with_the_parameters_that_differ(runs: list[Result]) -> None:
    rows = comparison_rows(runs)
    quantities = [row[1] for row in rows if row[0] == 'joint1']
    assert quantities == ['RMS error [rad]', 'torque variation [N·m/s]',
                          'friction compensated [N·m]', 'lag [ms]']
    parameters = {row[1]: row[2:] for row in rows if row[0] == 'parameter'}
    assert parameters == {
        'law': ['chattering', 'compensation'], 'switching': ['implicit_observer', 'sign'],
        'kp': ['100, 100', '90, 90']}
    assert comparison_rows(runs[:1]) == []
