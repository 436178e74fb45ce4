"""`ctc map`: the runs of a map that are missing, with progress, and what is made of all."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
import sys
import time

from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.cli.presentation import print_page
from ctc_chattering.cli.progress import progress_bar
from ctc_chattering.control.controller import Controller
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.robustness import chunks
from ctc_chattering.robustness.lock import locked
from ctc_chattering.robustness.runs import Runs
from ctc_chattering.robustness.shards import Directory, file_digest, TABLE
from ctc_chattering.simulation.registry import make_plant
from ctc_chattering.studies import pool
import pyarrow


def compute_map(runs: Runs, jobs: int, options: argparse.Namespace) -> int:
    """Compute what is missing of a map, write its results, and print where they are."""
    _try(runs)
    with locked(options.out):
        return _map(runs, jobs, options)


def _map(runs: Runs, jobs: int, options: argparse.Namespace) -> int:
    """Compute what is missing of a map, and write its results."""
    start, about = time.monotonic(), chunks.about(runs)
    parts = [(chunks.chunk_key(about['key'], part), part) for part in chunks.chunks(runs)]
    about.update(runs=len(runs), chunks=len(parts))
    directory, schema = Directory(options.out, about, options.overwrite), chunks.schema(runs.spec)
    todo = directory.missing(parts, schema, partial(print, flush=True))
    _announce(runs, len(parts), todo)
    if todo:
        _compute(runs, todo, directory, jobs, options.scheduler)
    table = directory.merge(parts, schema)
    counts = {name: _counts(table[name]) for name in ('engine', 'failure')}
    directory.describe({**about, 'engines': counts['engine'], 'failures': counts['failure'],
                        'computed_now': sum(len(part) for _, part in todo),
                        'seconds': round(time.monotonic() - start, 1),
                        'sha256': {TABLE: file_digest(options.out / TABLE)}})
    failed = sum(n for kind, n in counts['failure'].items() if kind)
    print(f'{len(table)} runs, {failed} failed, {time.monotonic() - start:.0f} s: '
          f'{options.out / TABLE}; drawing ...', flush=True)
    from ctc_chattering.robustness.report.report import write_report  # Matplotlib takes time.
    print_page(write_report(runs.spec, table, options.out))
    return 0


def _try(runs: Runs) -> None:
    """Make the robot and the controller of each law, so that what is missing shows here."""
    for i in range(len(runs.spec.variants)):
        setup = runs.example(i)
        make_plant(setup.plant, setup.descriptions.get('plant', ''))
        Controller(setup.controller, model_of(
            setup.controller, setup.descriptions.get('controller', '')))


def _announce(runs: Runs, count: int, todo: Sequence[tuple[str, range]]) -> None:
    """Print what will run, and what is there already."""
    print(f'{len(runs)} runs in {count} chunk{"s" * (count > 1)}')
    left = sum(len(part) for _, part in todo)
    if left < len(runs):
        print(f'{len(runs) - left} runs are there already')
    sys.stdout.flush()


def _compute(runs: Runs, todo: Sequence[tuple[str, range]], directory: Directory,
             jobs: int, address: str | None) -> None:
    """Compute what is missing, and write each chunk as it comes."""
    version, show = chunks.version(), partial(print, flush=True)
    if address is None:
        compile_setups(map(runs.example, range(len(runs.spec.variants))), show)
    with pool.workers(min(jobs, len(todo)), address) as client:
        count = pool.threads(client, show)
        print(f'{count} worker{"s" if count > 1 else ""}', flush=True)
        there = len(runs) - sum(len(part) for _, part in todo)
        with progress_bar(total=len(runs), initial=there, desc='map', unit='run') as bar:
            def ended(error: BaseException) -> str:
                return (f'{str(error) or "stopped"}; {bar.n} of {len(runs)} runs are in '
                        f'{directory.path}, the same command goes on')
            try:
                for key, table in pool.computed(
                        client, chunks.compute, (runs, version), todo,
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
