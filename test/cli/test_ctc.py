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

import json
import os
from pathlib import Path
import subprocess
import sys
from typing import Any

from bags import entries, write_bag
from ctc_chattering import __version__
from ctc_chattering.analysis.metrics import metrics
from ctc_chattering.analysis.result import simulate
from ctc_chattering.cli.ctc import COMMANDS
from ctc_chattering.configuration import parameter_file
from ctc_chattering.output_folder import LIST
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
    assert {x.name for x in (tmp_path / 'out').iterdir()} == {
        LIST, 'metrics.json', 'trajectory.npz'}
    entry, arrays = run_of(tmp_path / 'out')
    assert arrays['joint_names'].tolist() == ['joint1', 'joint2']
    assert {arrays[name].dtype for name in ARRAYS} == {np.dtype('float64')}
    assert arrays['t'].shape == (10001,)
    assert {arrays[name].shape for name in ARRAYS[1:]} == {(10001, 2)}
    setup = parameter_file.load(FRICTION, {'controller': {'law': 'compensation'}})
    run = closed_loop.run_closed_loop(setup.plant, setup.controller, setup.reference)
    same(arrays, run)
    assert {key: entry.pop(key) for key in metrics(run)} == metrics(run)
    assert entry == {
        'experiment': 'friction', 'bag': None, 'law': 'compensation', 'switching': 'sign',
        'control_period_s': 0.001, 'joint_names': ['joint1', 'joint2'],
        'position_units': ['rad', 'rad'], 'torque_units': ['N·m', 'N·m'], 'gains': {
            'kp': [100.0, 100.0], 'kv': [50.0, 50.0], 'lambda': 10.0, 'b': 1.0},
        'term_at_bound': None, 'origins': dict.fromkeys(
            ('q', 'dq', 'q_d', 'e', 'torque', 'v', 'V', 'nominal', 'compensation', 'robust'),
            'computed exactly')}
    assert 'friction' in result.stdout
    assert 'compensation' in result.stdout


