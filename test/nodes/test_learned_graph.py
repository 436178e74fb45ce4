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
"""A file of `ctc learn` in the graph: the run is that of the simulation to the last bit."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.analysis.result import simulate
from ctc_chattering.bags.recorded_passes import learn_from_bag
from ctc_chattering.cli.ctc import main
from ctc_chattering.configuration import parameter_file
import numpy as np
from processes import run_bringup
import pytest
from recorded_runs import assert_equal, record

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def parameters(path: Path, reference: str, kp: float = 400.0) -> Path:
    path.write_text(f"""
/**:
  ros__parameters: {{control_period: 0.002, compiled: false}}
plant:
  ros__parameters: {{pacing: lockstep, duration: 2.5, coulomb_friction: [3.0, 1.0]}}
controller:
  ros__parameters: {{law: pd_gravity, kp: [{kp}, 400.0], kv: [40.0, 40.0]}}
reference:
  ros__parameters: {{frequency: [4.0, 8.0], amplitude: [0.05, 0.02], start_duration: 0.2,
    {reference}}}
""")
    return path


def test_a_graph_begins_with_what_was_learned_from_a_bag(tmp_path: Path) -> None:
    learned = tmp_path / 'learned.npz'
    before = parameters(tmp_path / 'before.yaml', 'learning: false')
    record(tmp_path / 'before', '--params-file', str(before))
    assert main(['learn', str(tmp_path / 'before'), '--out', str(learned)]) == 0

    with_file = f'learning: true, learning_file: {learned}'
    after = parameters(tmp_path / 'after.yaml', with_file)
    result = record(tmp_path / 'after', '--params-file', str(after))
    expected = simulate(parameter_file.load(after))
    assert_equal(result.run, expected.run)
    np.testing.assert_array_equal(result.e, expected.e)
    assert expected.learner is not None
    again = learn_from_bag(tmp_path / 'after', {}).learner
    for of_bag, of_run in zip(again.passes, expected.learner.passes, strict=True):
        assert of_bag.rms == pytest.approx(of_run.rms, rel=1e-9)
    assert expected.learner.rows is not None
    assert again.rows == pytest.approx(expected.learner.rows, abs=1e-12)

    other = parameters(tmp_path / 'other.yaml', with_file, kp=300.0)
    status, output = run_bringup('--params-file', str(other))
    assert status == 1 and 'learned.npz: was learned for kp [400.0, 400.0], and' in output
    learned.unlink()
    status, output = run_bringup('--params-file', str(after))
    assert status == 1 and 'there is no such file; make it with: ctc learn BAG' in output
