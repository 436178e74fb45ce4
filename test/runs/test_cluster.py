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

"""A cluster that is not trusted: what its workers and its scheduler send runs nothing here."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
import json
import os
from pathlib import Path
import pickle
import subprocess
import sys
import threading
from typing import Any

from ctc_chattering.errors import CtcError
from ctc_chattering.runs import cluster, pool, store
from ctc_commands import ROOT
from dask_attackers import Evil, marked, MARKS, SCHEDULER
from map_specs import runs
import numpy as np
import pyarrow
import pytest

ATTACKERS = ROOT / 'test' / 'support' / 'dask_attackers.py'


@contextmanager
def started(folder: Path, *preload: str, **environment: str) -> Iterator[str]:
    """Start a scheduler and a worker, each in a process of its own; yield the address."""
    file = folder / 'scheduler.json'
    path = os.pathsep.join(map(str, (ROOT, ROOT / 'test' / 'support')))
    place = ('--no-dashboard', '--scheduler-file', str(file))
    commands = [('dask_scheduler', '--port', '0', *place, *preload),
                ('dask_worker', '--nthreads', '1', *place, *preload)]
    processes = []
    try:
        for command, *words in commands:
            processes.append(subprocess.Popen(
                [sys.executable, '-m', f'distributed.cli.{command}', *words],
                stderr=subprocess.DEVNULL,
                env={**os.environ, 'PYTHONPATH': path, MARKS: str(folder), **environment}))
            while not (file.exists() and file.read_text()):
                with pytest.raises(subprocess.TimeoutExpired):
                    processes[0].wait(0.01)
        yield json.loads(file.read_text())['address']
    finally:
        for process in processes:
            process.kill()
            process.wait()


def test_rows_come_from_a_cluster(tmp_path: Path) -> None:
    made = runs()
    chunks = [np.arange(3), np.arange(3, 5)]
    with started(tmp_path) as address, cluster.connect_cluster(address) as client:
        tables = list(cluster.run_on_cluster(client, made, chunks))
        assert [x['run'].to_pylist() for x in tables] == [[0, 1, 2], [3, 4]]
        here = [store.compute(made, '', chunk) for chunk in chunks]
        assert pyarrow.concat_tables(tables).drop_columns('engine').equals(
            pyarrow.concat_tables(here).drop_columns('engine'))
        with pytest.raises(CtcError, match=r'^a worker failed: ValueError: index 1000000'):
            list(cluster.run_on_cluster(client, made, [np.array([10 ** 6])]))
        with pytest.raises(CtcError, match=r'a worker has version .* not 0'):
            list(pool_of(client, made))


def pool_of(client: Any, made: Any) -> Iterator[Any]:
    """Yield what a worker answers to another version."""
    for data in pool.run_on_workers(client, cluster.answer, [np.arange(1)], made, '0'):
        yield cluster.read_answer(data, store.table_schema(made), np.arange(1))


@pytest.fixture(scope='module')
def attacked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    """Yield the address of a cluster whose worker attacks, and the folder of its marks."""
    folder = tmp_path_factory.mktemp('marks')
    with started(folder, '--preload', str(ATTACKERS)) as address:
        yield address, folder


@pytest.mark.parametrize(('number', 'reason'), [
    (0, r'a worker failed: TypeError: builtins\.exec was sent to be unpickled, which is refused'),
    (1, r'a worker failed: it was killed again and again .*, or cannot load ctc_chattering; its'),
    (2, 'a worker answered with what is no table'),
    (3, 'a worker answered with int, not with a table|was sent to be unpickled'),
    (4, 'a worker answered with other rows or columns')])
def test_what_a_worker_sends_runs_nothing_here(
        number: int, reason: str, attacked: tuple[str, Path]) -> None:
    """Check an evil answer, error and warning, bytes that are no table, and other rows."""
    address, folder = attacked
    with cluster.connect_cluster(address) as client, pytest.raises(CtcError, match=f'^{reason}'):
        list(cluster.run_on_cluster(client, runs(), [np.array([number])]))
    assert not marked(folder)


def test_the_attack_would_succeed_where_dask_unpickles(
        attacked: tuple[str, Path]) -> None:
    """Check that the worker's answer is one that makes a file."""
    address, folder = attacked
    with pool.workers(1, address) as client:
        answers = pool.run_on_workers(client, cluster.answer, [np.array([0])], runs(), '')
        assert next(answers) is None
    assert marked(folder)
    (folder / str(os.getpid())).unlink()


def test_what_the_scheduler_sends_runs_nothing_here(tmp_path: Path) -> None:
    with started(tmp_path, '--preload', str(ATTACKERS), **{SCHEDULER: 'yes'}) as address:
        with (pytest.raises(CtcError, match='no scheduler answers'),
              cluster.connect_cluster(address)):
            pass
        assert not marked(tmp_path)


def test_only_other_threads_are_refused_and_only_while_connected(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever they are connected to; here, nothing."""
    monkeypatch.setattr(pool, 'workers', lambda *_: nullcontext())
    monkeypatch.setenv(MARKS, str(tmp_path))
    data, errors = pickle.dumps(Evil()), list[str]()

    def load() -> None:
        try:
            pickle.loads(data)
        except TypeError as error:
            errors.append(str(error))

    def in_a_thread() -> None:
        thread = threading.Thread(target=load)
        thread.start()
        thread.join()

    with cluster.connect_cluster('tcp://nowhere:1'):
        in_a_thread()
        assert errors == ['builtins.exec was sent to be unpickled, which is refused']
        assert not marked(tmp_path)
        assert pickle.loads(pickle.dumps({np.float64})) == {np.float64}
    in_a_thread()
    assert marked(tmp_path) and len(errors) == 1
