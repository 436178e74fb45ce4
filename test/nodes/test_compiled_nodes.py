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

"""Nodes compute by machine code where there is some, and say whether they do."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.analysis.result import simulate
from ctc_chattering.compiled.machine_code import HOW_TO_COMPILE
from ctc_chattering.configuration import parameter_file
from ctc_chattering.launch.child_process import Child
from faults import Diagnostics, Report
import numpy as np
from processes import interrupt, probe
import pytest
from recorded_runs import assert_equal, record

pytestmark = pytest.mark.ros


def test_a_recorded_run_is_that_of_the_simulation(tmp_path: Path) -> None:
    """To the last bit, computed by machine code; with noise and loss, and a change on the way."""
    file = tmp_path / 'params.yaml'
    file.write_text("""
plant:
  ros__parameters: {pacing: lockstep, duration: 0.5, velocity_noise: [0.001, 0.002],
                    encoder_resolution: [1.0e-4, 1.0e-4], sample_loss: 0.05, input_delay: 1}
reference:
  ros__parameters: {start_duration: 0.2}
bringup:
  ros__parameters:
    events: ['0.3 plant coulomb_friction [3.0, 1.0]']
""")
    setup = parameter_file.load(file)
    compile_setups([setup], print)
    expected = simulate(setup)
    assert_equal(record(tmp_path / 'bag', '--params-file', str(file)), expected)
    rounding = simulate(parameter_file.load(file, {'/**': {'compiled': False}})).run
    assert (rounding.tau != expected.run.tau).any()
    np.testing.assert_allclose(rounding.tau, expected.run.tau, rtol=1e-9, atol=1e-9)


def test_nodes_say_what_computes_them(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The controller says how its law is compiled, and goes on plain."""
    compile_setups([parameter_file.load(None)], print)
    with probe() as it:
        reports = Diagnostics(it)

        def said() -> int:
            return len([x for x in it.lines if HOW_TO_COMPILE in x and '[INFO]' in x])

        def says(computed_by: str, report: Report) -> bool:
            return report.values['computed by'] == computed_by

        def check(computed_by: str, *ros_args: str) -> list[Child]:
            children = [it.start(name, *ros_args) for name in ('plant', 'controller')]
            for child in children:  # The first report may be of the node before.
                reports.until(child.name, partial(says, computed_by), computed_by)
            return children

        for how, *ros_args in (('machine code',), ('plain Python', '-p', 'compiled:=false')):
            for child in check(how, *ros_args):
                interrupt(child)
            assert said() == 0
        monkeypatch.setenv('HOME', str(tmp_path))
        check('plain Python')
        it.until(lambda: said() == 1, 'the line')
        for name, value in (('ka', [3.0, 3.0]), ('law', 'compensation'), ('ka', [4.0, 4.0])):
            assert it.set('controller', name, value).successful
        assert reports.next('controller').values['computed by'] == 'plain Python'
        assert said() == 1