def test_options_stand_above_the_file(tmp_path: Path) -> None:
    """Check them in a directory that is made, and that without a file it is the paper's first."""
    result = ctc('simulate', '--control-period', '0.002', '--switching', 'implicit',
                 '--duration', '0.1', '--out', Path('a', 'b'), cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    entry, arrays = run_of(tmp_path / 'a' / 'b')
    assert [entry[x] for x in ('control_period_s', 'switching', 'law', 'experiment')] == [
        0.002, 'implicit', 'chattering', 'friction']
    setup = parameter_file.load(None, {
        '/**': {'control_period': 0.002}, 'controller': {'switching': 'implicit'},
        'plant': {'duration': 0.1}})
    same(arrays, closed_loop.run_closed_loop(setup.plant, setup.controller, setup.reference))


def test_simulate_prints_the_passes_from_which_it_learned(tmp_path: Path) -> None:
    """The motion has a period of 1 s, so that passes end after 2 s and 3.75 s."""
    file = tmp_path / 'learn.yaml'
    file.write_text(FRICTION.read_text() + '    learning: true\n')
    done = ctc('simulate', file, '--law', 'compensation', '--duration', '4')
    assert done.returncode == 0, done.stderr
    lines = [line.split() for line in done.stdout.splitlines()]
    passes = lines[lines.index(['pass', 'from', '[s]', 'to', '[s]', 'joint1', 'joint2']) + 1:-1]
    assert [line[:3] for line in passes] == [['1', '1', '2'], ['2', '2.75', '3.75']]
    first, second = (max(map(float, line[3:])) for line in passes)
    assert second < 0.6 * first
    assert done.stdout.endswith('; learning\n')
    too_short = ctc('simulate', file, '--law', 'compensation', '--duration', '1.5')
    assert 'the first pass ends after 2 s; raise duration' in too_short.stdout


def test_existing_output(tmp_path: Path, short: Path) -> None:
    call = ('simulate', '--params-file', short, '--out', tmp_path / 'out')
    assert ctc(*call).returncode == 0
    (tmp_path / 'out' / 'metrics.json').unlink()
    refused(ctc(*call), 'trajectory.npz', '--overwrite')
    assert ctc(*call, '--law', 'compensation', '--overwrite').returncode == 0
    assert run_of(tmp_path / 'out')[0]['law'] == 'compensation'


def test_a_run_without_an_end_gets_one_and_says_so(tmp_path: Path) -> None:
    file = tmp_path / 'p.yaml'
    file.write_text('/**: {ros__parameters: {control_period: 0.02}}')
    result = ctc('simulate', '--params-file', file, '--out', tmp_path / 'out')
    assert result.returncode == 0, result.stderr
    assert run_of(tmp_path / 'out')[1]['t'][-1] == 10.0
    assert 'no end' in result.stderr


def test_plot_and_export(tmp_path: Path) -> None:
    """Check the bags of a directory, others left out, and one bag as CSV."""
    bags = []
    for law in ('compensation', 'chattering'):
        setup = parameter_file.load(None, {
            'plant': {'duration': 0.05}, 'controller': {'law': law}})
        bags.append(tmp_path / 'bags' / law)
        bags[-1].parent.mkdir(exist_ok=True)
        write_bag(bags[-1], entries(expected := simulate(setup), setup.plant))
    write_bag(tmp_path / 'bags' / 'foreign', entries(expected, setup.plant)[:1])
    out = tmp_path / 'out'
    result = ctc('plot', tmp_path / 'bags', '--out', out)
    assert result.returncode == 0, result.stderr
    (line,) = result.stderr.splitlines()
    assert 'left out' in line and 'foreign' in line
    assert {x.name for x in out.iterdir()} == {
        LIST, 'figures', 'metrics.json', 'index.html', 'samples'}
    runs = json.loads((out / 'metrics.json').read_text())['runs']
    assert [(run['bag'], run['law']) for run in runs] == [(x, x) for x in sorted(
        ('compensation', 'chattering'))]
    assert len(list((out / 'figures').iterdir())) == 7
    assert '<html' in (out / 'index.html').read_text(encoding='utf-8')
    before = (out / 'metrics.json').read_bytes()
    assert all(run['window_s'] == [0.025, 0.05] for run in runs)
    assert 'the second half of the run' in result.stdout
    chosen = ctc('plot', bags[0], '--window', '0.01', '0.03', '--out', tmp_path / 'chosen')
    assert chosen.returncode == 0, chosen.stderr
    (run,) = json.loads((tmp_path / 'chosen' / 'metrics.json').read_text())['runs']
    mine = simulate(parameter_file.load(None, {
        'plant': {'duration': 0.05}, 'controller': {'law': 'compensation'}})).run
    error = (mine.q_d - mine.q)[10:31]
    assert run['window_s'] == [0.01, 0.03]
    (note,) = run['notes']
    assert '% of the amplitude' in note, 'a run of 50 ms from a place off its reference'
    assert run['rms_error_rad'] == np.sqrt(np.square(error).mean(axis=0)).tolist()
    refused(ctc('plot', bags[0], '--out', out), '--overwrite')
    refused(ctc('plot', FRICTION.parent, '--out', out, '--overwrite'), FRICTION.parent)
    assert (out / 'metrics.json').read_bytes() == before, 'lost to a bad bag'

    samples = tmp_path / 'samples'
    result = ctc('export', bags[1], '--csv', '--out', samples)
    assert result.returncode == 0, result.stderr
    table = np.genfromtxt(samples / 'trajectory.csv', delimiter=',', skip_header=1)
    np.testing.assert_array_equal(table[:, 1:3], expected.run.q)
    refused(ctc('export', bags[1], '--csv', '--out', samples), '--overwrite')


def test_help_names_all_commands() -> None:
    result = ctc_process('--help')
    assert (result.returncode, result.stderr) == (0, '')
    assert result.stdout.startswith('usage: ctc')
    assert all(f'\n    {name}' in result.stdout for name in COMMANDS)
    for name in COMMANDS:
        assert ctc(name, '--help').stdout.startswith(f'usage: ctc {name}')
    assert ctc('--version').stdout.strip() == __version__


def test_the_first_help_loads_no_command() -> None:
    """Check that neither numbers nor YAML nor a subcommand are imported for it."""
    code = ('import sys\nfrom ctc_chattering.cli.ctc import main\n'
            'try:\n    main(["--help"])\nexcept SystemExit:\n'
            '    print("loaded:", sorted(set(sys.modules) & {'
            '"numpy", "yaml", "jinja2", "ctc_chattering.cli.options"}))')
    assert python('-c', code).stdout.endswith('\nloaded: []\n')


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
    assert result.stdout.startswith('model two_link with 2 joints: joint1, joint2\n')
    assert result.stdout.count('\nok ') == 9
    file = tmp_path / 'arm.urdf'
    file.write_text(two_links())
    result = ctc('check-model', '--urdf', file, '--joints', 'b', '--gravity', 1.6, '--samples', 3)
    assert result.stdout.startswith('model urdf with 1 joint: b\n')
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
    assert 'G is the gradient of the potential: the worst state is q = ' in result.stdout
    assert result.stderr == ''
