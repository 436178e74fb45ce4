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

"""
Maps: laws over grids and draws of parameters.

`ctc map` calls `compute_map`, which reads a spec, runs it and writes tables, figures and page.
`complete_table` computes the missing rows of any list of runs: `compare` and `tune` use it, too.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, ExitStack
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from ctc_chattering.configuration.compilation import compile_setups, required_codes
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.errors import CtcError
from ctc_chattering.number_format import format_count
from ctc_chattering.output_files import check_format
from ctc_chattering.output_folder import OutputFolder
from ctc_chattering.parameters import checked_integer
from ctc_chattering.runs import cluster, pool, store
from ctc_chattering.runs.run_lists import MapRuns, RunList
from ctc_chattering.runs.spec import MapSpec, parse_spec, read_spec
from ctc_chattering.runs.store import Numbers
import pyarrow


def map_spec(spec: Mapping[str, Any] | str | Path) -> MapSpec:
    """Read the spec that `compute_map` takes."""
    if isinstance(spec, Mapping):
        return parse_spec(dict(spec), Path('map'))
    return read_spec(find_config(spec, folder='maps') if isinstance(spec, str) else spec)


def compute_map(spec: Mapping[str, Any] | str | Path, out: str | Path, jobs: int = 1,
                scheduler: str | None = None, overwrite: bool = False,
                show: Callable[[str], None] = print,
                progress: Callable[[int, int], None] | None = None, extra: str = 'svg',
                command: str = '') -> pyarrow.Table:
    """
    Run laws over grids and draws of parameters.

    The results show which law fails where.

    Runs that an earlier call has written for the same map are kept.

    Parameters
    ----------
    spec : mapping, str or Path
        Spec as in docs/maps.md, or the path or name of its file.
    out : str or Path
        Directory for ``map.parquet``, ``map.json``, ``figures`` and ``index.html``. The table has
        a row a run, and pandas and polars read it.
    jobs : int
        Processes that compute. A script needs ``if __name__ == '__main__'``.
    scheduler : str, optional
        Address of a dask cluster, ``tcp://host:port``, in place of these processes.
    overwrite : bool
        Replace the files of another map.
    show : callable
        Takes lines about compilation and progress.
    progress : callable, optional
        Called with the number of finished runs, and of all.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        Command line, for the page.

    Returns
    -------
    pyarrow.Table
        Rows of ``map.parquet``. ``polars.from_arrow`` takes them.

    Raises
    ------
    CtcError
        If an argument or a value of the spec is not allowed, before anything is run. If another
        map is in the directory, or workers are lost.

    """
    jobs = checked_integer('jobs', jobs, 1)
    check_format(extra)
    runs, out = MapRuns(map_spec(spec)), Path(out)
    with complete_table(runs, out, jobs, scheduler, overwrite, show, progress) as result:
        table = result.table
        failed = len(table) - table['failure'].to_pylist().count('')
        show(f'{len(table)} runs, {failed} failed: {out / store.TABLE}; drawing ...')
        from ctc_chattering.runs.map_page import write_report  # Takes time.
        with result.folder.replacing_files() as folder:
            write_report(runs.spec, table, folder, extra, command)
    return table


class CompleteTable(NamedTuple):
    """All rows of a table, with their folder."""

    table: pyarrow.Table
    folder: OutputFolder


@contextmanager
def complete_table(runs: RunList, out: Path | None, jobs: int, scheduler: str | None,
                   overwrite: bool, show: Callable[[str], None],
                   progress: Callable[[int, int], None] | None) -> Iterator[CompleteTable]:
    """
    Compute the missing runs of a directory.

    Nothing is kept without a directory. No other process writes there until the context ends.
    Arguments and errors are those of `compute_map`.
    """
    required_codes(runs.robot)  # An error of the robot shows here.
    with ExitStack() as stack:
        path = out or Path(stack.enter_context(TemporaryDirectory()))
        columns = store.table_schema(runs)
        directory = stack.enter_context(store.open_directory(
            path, store.table_metadata(runs), columns, overwrite, runs.command))
        rows = columns.empty_table()
        execute = None
        while len(numbers := runs.next_runs(rows)):
            chunks = {directory.file(chunk): chunk for chunk in store.chunks(runs, numbers)}
            tables = {file: directory.rows(chunk, show) for file, chunk in chunks.items()}
            missing = {file: chunks[file] for file, table in tables.items() if table is None}
            finished = len(numbers) - sum(map(len, missing.values()))
            show(f'{len(numbers)} runs in {format_count(len(chunks), "chunk")}, '
                 f'{finished} of them computed')
            if missing and execute is None:
                execute = _executor(stack, runs, jobs, scheduler, show)
            try:
                for file, table in zip(missing, execute(missing.values()) if execute else ()):
                    directory.write(table, file)
                    tables[file] = table
                    finished += len(table)
                    if progress is not None:
                        progress(finished, len(numbers))
            except (CtcError, KeyboardInterrupt) as error:
                error_type = CtcError if isinstance(error, CtcError) else KeyboardInterrupt
                location = (f'in {directory.path}, run the same command to continue' if out
                            else 'done')
                raise error_type(f'{str(error) or "stopped"}; {finished} of {len(numbers)} runs '
                                 f'are {location}') from None
            rows = pyarrow.concat_tables([rows, *tables.values()])
        yield CompleteTable(directory.merge(rows), directory.folder)


def _executor(stack: ExitStack, runs: RunList, jobs: int, scheduler: str | None,
              show: Callable[[str], None]
              ) -> Callable[[Collection[Numbers]], Iterator[pyarrow.Table]]:
    """Return a function that computes chunks until `stack` ends."""
    if scheduler is not None:
        client = stack.enter_context(cluster.connect_cluster(scheduler))
        show(format_count(pool.threads(client, show), 'worker'))
        return partial(cluster.run_on_cluster, client, runs)
    compile_setups(runs.examples(), show)
    if jobs == 1:
        return lambda chunks: pool.run_serially(store.compute, chunks, runs, '')
    client = stack.enter_context(pool.workers(jobs))
    show(format_count(pool.threads(client, show), 'worker'))
    return lambda chunks: pool.run_on_workers(client, store.compute, chunks, runs, '')
