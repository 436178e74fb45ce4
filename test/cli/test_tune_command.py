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

"""`ctc tune`: from a spec or a parameter file to gains, and one line for what is wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ctc_chattering.cli.ctc import main
from ctc_chattering.runs.tune_page import NAMES
import pytest
from tunings import ROBOT, SPEC


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
    command = ['tune', str(folder / 'spec.yaml'), '--trials', '4', '--jobs', '1']
    assert main(command) == 0
    text = capsys.readouterr().out
    for words in ('chattering implicit_observer', '4 trials × 2 draws', '8 fresh draws',
                  'uncertain friction:', 'uniform: [0.8, 1.2], factor: true', '5000 N·m',
                  'file chattering sign', 'ctc simulate tuned/tuned.yaml'):
        assert words in text
    assert {x.name for x in Path('tuned').iterdir()} == set(NAMES)
    found = numbers(Path('tuned'))
    assert [found[x] for x in ('percentile', 'seed', 'law')] == [95.0, 0, 'chattering']
    assert all(5.0 <= x['numbers']['pole'] <= 50.0 for x in found['trials'])
    assert main(command) == 1
    assert 'exists already' in capsys.readouterr().err


def test_limits_of_the_spec_and_options(folder: Path) -> None:
    spec = folder / 'other.yaml'
    spec.write_text(SPEC.replace('torque_limit: 5000', 'torque_limit: [600, 700]').replace(
        'duration: 0.5', f'duration: 0.4\nseed: {2 ** 40}'))
    assert main(['tune', str(spec), '--trials', '2', '--jobs', '1', '--draws', '3',
                 '--percentile', '50']) == 0
    found = numbers(Path('tuned'))
    assert found['limits']['torque_nm'] == [600.0, 700.0]
    assert (found['percentile'], found['duration_s'], found['seed']) == (50.0, 0.4, 2 ** 40)
    assert len(found['draws']['search']['values']) == 3


def test_a_parameter_file_alone_is_enough(folder: Path) -> None:
    file = folder / 'robot.yaml'
    file.write_text(ROBOT.replace('10.0', '0.5'))
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
