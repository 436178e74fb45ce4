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

"""Exit statuses, and one line for whatever goes wrong."""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys

from ctc_chattering.cli import options
from ctc_chattering.cli.command_line import guarded
from ctc_chattering.cli.ctc import make_parser
from ctc_commands import ctc, refused
import pytest

#: Command lines that mean nothing, and words of the answer.
WRONG = {
    '': ['see ctc --help'], 'dance': ['see ctc --help'],
    'simulate --control-period x': ['see ctc simulate --help'],
    'simulate --unknown': ['--unknown', 'see ctc --help'], 'plot': ['see ctc plot --help'],
    'replay': ['see ctc replay --help'], 'repair bag another': ['another', 'see ctc --help'],
    **{f'simulate --control-period={x}': ['control_period', 'allowed']
       for x in ('0', '-1', 'nan', 'inf', '1e-10', '1e300')},
    **{f'simulate --duration={x}': ['duration', 'allowed'] for x in ('nan', 'inf', '1e300')},
    'simulate --law=pid': ['law', 'pid', 'compensation | chattering'],
    'simulate --switching=smooth': ['switching', 'smooth', 'sign'],
    'simulat': ['did you mean simulate?'],
    'simulate --params-file fricton': ['panda', 'did you mean friction?'],
    'simulate --params-file friction.yaml': ['did you mean friction?'],
    'simulate --law chatering': ['law', 'did you mean chattering?'],
    'simulate --switching implict': ['did you mean implicit?'],
    'simulate --duration -1': ['duration', '-1.0', '>= 0'],
    'compare fricton': ['did you mean friction?'],
    'compare friction --laws chatering': ['did you mean chattering?'],
    'compare friction --condition real_amr': ['did you mean real_arm?'],
    'compare friction --jobs 0': ['--jobs', '>= 1'],
    'compare friction --jobs -1': ['--jobs', '>= 1'],
    'excite --evaluations 0': ['--evaluations', '>= 1'],
    'excite --poses 0': ['poses', '>= 1'],
    'excite --center a': ['center', "'a'", 'numbers'],
    'excite --friction -1': ['friction', '>= 0'],
    'check-model --model two_lnk': ['did you mean two_link?'],
    'check-model --model urdf': ['--urdf'],
    'check-model --model puma': ['model', 'puma', 'two_link | urdf | package.module:Name'],
    'check-model --model two_link --urdf README.md': ['--urdf', 'two_link'],
    'check-model --joints a,a': ['joint_names'],
    'check-model --samples 0': ['--samples', '>= 1'],
    'check-model --seed -1': ['--seed', '>= 0'],
    'check-model --gravity nan': ['--gravity', '>= 0'],
    'check-model --joints a,b,c': ['joint_names', '2 names'],
    'replay bag --rate 0': ['--rate', 'allowed'], 'replay bag --rate nan': ['--rate', 'allowed'],
    'replay bag --delay=-1': ['--delay', 'allowed'],
    'live --port 99999': ['--port', '65535'],
    'plot bag --format jpg': ['svg']}


@pytest.mark.skipif(sys.version_info < (3, 11), reason='PYTHONSAFEPATH is newer')
def test_processes_of_a_command_import_nothing_from_here(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pools start their processes by ``python -c``, which looks in the current directory first."""
    (tmp_path / 'trap.py').touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv('PYTHONSAFEPATH', raising=False)
    trapped = [sys.executable, '-c', 'import trap']
    assert subprocess.run(trapped, check=False).returncode == 0
    assert guarded('ctc', lambda: subprocess.run(
        trapped, check=False, stderr=subprocess.DEVNULL).returncode) == 1
    monkeypatch.delenv('PYTHONSAFEPATH')


@pytest.mark.parametrize('line', WRONG)
def test_a_wrong_command_line_has_status_2_and_one_line(line: str, tmp_path: Path) -> None:
    result = ctc(*line.split(), cwd=tmp_path)
    refused(result, *WRONG[line])
    assert result.returncode == 2
    assert not list(tmp_path.iterdir())


def test_the_joints_of_a_description_are_listed(tmp_path: Path) -> None:
    robot = tmp_path / 'robot.urdf'
    robot.write_text('<robot name="r"><link name="a"/><link name="b"/><joint name="elbow" '
                     'type="continuous"><parent link="a"/><child link="b"/></joint></robot>')
    result = ctc('check-model', '--urdf', robot, '--joints', 'elbo')
    refused(result, "['elbo']", 'movable joints of the URDF: elbow', 'did you mean elbow?')
    assert result.returncode == 2


def test_what_a_file_has_wrong_has_status_1(tmp_path: Path) -> None:
    """The same value as an option has status 2; an option replaces the file's value."""
    file = tmp_path / 'run.yaml'
    file.write_text('controller: {ros__parameters: {law: chatering}}\n'
                    'plant: {ros__parameters: {duration: 0.01}}')
    result = ctc('simulate', '--params-file', file)
    refused(result, 'did you mean chattering?')
    assert result.returncode == 1
    assert ctc('simulate', '--params-file', file, '--law', 'chattering').returncode == 0


def test_a_defect_is_shown_with_its_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    def broken() -> int:
        raise TypeError('no such\nthing')
    assert guarded('ctc broken', broken) == 1
    text = capsys.readouterr().err
    assert text.startswith('Traceback') and 'in broken' in text
    assert text.endswith('ctc broken: a defect of ctc_chattering; please report the lines above\n')


def test_without_dask_one_process_is_taken_unless_more_are_asked_for(
        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('os.cpu_count', lambda: 8)
    for default in (8, 1):
        parser = make_parser(['compare'])
        assert parser.parse_args(['compare', 'friction']).jobs == default
        assert parser.parse_args(['compare', 'friction', '--jobs', '3']).jobs == 3
        monkeypatch.setattr(options, 'find_spec', lambda _: None)
