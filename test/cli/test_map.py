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

"""`ctc map`: what it writes, what survives a kill, and one line for everything that is wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
from typing import Any

from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.output_folder import held, LIST
from ctc_chattering.runs import store
from ctc_chattering.runs.run_lists import MapRuns
from ctc_chattering.runs.spec import read_spec
from ctc_commands import ctc, refused, ROOT
from map_specs import BRIEF, written
import pandas  # type: ignore[import-untyped]
import psutil  # type: ignore[import-untyped]
import pyarrow
import pytest
from stopwatch import PATIENCE
from urdfs import two_links
import yaml


@contextmanager
def started(*arguments: object) -> Iterator[subprocess.Popen[str]]:
    """Start `ctc map`, or a program, in a process group of its own; end it with all below it."""
    process = subprocess.Popen(
        [sys.executable, '-m', *map(str, arguments)], text=True, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, start_new_session=True,
        env={**os.environ, 'PYTHONPATH': str(ROOT)})
    try:
        yield process
    finally:
        below = psutil.Process(process.pid).children(recursive=True) if (
            process.poll() is None) else []
        for each in (process, *below):
            each.kill()
        process.communicate()


def mapped(spec: Path, out: Path, *more: object) -> Any:
    return started('ctc_chattering.cli.ctc', 'map', spec, '--out', out, *more)


def until(done: Callable[[], Any], process: subprocess.Popen[str]) -> None:
    """Wait until `done`, while a process runs."""
    while not done():
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(0.01)


def shards(out: Path) -> set[str]:
    return {x.name for x in out.glob('shards/*.parquet')}


def in_one_process(spec: Path, out: Path) -> dict[str, bytes]:
    """Compute a map run by run here; return the bytes of its tables."""
    runs = MapRuns(read_spec(spec))
    parts = []
    with store.open_directory(
            out, store.table_metadata(runs), store.table_schema(runs)) as directory:
        for chunk in reversed(store.chunks(runs, range(len(runs)))):
            parts.append(store.compute(runs, store.version(), chunk))
            directory.write(parts[-1], directory.file(chunk))
        directory.merge(pyarrow.concat_tables(parts))
    return tables(out)


def tables(out: Path) -> dict[str, bytes]:
    return {x.name: x.read_bytes() for x in out.rglob('*.parquet')}


@pytest.mark.slow
def test_a_map_that_is_killed_goes_on_to_the_same_bytes(tmp_path: Path) -> None:
    """Kill everything, start again with more workers, kill one of them: nothing else is lost."""
    spec, out = written(tmp_path / 'brief.yaml', **BRIEF), tmp_path / 'out'
    expected = in_one_process(spec, tmp_path / 'here')
    with mapped(spec, out, '--jobs', 1) as process:
        until(lambda: len(shards(out)) >= 5, process)
        process.kill()
        process.wait()
    before = shards(out)
    assert 5 <= len(before) < 60
    assert {x: y for x, y in tables(out).items() if x in before} == {
        x: y for x, y in expected.items() if x in before}
    with mapped(spec, out, '--jobs', 2) as process:
        until(lambda: len(shards(out)) >= len(before) + 5, process)
        worker = next(x for x in psutil.Process(process.pid).children(recursive=True)
                      if 'spawn_main' in ' '.join(x.cmdline()))
        worker.kill()
        assert len(shards(out)) < 60
        output, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, output
    assert f'{len(before)} of them computed' in output
    assert tables(out) == expected


@pytest.mark.slow
def test_ctrl_c_ends_in_a_line(tmp_path: Path) -> None:
    """Send it to all processes, as a terminal does."""
    spec, out = written(tmp_path / 'brief.yaml', **BRIEF), tmp_path / 'out'
    with mapped(spec, out, '--jobs', 2) as process:
        until(lambda: shards(out), process)
        workers = psutil.Process(process.pid).children(recursive=True)
        os.killpg(process.pid, signal.SIGINT)
        output, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert output.splitlines()[-1].endswith(
        f'ctc map: stopped; {len(shards(out))} of 60 runs are in {out}, '
        'run the same command to continue')
    assert 'Traceback' not in output
    assert psutil.wait_procs(workers, PATIENCE)[1] == []


def test_results(tmp_path: Path) -> None:
    """Check every file; that of another map is refused."""
    out = tmp_path / 'out'
    spec = written(tmp_path / 'small.yaml', failure={'error_above': 1e-9}, repeats=1)
    words = ('map', spec, '--out', out, '--jobs', 1)
    result = ctc(*words)
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[0] == '12 runs in 12 chunks, 0 of them computed'
    assert {x.name for x in out.iterdir()} == {
        'map.parquet', 'map.json', 'shards', 'figures', 'index.html', LIST}
    about = json.loads((out / 'map.json').read_text(encoding='utf-8'))
    assert about['spec']['window'] == [0.05, 0.1]
    assert about['versions']['ctc_chattering'] == store.version()
    before = tables(out)
    with held(out, 'ctc map'):
        refused(ctc(*words), f'{out}: another process is writing there')
    written(spec, seed=8)
    refused(ctc(*words), f'{out}: there is output of ctc map for another spec or version',
            '--overwrite')
    assert tables(out) == before


def test_the_parameter_file_of_a_run_is_its_setup(tmp_path: Path) -> None:
    """Check the run that `--explain` writes."""
    spec, out = written(tmp_path / 'small.yaml'), tmp_path / 'out'
    words = ('map', spec, '--out', out, '--explain')
    result = ctc(*words, '15')
    assert result.returncode == 0, result.stderr
    assert 'run 15, point 3, repeat 1, seed 8, variant chattering implicit' in result.stdout
    file = out / 'explain' / 'run_15.yaml'
    assert f'ctc simulate {file}' in result.stdout
    named = MapRuns(read_spec(spec)).setup(15).changed({'plant': {'experiment': 'run_15'}})
    assert parameter_file.load(file).values == named.values
    refused(ctc(*words, '15'), 'run_15.yaml: exists already', '--overwrite')
    refused(ctc(*words, '24'), '--explain: 24', '0 to 23')


@pytest.mark.slow
def test_a_cluster_gives_the_same_bytes_and_its_end_is_a_line(tmp_path: Path) -> None:
    """Start dask's scheduler and two workers by hand; then kill the scheduler in the middle."""
    spec, out = written(tmp_path / 'brief.yaml', **BRIEF), tmp_path / 'out'
    expected = in_one_process(spec, tmp_path / 'here')
    file = tmp_path / 'scheduler.json'
    place = ('--no-dashboard', '--scheduler-file', file)
    with started('distributed.cli.dask_scheduler', '--port', 0, *place) as scheduler:
        until(lambda: file.exists() and file.read_text(), scheduler)  # Empty at first.
        address = json.loads(file.read_text())['address']
        worker = ('distributed.cli.dask_worker', '--nthreads', 1, *place)
        with started(*worker), started(*worker):
            with mapped(spec, out, '--scheduler', address) as process:
                output, _ = process.communicate(timeout=PATIENCE)
            assert process.returncode == 0, output
            assert tables(out) == expected
            other = tmp_path / 'other'
            with mapped(spec, other, '--scheduler', address) as process:
                until(lambda: len(shards(other)) >= 5, process)
                scheduler.kill()
                output, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    assert 'ctc map: the scheduler is lost; ' in output.splitlines()[-1]
    assert 'Traceback' not in output


