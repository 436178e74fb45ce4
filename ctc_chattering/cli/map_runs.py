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

"""`ctc map`: the runs of a map that are missing, with progress, and what is made of all."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, ExitStack
from functools import partial
import sys
import time
from typing import TYPE_CHECKING

from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.cli.presentation import print_page
from ctc_chattering.cli.progress import progress_bar
from ctc_chattering.control.controller import Controller
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.robustness import chunks
from ctc_chattering.robustness.lock import locked
from ctc_chattering.robustness.refinement import Refinement
from ctc_chattering.robustness.runs import Runs
from ctc_chattering.robustness.shards import Directory, file_digest, Part, TABLE
from ctc_chattering.simulation.registry import make_plant
from ctc_chattering.studies import pool
import pyarrow

if TYPE_CHECKING:
    from distributed import Client


def compute_map(runs: Runs, jobs: int, options: argparse.Namespace) -> int:
    """Compute what is missing of a map, write its results, and print where they are."""
    _try(runs)
    with locked(options.out):
        return _map(runs, jobs, options)


def _map(runs: Runs, jobs: int, options: argparse.Namespace) -> int:
    """Compute what is missing of a map, and write its results."""
    start, about = time.monotonic(), chunks.about(runs)
    about['runs'] = len(runs)
    directory, schema = Directory(options.out, about, options.overwrite), chunks.schema(runs.spec)
    parts, computed = _parts(runs, directory, jobs, options.scheduler)
    table = directory.merge(parts, schema)
    counts = {name: _counts(table[name]) for name in ('engine', 'failure')}
    directory.describe({**about, 'runs': len(table), 'chunks': len(parts),
                        'engines': counts['engine'], 'failures': counts['failure'],
                        **({'runs_of_grid': len(runs)} if runs.spec.refined else {}),
                        'computed_now': computed,
                        'seconds': round(time.monotonic() - start, 1),
                        'sha256': {TABLE: file_digest(options.out / TABLE)}})
    failed = sum(n for kind, n in counts['failure'].items() if kind)
    print(f'{len(table)} runs, {failed} failed, {time.monotonic() - start:.0f} s: '
          f'{options.out / TABLE}; drawing ...', flush=True)
    from ctc_chattering.robustness.report.report import write_report  # Matplotlib takes time.
    print_page(write_report(runs.spec, table, options.out, options.format, options.said))
    return 0


def _parts(runs: Runs, directory: Directory, jobs: int, address: str | None
           ) -> tuple[list[Part], int]:
    """Compute what is missing; return all chunks, and the number of runs computed now."""
    parts: list[Part] = []
    computed, schema, key, client = 0, chunks.schema(runs.spec), chunks.map_key(runs), None
    refinement = Refinement(runs)
    with ExitStack() as stack:
        while (some := refinement.numbers()):
            mine = [(chunks.chunk_key(key, x), x) for x in chunks.chunks(runs, some)]
            todo = directory.missing(mine, schema, partial(print, flush=True))
            _announce(mine, todo)
            if todo:
                client = client or stack.enter_context(_workers(
                    runs, jobs if runs.spec.refined else min(jobs, len(todo)), address))
                _compute(runs, client, mine, todo, directory)
            parts += mine
            computed += _count(todo)
            refinement.take(partial(directory.rows, mine, schema))
    return parts, computed


def _try(runs: Runs) -> None:
    """Make the robot and the controller of each law, so that what is missing shows here."""
    for i in range(len(runs.spec.variants)):
        setup = runs.example(i)
        make_plant(setup.plant, setup.descriptions.get('plant', ''))
        Controller(setup.controller, model_of(
            setup.controller, setup.descriptions.get('controller', '')))


def _announce(parts: Sequence[Part], todo: Sequence[Part]) -> None:
    """Print what will run, and what is there already."""
    count, left = len(parts), _count(todo)
    print(f'{_count(parts)} runs in {count} chunk{"s" * (count > 1)}')
    if left < _count(parts):
        print(f'{_count(parts) - left} runs are there already')
    sys.stdout.flush()


def _count(parts: Sequence[Part]) -> int:
    """Return the number of runs of chunks."""
    return sum(len(part) for _, part in parts)


@contextmanager
def _workers(runs: Runs, jobs: int, address: str | None) -> Iterator[Client]:
    """Compile what runs need, if they run here, and yield a client of the workers."""
    show = partial(print, flush=True)
    if address is None:
        compile_setups(map(runs.example, range(len(runs.spec.variants))), show)
    with pool.workers(jobs, address) as client:
        count = pool.threads(client, show)
        print(f'{count} worker{"s" if count > 1 else ""}', flush=True)
        yield client


def _compute(runs: Runs, client: Client, parts: Sequence[Part], todo: Sequence[Part],
             directory: Directory) -> None:
    """Compute what is missing of chunks, and write each as it comes."""
    total = _count(parts)
    with progress_bar(total=total, initial=total - _count(todo), desc='map', unit='run') as bar:
        def ended(error: BaseException) -> str:
            return (f'{str(error) or "stopped"}; {bar.n} of {total} runs are in '
                    f'{directory.path}, the same command goes on')
        try:
            for key, table in pool.computed(
                    client, chunks.compute, (runs, chunks.version()), todo,
                    partial(bar.write, file=sys.stderr)):
                directory.write(key, table)
                bar.update(len(table))
        except CtcError as error:
            raise CtcError(ended(error)) from None
        except KeyboardInterrupt as error:
            raise KeyboardInterrupt(ended(error)) from None


def _counts(column: pyarrow.ChunkedArray) -> dict[str, int]:
    """Return how often each text is in a column."""
    return dict(sorted((x['values'], x['counts']) for x in column.value_counts().to_pylist()))
