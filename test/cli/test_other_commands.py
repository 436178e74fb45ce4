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

"""`ctc compile`, `ctc stability`, and the bar of progress."""

from __future__ import annotations

from pathlib import Path
from shutil import copy

from ctc_chattering.cli import experiments
from ctc_chattering.compiled.machine_code import HOW_TO_COMPILE
from ctc_chattering.configuration import compilation, parameter_file
from ctc_chattering.configuration.compilation import required_codes
from ctc_chattering.runs.stability import stability
from ctc_commands import ctc, ctc_process
from machine_code import compile_runs
import pytest


@pytest.mark.slow
def test_a_user_who_has_not_compiled_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`ctc simulate` computes and says how to compile; that done, it says nothing."""
    known = parameter_file.load(None)
    compile_runs(known)
    cache = tmp_path / '.cache' / 'ctc_chattering' / 'machine_code'
    cache.mkdir(parents=True, mode=0o700)
    for code in required_codes(known):  # All but the law, which would take half a minute.
        copy(code.path, cache)
    monkeypatch.setenv('HOME', str(tmp_path))
    run = 'simulate', '--duration', '0.05', '--law', 'pd_gravity'
    first = ctc_process(*run)
    assert first.returncode == 0
    assert HOW_TO_COMPILE in first.stderr
    compiled = ctc_process('compile', '--law', 'pd_gravity', timeout=300.0)
    assert compiled.returncode == 0, compiled.stderr
    assert compiled.stdout.startswith('compiled 1 function in ')
    assert str(tmp_path / '.cache') in compiled.stdout
    assert compiled.stderr.splitlines()[-1] == 'compiled control-pdgravity-2 (1 of 1)'
    again = ctc_process(*run)
    assert again.returncode == 0
    assert HOW_TO_COMPILE not in again.stderr
    assert again.stdout == first.stdout


@pytest.mark.parametrize('plain', [False, True])
def test_a_long_run_compiles_by_itself(monkeypatch: pytest.MonkeyPatch, plain: bool) -> None:
    """It takes longer than the compiler; `--plain` has it run at once."""
    asked: list[str] = []
    monkeypatch.setattr(experiments, '_COMPILED_DURATION_S', 0.05)
    monkeypatch.setattr(compilation, 'uncompiled_codes', lambda setups: required_codes(*setups))
    monkeypatch.setattr(compilation, 'compile_setups', lambda setups, _show: asked.extend(
        setup.controller.law for setup in setups))
    for duration in ('0.04', '0.05'):
        done = ctc('simulate', '--duration', duration, *['--plain'] * plain)
        assert done.returncode == 0
        assert (HOW_TO_COMPILE in done.stderr) == (plain or duration == '0.04')
    assert asked == ([] if plain else ['chattering'])


def test_what_cannot_be_compiled_runs_in_plain_python(tmp_path: Path) -> None:
    path = tmp_path / 'elastic.yaml'
    path.write_text('plant: {ros__parameters: {joint_stiffness: [1.0e4, 1.0e4], '
                    'motor_inertia: [1.0, 0.1]}}\n')
    done = ctc('simulate', '--params-file', path, '--duration', '0.01')
    assert (done.returncode, HOW_TO_COMPILE in done.stderr) == (0, False)


LAW = ('--law', 'observer_feedback', '--gains', 'recommended')


def robot(folder: Path, lag: float) -> Path:
    """Return a parameter file of the paper's arm with drives of this lag [s]."""
    file = folder / 'robot.yaml'
    file.write_text(f'plant: {{ros__parameters: {{actuator_lag: [{lag}, {lag}]}}}}\n'
                    'controller: {ros__parameters: {actuator_lag: [0.003, 0.003]}}\n')
    return file


def test_the_table_is_rounded_inwards(tmp_path: Path) -> None:
    file = robot(tmp_path, 0.002)
    result = ctc('stability', file, *LAW)
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    assert lines[1:3] == [
        'law: lag 3 ms, delay 0 samples', 'robot: lag 2 ms, delay 0 samples']
    over, _ = parameter_file.with_gains(file, {'controller': {'law': LAW[1]}}, LAW[3])
    found = stability(parameter_file.load(file, over))
    (shown,) = (line for line in lines if ', constant' in line)
    low, high = (float(shown.split()[k]) for k in (-3, -1))
    assert found.ratios is not None and found.guaranteed is not None
    assert found.ratios == pytest.approx((low, high), rel=0.1)
    assert found.ratios[0] <= low < high <= found.ratios[1]
    assert found.ratios[0] < found.guaranteed[0] < found.guaranteed[1] < high


def test_an_unstable_loop_has_status_1(tmp_path: Path) -> None:
    result = ctc('stability', robot(tmp_path, 0.02), *LAW)
    assert result.returncode == 1
    assert 'unstable: a pole at 1.0' in result.stdout
