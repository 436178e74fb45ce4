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

from argparse import _SubParsersAction, ArgumentParser, SUPPRESS
from collections.abc import Iterator
import os
from pathlib import Path
import re
import subprocess
import sys

from ctc_chattering.cli import options
from ctc_chattering.cli.bringup import make_parser as bringup_parser
from ctc_chattering.cli.command_line import guarded
from ctc_chattering.cli.ctc import COMMANDS, make_parser
from ctc_chattering.cli.node import _make_parser as node_parser
from ctc_chattering.configuration.node_parameters import NODE_DESCRIPTIONS
from ctc_commands import ctc, refused
from identified_bags import recorded_bag, short
from map_specs import written
import numpy as np
import pytest
from tunings import ROBOT, SPEC

TURNS = '<parent link="a"/><child link="b"/></joint></robot>'
#: Files that the command lines name.
FILES = {
    'robot.urdf': f'<robot name="r"><link name="a"/><link name="b"/><joint name="elbow" '
                  f'type="continuous">{TURNS}',
    'law.yaml': 'controller: {ros__parameters: {law: chatering}}',
    'mass.yaml': 'controller: {ros__parameters: {mass: 1}}',
    'lambda.yaml': 'controller: {ros__parameters: {lambda: 0}}',
    'time.yaml': 'plant: {ros__parameters: {duration: -1.0}}',
    'lost.yaml': 'plant: {ros__parameters: {duration: 1.0, initial_velocity: [1e300, 1e300]}}',
    'list.yaml': 'a: [', 'nothing.yaml': '',
    'plain.yaml': '/**: {ros__parameters: {compiled: false}}',
    'other.yaml': '/**: {ros__parameters: {model: "nowhere:Arm"}}',
    'robot.yaml': ROBOT, 'tune.yaml': SPEC, 'axes.yaml': f'{SPEC}axes: {{}}\n',
    'endless.yaml': 'plant: {ros__parameters: {duration: 0.0}}',
    'broken/metadata.yaml': '\ufffe\0'}
#: Longer than a file's name may be.
LONG = 'x' * 300
BAG = 'identify bag --model two_link'
DRIVEN = 'identify driven --model two_link --effort current'
#: What is wrong in a file, or not there: status 1, and words of the line.
FAILS = {
    'simulate --params-file law.yaml': ['did you mean chattering?'],
    'simulate --params-file mass.yaml': ['mass', 'controller'],
    'simulate --params-file lambda.yaml': ['lambda', '>= 1e-09'],
    'simulate --params-file time.yaml': ['duration', '>= 0'],
    'simulate --params-file lost.yaml': [], 'simulate --params-file list.yaml': ['a YAML file'],
    'simulate --params-file nothing.yaml': ['node names'],
    'simulate --params-file bag': ['bag'],
    'simulate --duration 0.01 --out law.yaml': ['law.yaml'],
    'simulate --duration 0.01 --out /proc/self/x': ['/proc/self/x'],
    'compile --params-file plain.yaml': ['nothing can be compiled'],
    'stability --law chattering': ['chattering sign is not linear'],
    'check-model --urdf nowhere.urdf': ['ctc check-model', 'nowhere.urdf'],
    'check-model --urdf law.yaml': ['description', 'not XML'],
    **{f'{command} {bag}': [bag] for bag in ('none', 'law.yaml', 'empty', 'broken')
       for command in ('plot', 'replay', 'live')},
    'identify none': ['no such bag'],
    'compare endless.yaml --laws integral': ['duration: 0.0 is not allowed', 'must end'],
    **{f'{command}{LONG}': [LONG[:9], reason] for command, reason in (
        ('simulate --params-file empty/', 'too long'), ('check-model --urdf ', 'too long'),
        ('check-model --urdf package://a/', 'no installed file'), ('repair ', 'too long'),
        ('live ', 'too long'), ('plot ', 'too long'),
        ('simulate --duration 0.01 --out ', 'too long'))},
    **{f'{command} {file}': [f'{file}: is {kind}; a regular file is needed']
       for file, kind in (('pipe', 'a pipe'), ('/dev/zero', 'a device'))
       for command in ('simulate', 'map', 'tune', 'compare', 'excite', 'check-model --urdf',
                       'new-robot --out new.yaml --urdf', 'compare friction --cases')},
    'tune --identified piped': ['identified.yaml: is a pipe'],
    BAG: ['without a gap; at least 2 s'], BAG.replace('bag', 'still'): ['at least 2 s'],
    'map map.yaml --scheduler nowhere': ['--scheduler nowhere', 'no scheduler answers'],
    'map nowhere.yaml': ['the model nowhere:Arm cannot be imported'],
    'tune axes.yaml': ["ctc tune: axes.yaml: spec: 'axes' is not allowed; allowed: a mapping "]}
