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

"""`ctc identify`: from a bag to all of its files."""

from __future__ import annotations

import json
from pathlib import Path

from ctc_chattering.cli.ctc import main
from ctc_chattering.configuration import parameter_file
from identified_bags import recorded_bag, short
import numpy as np
import pytest


def test_a_bag_becomes_numbers_gains_figures_and_a_page(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = short()
    bag = recorded_bag(tmp_path / 'run', made, order=(1, 0), extra=('finger',))
    out = tmp_path / 'out'
    command = ['identify', str(bag), '--model', 'two_link',
               '--joints', 'joint1,joint2', '--torque-rate', '5000,1000', '--trials', '0',
               '--out', str(out)]
    assert main(command) == 0
    text = capsys.readouterr().out
    assert max(len(line) for line in text.splitlines() if str(tmp_path) not in line) <= 100
    for words in ('Verdict', 'joint1: usable', 'Friction', 'delay of the torque: 0 samples',
                  'ka = [', 'Next: run with identified.yaml'):
        assert words in text
    found = json.loads((out / 'identify.json').read_text())
    for friction, true in zip(found['friction'], made.plant.coulomb_friction):
        low, high = friction['coulomb']['interval_95']
        assert low < friction['coulomb']['value'] < high
        assert friction['coulomb']['value'] == pytest.approx(true, rel=0.02)
    setup = parameter_file.load(out / 'identified.yaml')
    assert setup.plant.coulomb_friction == pytest.approx(made.plant.coulomb_friction, rel=0.02)
    page = (out / 'index.html').read_text()
    assert 'Friction and gains from run' in page
    assert 'figures/friction.svg' in page
    assert (out / 'figures' / 'friction.svg').is_file()
    assert main(command) == 1
    assert 'exists already' in capsys.readouterr().err


def test_what_the_effort_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Currents behind a gear become torques; a line says how to name them."""
    made = short()
    factor = np.array([100.0 * 0.12, -50.0 * 0.2])
    rng = np.random.default_rng(1)
    bag = str(recorded_bag(tmp_path / 'run', made, command=None,
                           effort=made.run.tau / factor + rng.normal(0.0, 1e-3, (8001, 2))))
    out = tmp_path / 'out'
    command = ['identify', bag, '--model', 'two_link', '--trials', '0', '--out', str(out)]
    assert main(command) == 1
    assert '--effort current --torque-constant' in ''.join(capsys.readouterr())
    assert main([*command, '--effort', 'current', '--torque-constant=12,-10']) == 0
    found = json.loads((out / 'identify.json').read_text())
    for friction, true in zip(found['friction'], made.plant.coulomb_friction):
        assert friction['coulomb']['value'] == pytest.approx(true, rel=0.02)


def test_no_usable_joint_is_status_1_and_one_line_and_everything_is_written(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A torque that depends on the position by more than friction is not that of friction."""
    made = short()
    torque = made.run.tau + 30.0 * np.sin(7.0 * made.run.q)
    bag = recorded_bag(tmp_path / 'odd', made, command=torque)
    out = tmp_path / 'out'
    assert main(['identify', str(bag), '--model', 'two_link', '--out', str(out)]) == 1
    said = capsys.readouterr()
    assert said.err.count('\n') == 1 and 'no joint is usable' in said.err
    assert said.out.startswith('Verdict\n')
    assert 'identified.yaml is not written' in said.out
    found = json.loads((out / 'identify.json').read_text())
    assert [x['verdict'] for x in found['verdicts']] == ['not usable'] * 2
    assert all(x['coulomb']['value'] is None for x in found['friction'])
    assert 'not usable' in (out / 'index.html').read_text()
    assert not (out / 'identified.yaml').exists()
