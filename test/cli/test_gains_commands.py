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

"""`ctc identify` and `ctc tune`: from a bag, or a spec, to gains and all files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ctc_chattering.cli.ctc import main
from ctc_chattering.configuration import parameter_file
from ctc_chattering.output_folder import LIST
from identified_bags import recorded_bag, short
import numpy as np
import pytest
from tunings import ROBOT, SPEC


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
    for words in ('Verdict', 'joint1: usable', 'Friction', 'delay of the torque is 0 samples',
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


def test_no_usable_joint_is_status_1_and_one_line_and_everything_is_written(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A torque that is mostly one over the position is not that of the model and friction."""
    made = short()
    torque = made.run.tau + 300.0 * np.sin(7.0 * made.run.q)
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


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a directory with a spec and a robot, from another one."""
    (tmp_path / 'elsewhere').mkdir()
    monkeypatch.chdir(tmp_path / 'elsewhere')
    (tmp_path / 'spec.yaml').write_text(SPEC)
    (tmp_path / 'robot.yaml').write_text(ROBOT)
    return tmp_path


def numbers(out: Path) -> Any:
    return json.loads((out / 'tune.json').read_text())


def test_a_spec_becomes_gains(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec = folder / 'spec.yaml'
    spec.write_text(SPEC.replace('5000', '[5000, 700]').replace(
        'duration: 0.5', f'duration: 0.2\nseed: {2 ** 40}'))
    command = ['tune', str(spec), '--trials', '3', '--jobs', '1', '--draws', '3',
               '--percentile', '50']
    assert main(command) == 0
    text = capsys.readouterr().out
    for words in ('chattering implicit_observer', '3 trials × 3 draws', '12 fresh draws',
                  'uncertain friction:', 'uniform: [0.8, 1.2], factor: true', '5000',
                  'file chattering sign', 'ctc simulate tuned/tuned.yaml'):
        assert words in text
    assert {x.name for x in Path('tuned').iterdir()} == {
        LIST, 'figures', 'front', 'index.html', 'tune.json', 'tune.parquet', 'tuned.yaml'}
    found = numbers(Path('tuned'))
    assert [found[x] for x in ('percentile', 'seed', 'law', 'duration_s')] == [
        50.0, 2 ** 40, 'chattering', 0.2]
    assert found['limits']['torque_nm'] == [5000.0, 700.0]
    assert len(found['draws']['search']['values']) == 3
    assert all(5.0 <= x['numbers']['pole'] <= 50.0 for x in found['trials'])
    assert main(command) == 1
    assert 'exists already' in capsys.readouterr().err


def test_a_parameter_file_alone_is_enough(folder: Path) -> None:
    file = folder / 'robot.yaml'
    file.write_text(ROBOT.replace('10.0', '0.2'))
    assert main(['tune', str(file), '--trials', '2', '--jobs', '1', '--draws', '2']) == 0
    assert list(numbers(Path('tuned'))['uncertain']) == ['model', 'friction', 'lag', 'noise']


def test_limits_that_nothing_keeps_are_a_failure_with_all_files(
        folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / 'spec.yaml').write_text(SPEC.replace('5000', '1'))
    assert main(['tune', str(folder / 'spec.yaml'), '--trials', '2', '--jobs', '1']) == 1
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith('ctc tune: no trial keeps the limits; trial ')
    assert error.endswith('see tuned/index.html')
    assert not Path('tuned/tuned.yaml').exists()
    assert len(numbers(Path('tuned'))['trials']) == 2
