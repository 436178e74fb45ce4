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

"""The whole graph in lockstep, as real processes: nothing lost, nothing changed."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
import numpy as np
from processes import CONFIG
import pytest
from recorded_runs import assert_equal, counts, record

pytestmark = pytest.mark.ros


def test_the_law_is_switched_at_its_time_as_in_the_simulation(tmp_path: Path) -> None:
    """
    Of the torque only the chattering term comes; v and the other terms go on without a bump.

    As in config/switch.yaml, but earlier.
    """
    file = tmp_path / 'switch.yaml'
    file.write_text((CONFIG / 'switch.yaml').read_text().replace("['5.0 ", "['0.7 "))
    arguments = ('--params-file', str(file), '--duration', '0.9')
    first = record(tmp_path / 'first', *arguments)
    assert first.changes == [(0.7, 'chattering')]
    assert_equal(first, simulate(parameter_file.load(file, {'plant': {'duration': 0.9}})))
    at = int(np.flatnonzero(first.run.t == 0.7)[0])
    assert not first.terms.robust[:at].any()
    assert np.abs(first.terms.robust[at]).tolist() == [10.0, 10.0]
    for values in (first.run.v, first.run.tau + first.terms.robust):
        steps = np.abs(np.diff(values, axis=0))
        assert (steps[at - 1] <= 2.0 * steps[at - 50:at - 1].max(axis=0)).all()


def test_other_period_joint_names_and_namespace(tmp_path: Path) -> None:
    file = tmp_path / 'params.yaml'
    file.write_text("""
/**:
  ros__parameters: {joint_names: [shoulder, elbow], control_period: 0.002}
plant:
  ros__parameters: {pacing: lockstep, duration: 0.5, initial_position: [0.3, -0.2],
                    coulomb_friction: [3.0, 1.0]}
controller:
  ros__parameters: {kp: [120.0, 5.0, 5.0, 90.0], ka: [4.0, 2.0], lambda: 5.0, b: 0.8,
                    effort_limit: [300.0, .inf]}
reference:
  ros__parameters: {joint_names: [elbow, shoulder], center: [1.0, 0.5], phase: [0.1, 0.2],
                    frequency: [2.0, 0.5], amplitude: [0.1, 0.2]}
""")
    result = record(tmp_path / 'bag', '--params-file', str(file), '--ros-args', '-r',
                    '__ns:=/robot1')
    assert_equal(result, simulate(parameter_file.load(file)))
    assert result.joint_names == ('shoulder', 'elbow')
    assert np.abs(result.run.tau[:, 0]).max() == 300.0
    assert len(result.run.t) == 251
    assert counts(tmp_path / 'bag')['/robot1/joint_states'] >= 251  # Again if unanswered.