def test_without_a_failure_in_the_spec_a_payload_that_costs_a_tenth_of_the_motion_fails(
        tmp_path: Path) -> None:
    """In the table and the headline; `ctc simulate` warns of the same run, and of no other."""
    (tmp_path / 'arm.urdf').write_text(two_links())
    (tmp_path / 'arm.yaml').write_text(yaml.safe_dump({
        '/**': {'ros__parameters': {
            'joint_names': ['a', 'b'], 'model': 'urdf', 'description': str(tmp_path / 'arm.urdf'),
            'control_period': 5e-3, 'compiled': False}},
        'plant': {'ros__parameters': {
            'initial_position': [0.0, 0.5], 'coulomb_friction': 0.0, 'integration_step': 5e-3}},
        'controller': {'ros__parameters': {'law': 'compensation'}},
        'reference': {'ros__parameters': {'center': [0.0, 0.5], 'frequency': [0.4, 0.4]}}}))
    spec = tmp_path / 'load.yaml'
    spec.write_text(yaml.safe_dump({
        'params_file': 'arm.yaml', 'duration': 2.0,
        'axes': {'payload': {'parameter': 'plant.payload', 'values': [0, 5]}}}))
    done = ctc('map', spec, '--out', tmp_path / 'map', '--jobs', 1)
    assert done.returncode == 0, done.stderr
    fine, bad = pandas.read_parquet(tmp_path / 'map' / 'map.parquet').to_dict('records')
    assert (fine['failure'], bad['failure']) == ('', 'error')
    assert fine['error_share'] < 0.1 < bad['error_share']
    assert bad['reason'].endswith(' % of the amplitude of the motion > 10 %')
    page = (tmp_path / 'map' / 'index.html').read_text(encoding='utf-8')
    assert 'compensation fails in 50.0 % of the runs' in page

    warned = [any('% of the amplitude of the motion' in note for note in simulate(
        read_spec(spec).setup.changed({'plant': {'payload': x}})).metrics()['notes'])
        for x in (0.0, 5.0)]
    assert warned == [False, True]

    spec.write_text(spec.read_text(encoding='utf-8') + 'failure: {}\n', encoding='utf-8')
    done = ctc('map', spec, '--out', tmp_path / 'diverged', '--jobs', 1)
    page = (tmp_path / 'diverged' / 'index.html').read_text(encoding='utf-8')
    assert 'compensation fails in 0.0 % of the runs' in page