#: Command lines that mean nothing: status 2.
WRONG = {
    '': ['see ctc --help'], 'dance': ['see ctc --help'],
    'simulate --control-period x': ['see ctc simulate --help'],
    'simulate --unknown': ['--unknown', 'see ctc --help'], 'plot': ['see ctc plot --help'],
    'replay': ['see ctc replay --help'], 'repair bag another': ['another', 'see ctc --help'],
    **{f'simulate --control-period={x}': ['control_period', 'allowed']
       for x in ('0', 'nan', 'inf', '1e-10', '1e300')},
    'simulate --duration=nan': ['duration', 'allowed'],
    'simulate --duration -1': ['duration', '-1.0', '>= 0'],
    'simulate --law=pid': ['law', 'pid', 'compensation | chattering'],
    f'simulate {LONG}': ['no such file'], f'map {LONG}': ['no such file'],
    'compare friction --jobs 1001': ['--jobs: 1001 is not allowed', '<= 1000'],
    f'{BAG} --gravity nan': ['gravity: nan is not allowed; allowed: a finite number >= 0'],
    f'{BAG} --gravity -1': ['gravity: -1.0 is not allowed'],
    'export-c friction --out out --processor nonsense': [
        '--processor nonsense: not allowed', 'x86-64-v3'],
    'export-c friction --out out --processor help': ['--processor help: not allowed'],
    'export-c friction --out out --ros2-control sensor_msgs': ['the controller needs'],
    'simulat': ['did you mean simulate?'],
    'simulate --params-file none.yaml': ['none.yaml'], 'map none.yaml': ['none.yaml'],
    'simulate --params-file fricton': ['panda', 'did you mean friction?'],
    'simulate --switching implict': ['did you mean implicit?'],
    'compare fricton': ['did you mean friction?'],
    'compare friction --laws chatering': ['did you mean chattering?'],
    'compare friction --condition real_amr': ['did you mean real_arm?'],
    **{f'{command} --jobs 0': ['--jobs: 0 is not allowed', '>= 1']
       for command in ('compare friction', 'map map.yaml', 'tune tune.yaml')},
    'excite --evaluations 0': ['evaluations', '>= 1'],
    'excite --center a': ['center', "'a'", 'numbers'],
    'excite --friction -1': ['friction', '>= 0'],
    'check-model --model two_lnk': ['did you mean two_link?'],
    'check-model --model urdf': ['--urdf'],
    'check-model --model puma': ['model', 'puma', 'two_link | urdf | package.module:Name'],
    'check-model --model two_link --urdf robot.urdf': ['--urdf', 'two_link'],
    'check-model --joints a,a': ['joint_names'],
    'check-model --joints a,b,c': ['joint_names', '2 names'],
    'check-model --urdf robot.urdf --joints elbo': [
        "['elbo']", 'movable joints of the URDF: elbow', 'did you mean elbow?'],
    'check-model --samples 0': ['--samples', '>= 1'],
    'check-model --gravity nan': ['--gravity', '>= 0'],
    'replay bag --rate 0': ['--rate', 'allowed'], 'replay bag --delay=-1': ['--delay', 'allowed'],
    'live --port 99999': ['99999', '65535'], 'live bag bag bag': ['3 bags'],
    'live --export x.html': ['needs a bag'], 'live bag --read-only': ['graph'],
    **{f'plot bag --window {x}': ['--window', 'BEGIN < END'] for x in ('3 2', '1 1', 'nan 3')},
    'plot bag --window 3': ['--window'], 'plot bag --format jpg': ['svg'],
    'identify bag': ['no robot description: give --urdf FILE, or --model'],
    f'{BAG} --trials -1': ['--trials: -1 is not allowed; allowed: an integer >= 0'],
    f'{BAG} --torque-rate -1': ['torque_rate: [-1.0] is not allowed'],
    f'{BAG} --effort currents': ['did you mean current?'],
    f'{BAG} --torque-constant 1': ['torque_constant needs --effort'],
    f'{DRIVEN} --torque-constant 1,2,3': ['torque_constant: [1.0, 2.0, 3.0] is not allowed'],
    f'{DRIVEN} --torque-constant 0': ['allowed: finite numbers that are not 0'],
    f'{BAG} --effort motor': ['effort motor: bag has no effort'],
    'map map.yaml --jobs 2 --scheduler tcp://a:1': ['--scheduler: not allowed with argument'],
    'map map.yaml --explain law=soft': ['--explain', "invalid int value: 'law=soft'"],
    'map map.yaml --explain 24': ['--explain: 24 is not allowed', '0 to 23'],
    'tune': ['ctc tune: '], 'tune tune.yaml --identified b': ['ctc tune: '],
    'tune tune.yaml --trials 0': ['--trials: 0 is not allowed'],
    'tune tune.yaml --percentile 0': ['--percentile: 0.0', 'a finite number >= 1e-09 and <= 100'],
    'tune tune.yaml --draws 0': ['repeats: 0 is not allowed']}


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a directory of files, bags and specs, most of them wrong."""
    path = tmp_path_factory.mktemp('wrong')
    for name in ('empty', 'broken', 'piped'):
        (path / name).mkdir()
    os.mkfifo(path / 'pipe')
    os.mkfifo(path / 'piped' / 'identified.yaml')
    for name, text in FILES.items():
        (path / name).write_text(text, encoding='utf-16' if 'broken' in name else 'utf-8')
    written(path / 'map.yaml')
    written(path / 'nowhere.yaml', params_file='other.yaml')
    made = short(duration=1.0)
    recorded_bag(path / 'bag', made)
    recorded_bag(path / 'driven', made, command=None, effort=made.run.tau)
    recorded_bag(path / 'still', made, q=np.zeros_like(made.run.q))
    return path


def files(folder: Path) -> set[Path]:
    """Return all files, but those of a map that waits for a scheduler."""
    return {x for x in folder.rglob('*') if x.is_file() and x.parent.name != 'map'}


@pytest.mark.parametrize(('line', 'status', 'words'), [
    *((line, 1, words) for line, words in FAILS.items()),
    *((line, 2, words) for line, words in WRONG.items())])
def test_a_wrong_command_line_or_file_gives_one_line_and_a_status(
        line: str, status: int, words: list[str], folder: Path) -> None:
    before = files(folder)
    result = ctc(*line.split(), cwd=folder)
    refused(result, *words)
    assert result.returncode == status
    assert files(folder) == before, 'nothing is written'


@pytest.mark.skipif(sys.version_info < (3, 11), reason='PYTHONSAFEPATH is newer')
def test_processes_of_a_command_import_nothing_from_the_current_directory(
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


def test_a_defect_has_a_traceback_and_a_lack_of_memory_one_line(
        capsys: pytest.CaptureFixture[str]) -> None:
    def broken() -> int:
        raise TypeError('no such\nthing')
    assert guarded('ctc broken', broken) == 1
    text = capsys.readouterr().err
    assert text.startswith('Traceback') and 'in broken' in text
    assert text.endswith(
        'ctc broken: this is a defect of ctc_chattering; please report the lines above\n')
    assert guarded('ctc map', lambda: np.zeros(10 ** 15).size) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith('ctc map: the memory does not suffice: Unable to allocate')


def test_default_number_of_processes_is_one_without_dask(
        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('os.cpu_count', lambda: 8)
    for default in (8, 1):
        parser = make_parser(['compare'])
        assert parser.parse_args(['compare', 'friction']).jobs == default
        assert parser.parse_args(['compare', 'friction', '--jobs', '3']).jobs == 3
        monkeypatch.setattr(options, 'find_spec', lambda _: None)


def parsers() -> Iterator[tuple[str, ArgumentParser]]:
    """Yield the parsers of all command lines that people type."""
    (commands,) = (x for x in make_parser()._actions if isinstance(x, _SubParsersAction))
    yield from commands.choices.items()
    yield 'bringup', bringup_parser()
    for name in NODE_DESCRIPTIONS:
        yield name, node_parser(name)


@pytest.mark.parametrize(('name', 'parser'), [*parsers()],
                         ids=lambda x: x if isinstance(x, str) else '')
def test_help_consists_of_sentences(name: str, parser: ArgumentParser) -> None:
    """Check the first sentence against its declaration, and the ends of all texts."""
    description = str(parser.description)
    sentence = re.compile(r'[A-Z].*[^?!.,:;]\.', re.DOTALL)
    assert sentence.fullmatch(description)
    if name in COMMANDS:
        assert sentence.fullmatch(COMMANDS[name].summary)
        assert description.startswith(COMMANDS[name].summary)
    for action in parser._actions:
        if action.help != SUPPRESS:
            assert re.fullmatch(r'[A-Z.].*\.( \[.*\])?', str(action.help)), action.dest
