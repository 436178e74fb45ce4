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

"""Tasks over processes, killed workers, and schedulers that do not answer."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import signal
import threading
import time
from typing import Any

from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.runs.pool import processes, run_on_workers, threads, workers
from ctc_commands import python
from distributed import LocalCluster
import pytest
from scheduler_tasks import add, die, die_once, fail, late, until_there


@pytest.fixture(scope='module')
def client() -> Iterator[Any]:
    with workers(1) as made:
        yield made


def test_every_result_comes(client: Any) -> None:
    assert list(run_on_workers(client, add, range(50), 100, 1000)) == [1100 + k for k in range(50)]


def test_an_error_of_a_task_is_raised_by_the_caller(client: Any) -> None:
    with pytest.raises(ParameterError, match=r'ka: -1\.0 is not allowed; allowed: a number'):
        list(run_on_workers(client, fail, range(3), 'ours'))
    with pytest.raises(CtcError, match=r'^a worker failed: ZeroDivisionError: a division by'):
        list(run_on_workers(client, fail, range(3), 'other'))
    assert len(list(run_on_workers(client, add, range(3), 1, 2))) == 3


def test_results_come_in_the_order_of_their_tasks() -> None:
    """Check several calls of one map, the first task of which ends last, and none at all."""
    with processes(2) as each:
        assert list(each(late, [0.2, 0.0, 0.1])) == [0.2, 0.0, 0.1]
        assert list(each(late, [0.01, 0.0])) == [0.01, 0.0]
        assert list(each(late, [])) == []
    with processes(1) as each:
        assert list(each(late, [0.0, 0.01])) == [0.0, 0.01]
        assert list(each(add, [3, 4], 1, 2)) == [6, 7]


def test_the_task_of_a_killed_worker_goes_to_another(client: Any, tmp_path: Path) -> None:
    """Check with the only worker killed, which holds what all tasks share; another replaces it."""
    process, = run_on_workers(client, die_once, [7], str(tmp_path))
    assert process != int((tmp_path / '7').read_text())


def test_a_line_reports_that_there_are_no_workers(tmp_path: Path) -> None:
    """Begin with none, lose the only one while it computes, and go on each time."""
    lines = list[str]()
    with LocalCluster(n_workers=0, processes=False, protocol='tcp', dashboard_address=None
                      ) as cluster, workers(1, cluster.scheduler_address) as client:
        def show(line: str) -> None:
            lines.append(line)
            cluster.scale(1)

        def lose() -> None:
            while not (tmp_path / 'begun').exists():
                time.sleep(0.01)
            cluster.scale(0)
            (tmp_path / 'lost').touch()
            cluster.scale(1)

        assert threads(client, show) > 0
        assert lines == [f'waiting for workers at {cluster.scheduler_address}']
        threading.Thread(target=lose).start()
        assert list(run_on_workers(client, until_there, [str(tmp_path / 'lost')],
                                   str(tmp_path / 'begun'))) == [2]


def test_workers_leave_interrupts_to_this_process(client: Any) -> None:
    """Check the mask of a worker, which is now one that replaced another."""
    (mask,) = client.run(lambda: signal.pthread_sigmask(signal.SIG_BLOCK, ())).values()
    assert signal.SIGINT in mask
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


@pytest.mark.slow
def test_a_task_that_kills_every_worker_ends_the_map() -> None:
    with (workers(2) as client, pytest.raises(CtcError, match='4 workers were killed while')):
        list(run_on_workers(client, die, [1]))


@pytest.mark.parametrize('address', ['nowhere', 'tcp://127.0.0.1:'])
def test_an_address_without_a_scheduler_is_refused(address: str) -> None:
    with pytest.raises(CtcError, match=f'--scheduler {address}: no scheduler answers: '):
        workers(1, address).__enter__()


def test_processes_that_do_not_start_are_reported_in_one_line(tmp_path: Path) -> None:
    """Take a script that ends where the processes that it starts run it again."""
    script = tmp_path / 'script.py'
    script.write_text('from multiprocessing import parent_process\n'
                      'if parent_process():\n    raise SystemExit(1)\n'
                      'from ctc_chattering.errors import CtcError\n'
                      'from ctc_chattering.runs.pool import workers\n'
                      'try:\n    workers(1).__enter__()\n'
                      'except CtcError as error:\n    print(error)\n')
    done = python(script)
    assert done.stdout.startswith('the processes that compute cannot be started: RuntimeError: ')
    assert done.stdout.count('\n') == 1
