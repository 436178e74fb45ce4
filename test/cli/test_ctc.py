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

"""The command line: what it prints, writes and refuses."""

from __future__ import annotations

from argparse import _SubParsersAction
import json
import os
from pathlib import Path
import re
import subprocess
import sys
from typing import Any

from bags import entries, write_bag
from ctc_chattering import __version__
from ctc_chattering.analysis.metrics import metrics
from ctc_chattering.analysis.result import simulate
from ctc_chattering.cli.command_line import guarded
from ctc_chattering.cli.ctc import make_parser
from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.controller_config import SWITCHINGS
from ctc_chattering.simulation import closed_loop
from ctc_chattering.simulation.closed_loop import Run
from ctc_commands import ctc, ctc_process, python, refused
import numpy as np
import pytest
from urdfs import two_links

ROOT = Path(__file__).parents[2]
FRICTION = ROOT / 'config' / 'friction.yaml'
ARRAYS = ['t', 'q', 'dq', 'q_d', 'dq_d', 'tau', 'v']


def run_of(out: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the only entry of metrics.json, and the arrays."""
    document = json.loads((out / 'metrics.json').read_text(encoding='utf-8'))
    assert list(document) == ['runs']
    (entry,) = document['runs']
    with np.load(out / 'trajectory.npz') as arrays:
        return entry, dict(arrays)


def same(arrays: dict[str, Any], run: Run) -> None:
    for name in ARRAYS:
        assert arrays[name].tobytes() == np.ascontiguousarray(getattr(run, name)).tobytes()


@pytest.fixture
def short(tmp_path: Path) -> Path:
    """Return a parameter file of 0.1 s."""
    file = tmp_path / 'short.yaml'
    file.write_text(FRICTION.read_text().replace('duration: 10.0', 'duration: 0.1'))
    return file


def test_simulate(tmp_path: Path) -> None:
    """Check the contract's call: both files, shapes, and every number against the core's."""
    tmp_path.joinpath('out').mkdir()  # an empty directory contains no output
    result = ctc_process('simulate', '--params-file', FRICTION, '--law', 'compensation',
                         '--out', tmp_path / 'out')
    assert result.returncode == 0, result.stderr
    assert {x.name for x in (tmp_path / 'out').iterdir()} == {'metrics.json', 'trajectory.npz'}
    entry, arrays = run_of(tmp_path / 'out')
    assert arrays['joint_names'].tolist() == ['joint1', 'joint2']
    assert {arrays[name].dtype for name in ARRAYS} == {np.dtype('float64')}
    assert arrays['t'].shape == (10001,)
    assert {arrays[name].shape for name in ARRAYS[1:]} == {(10001, 2)}
    setup = parameter_file.load(FRICTION, {'controller': {'law': 'compensation'}})
    run = closed_loop.simulate(setup.plant, setup.controller, setup.reference)
    same(arrays, run)
    assert {key: entry.pop(key) for key in metrics(run)} == metrics(run)
    assert entry == {
        'experiment': 'friction', 'bag': None, 'law': 'compensation', 'switching': 'sign',
        'control_period_s': 0.001, 'joint_names': ['joint1', 'joint2'],
        'position_units': ['rad', 'rad'], 'torque_units': ['N·m', 'N·m'], 'gains': {
            'kp': [100.0, 100.0], 'kv': [50.0, 50.0], 'lambda': 10.0, 'b': 1.0},
        'term_at_bound': None}
    assert 'friction' in result.stdout
    assert 'compensation' in result.stdout


@pytest.mark.parametrize('switching', SWITCHINGS)
def test_control_period_and_switching(tmp_path: Path, short: Path, switching: str) -> None:
    """Check options that stand above the file, in a directory that is made."""
    out = tmp_path / 'a' / 'b'
    result = ctc('simulate', '--params-file', short, '--control-period', '0.002',
                 '--switching', switching, '--out', out)
    assert result.returncode == 0, result.stderr
    entry, arrays = run_of(out)
    assert (entry['control_period_s'], entry['switching']) == (0.002, switching)
    assert entry['law'] == 'chattering'
    assert arrays['t'].shape == (51,)
    setup = parameter_file.load(short, {'/**': {'control_period': 0.002},
                                'controller': {'switching': switching}})
    same(arrays, closed_loop.simulate(setup.plant, setup.controller, setup.reference))


def test_without_a_file_it_is_the_paper_s_first_experiment(tmp_path: Path) -> None:
    """Check what --help promises, from any directory."""
    result = ctc('simulate', '--control-period', '0.02', '--out', 'out', cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    entry, arrays = run_of(tmp_path / 'out')
    assert (entry['experiment'], entry['law']) == ('friction', 'chattering')
    assert arrays['t'][-1] == 10.0


def test_without_out_numbers_are_printed(short: Path) -> None:
    before = set(short.parent.iterdir())
    result = ctc('simulate', '--params-file', short, cwd=short.parent)
    assert result.returncode == 0
    assert 'chattering' in result.stdout
    assert set(short.parent.iterdir()) == before


def test_existing_output(tmp_path: Path, short: Path) -> None:
    """Check the refusal, that nothing is touched by it, and --overwrite."""
    out = tmp_path / 'out'
    out.mkdir()
    (out / 'notes').write_text('mine')
    call = ('simulate', '--params-file', short, '--out', out)
    assert ctc(*call).returncode == 0
    before = {x.name: x.read_bytes() for x in out.iterdir()}
    refused(ctc(*call), out, 'metrics.json', '--overwrite')
    (out / 'metrics.json').unlink()
    refused(ctc(*call), 'trajectory.npz')
    assert (out / 'trajectory.npz').read_bytes() == before['trajectory.npz']
    assert ctc(*call, '--law', 'compensation', '--overwrite').returncode == 0
    assert run_of(out)[0]['law'] == 'compensation'
    assert (out / 'notes').read_text() == 'mine'


@pytest.mark.parametrize(('content', 'words'), [
    ('controller: {ros__parameters: {mass: 1}}', ['mass', 'controller']),
    ('controller: {ros__parameters: {lambda: 0}}', ['lambda', '>= 1e-09']),
    ('plant: {ros__parameters: {duration: -1.0}}', ['duration', '>= 0']),
    ('plant: {ros__parameters: {duration: 1.0, initial_velocity: [1e300, 1e300]}}', []),
    ('a: [', ['not a YAML file']), ('', ['node names'])])
def test_bad_file(tmp_path: Path, content: str, words: list[str]) -> None:
    """Check one line for a file that cannot be run, and no output."""
    file = tmp_path / 'p.yaml'
    file.write_text(content)
    refused(ctc('simulate', '--params-file', file, '--out', tmp_path / 'out'), *words)
    assert not (tmp_path / 'out' / 'metrics.json').exists()


def test_bad_places(tmp_path: Path, short: Path) -> None:
    """Check a file and directories that are not there or cannot be made."""
    refused(ctc('simulate', '--params-file', tmp_path / 'none.yaml'), 'none.yaml')
    refused(ctc('simulate', '--params-file', tmp_path), tmp_path)
    refused(ctc('simulate', '--params-file', short, '--out', short), short)
    refused(ctc('simulate', '--params-file', short, '--out', '/proc/self/x'), '/proc/self/x')


def test_duration(tmp_path: Path) -> None:
    """Check --duration, and that a run without an end gets one, of 10 s, and says so."""
    file = tmp_path / 'p.yaml'
    file.write_text('/**: {ros__parameters: {control_period: 0.02}}')
    for more, end in (('--duration=0.5',), 0.5), ((), 10.0):
        out = tmp_path / str(end)
        result = ctc('simulate', '--params-file', file, '--out', out, *more)
        assert result.returncode == 0, result.stderr
        assert run_of(out)[1]['t'][-1] == end
        assert ('no end' in result.stderr) == (end == 10.0)


@pytest.mark.parametrize('command', ['plot', 'replay'])
def test_no_bag(tmp_path: Path, command: str) -> None:
    """Check what is not there, a file, an empty directory, another one, and broken metadata."""
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'broken').mkdir()
    (tmp_path / 'broken' / 'metadata.yaml').write_bytes(b'\xff\xfe\0')
    for bag in (tmp_path / 'none', FRICTION, tmp_path / 'empty', FRICTION.parent,
                tmp_path / 'broken'):
        more = ('--out', tmp_path / 'out') if command == 'plot' else ()
        refused(ctc(command, bag, *more), bag)


def test_plot(tmp_path: Path) -> None:
    """Check figures, numbers and page of two bags, and that they may be drawn again."""
    bags = []
    for law in ('compensation', 'chattering'):
        setup = parameter_file.load(None, {'plant': {'duration': 0.1}, 'controller': {'law': law}})
        bags.append(tmp_path / law)
        write_bag(bags[-1], entries(simulate(setup), setup.plant))
    result = ctc('plot', *bags, '--out', tmp_path / 'out')
    assert result.returncode == 0, result.stderr
    assert {x.name for x in (tmp_path / 'out').iterdir()} == {
        'figures', 'metrics.json', 'index.html', 'samples'}
    assert list((tmp_path / 'out' / 'figures').iterdir())
    runs = json.loads((tmp_path / 'out' / 'metrics.json').read_text())['runs']
    assert [run['law'] for run in runs] == ['compensation', 'chattering']
    assert '<html' in (tmp_path / 'out' / 'index.html').read_text(encoding='utf-8')
    before = (tmp_path / 'out' / 'metrics.json').read_bytes()
    refused(ctc('plot', bags[0], '--out', tmp_path / 'out'), '--overwrite')
    bad = ctc('plot', FRICTION.parent, '--out', tmp_path / 'out', '--overwrite')
    refused(bad, FRICTION.parent)
    assert (tmp_path / 'out' / 'metrics.json').read_bytes() == before, 'lost to a bad bag'


def test_plot_of_a_directory_and_export(tmp_path: Path) -> None:
    """Check that all its bags are taken, others named and left out; PDF; and a bag as CSV."""
    setup = parameter_file.load(None, {'plant': {'duration': 0.05}})
    expected = simulate(setup)
    for name in ('a', 'below/b', 'old.damaged'):
        path = tmp_path / 'bags' / name
        path.parent.mkdir(exist_ok=True, parents=True)
        write_bag(path, entries(expected, setup.plant))
    write_bag(tmp_path / 'bags' / 'foreign', entries(expected, setup.plant)[:1])
    result = ctc('plot', tmp_path / 'bags', '--format', 'pdf', '--out', tmp_path / 'out')
    assert result.returncode == 0, result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert 'left out' in result.stderr and 'foreign' in result.stderr
    runs = json.loads((tmp_path / 'out' / 'metrics.json').read_text())['runs']
    assert [run['bag'] for run in runs] == ['a', 'b']
    kinds = [path.suffix for path in (tmp_path / 'out' / 'figures').iterdir()]
    assert kinds.count('.pdf') == kinds.count('.svg') == 7
    page = (tmp_path / 'out' / 'index.html').read_text(encoding='utf-8')
    assert 'friction: chattering, bag a' in page and 'friction: chattering, bag b' in page

    result = ctc('export', tmp_path / 'bags' / 'a', '--csv', '--out', tmp_path)
    assert result.returncode == 0, result.stderr
    table = np.genfromtxt(tmp_path / 'trajectory.csv', delimiter=',', skip_header=1)
    np.testing.assert_array_equal(table[:, 1:3], expected.run.q)
    refused(ctc('export', tmp_path / 'bags' / 'a', '--csv', '--out', tmp_path), '--overwrite')


def test_simulate_needs_numpy_only(short: Path) -> None:
    """Check that neither ROS nor bags nor figures are imported."""
    code = ('import sys\nfrom ctc_chattering.cli.ctc import main\n'
            f'assert main(["simulate", "--params-file", {str(short)!r}]) == 0\n'
            'print(sorted({name.split(".")[0] for name in sys.modules} & {"rclpy", "rosbags", '
            '"matplotlib", "mcap", "scipy", "sensor_msgs", "builtin_interfaces"}))')
    result = python('-c', code)
    assert result.stdout.splitlines()[-1] == '[]', result.stderr


@pytest.mark.parametrize('command', ['', 'simulate', 'reproduce', 'plot', 'replay', 'compare'])
def test_help(command: str) -> None:
    """Check each help, without heavy imports, and that the first names all commands."""
    result = ctc_process(*command.split(), '--help')
    assert (result.returncode, result.stderr) == (0, '')
    assert result.stdout.startswith(f'usage: ctc {command}'.rstrip())
    if not command:
        for name in ('simulate', 'reproduce', 'plot', 'replay', 'compare'):
            assert name in result.stdout
    else:
        assert ctc('--version').stdout.strip() == __version__


def test_the_first_help_loads_no_command() -> None:
    """Check that neither numbers nor YAML nor a subcommand are imported for it."""
    code = ('import sys\nfrom ctc_chattering.cli.ctc import main\n'
            'try:\n    main(["--help"])\nexcept SystemExit:\n'
            '    print("loaded:", sorted(set(sys.modules) & {'
            '"numpy", "yaml", "jinja2", "ctc_chattering.cli.options"}))')
    assert python('-c', code).stdout.endswith('\nloaded: []\n')


def test_sentences_of_help_end_once() -> None:
    """Check every subcommand for punctuation before the full stop that ends its summary."""
    (commands,) = (x for x in make_parser()._actions if isinstance(x, _SubParsersAction))
    for name, parser in commands.choices.items():
        assert not re.search(r'[?!.,:;]\.', str(parser.description)), name


def test_too_little_memory_is_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert guarded('ctc map', lambda: np.zeros(10 ** 15).size) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith('ctc map: too little memory: Unable to allocate')


def test_closed_pipe(short: Path) -> None:
    """Check that `ctc simulate | true` says nothing."""
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, 'wb') as stdout:
        result = subprocess.run(
            [sys.executable, '-u', '-m', 'ctc_chattering.cli.ctc', 'simulate', '--params-file',
             str(short)], cwd=ROOT, stdout=stdout, stderr=subprocess.PIPE, timeout=60, check=False)
    assert b'Traceback' not in result.stderr
    assert b'Broken' not in result.stderr


def test_check_model(tmp_path: Path) -> None:
    """Check the table and the status, for the paper's arm, a URDF, and a class with a fault."""
    result = ctc('check-model', cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith('two_link, 2 joints: joint1, joint2\n')
    assert result.stdout.count('\nok ') == 9
    file = tmp_path / 'arm.urdf'
    file.write_text(two_links())
    result = ctc('check-model', '--urdf', file, '--gravity', 1.6, '--samples', 3, '--seed', 7)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith('urdf, 2 joints: a, b\n')
    result = ctc('check-model', '--urdf', file, '--joints', 'b')
    assert result.stdout.startswith('urdf, 1 joints: b\n')
    (tmp_path / 'mine.py').write_text(
        'from ctc_chattering.dynamics.two_link import TwoLink\n'
        'class Arm(TwoLink):\n'
        '    def __init__(self, names, gravity):\n'
        '        super().__init__(gravity)\n'
        '    def potential_energy(self, q):\n'
        '        return 0.0\n')
    result = ctc_process('check-model', '--model', 'mine:Arm', path=tmp_path)
    assert result.returncode == 1
    assert result.stdout.count('FAILED') == 1
    assert 'G is the gradient of the potential: worst at q = ' in result.stdout
    assert result.stderr == ''


@pytest.mark.parametrize(('arguments', 'words'), [
    (['--urdf', 'nowhere.urdf'], ['nowhere.urdf']),
    (['--urdf', 'README.md'], ['description', 'not XML'])])
def test_check_model_refuses(arguments: list[str], words: list[str]) -> None:
    refused(ctc('check-model', *arguments), 'ctc check-model', *words)
