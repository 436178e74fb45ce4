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

"""The runs of a table that are missing; maps."""

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
from ctc_chattering.runs.points import Points, Runs
from ctc_chattering.runs.spec import MapSpec, parse, read_spec
from ctc_chattering.runs.store import Numbers
import pyarrow

#: Folder of the package's own specs, below `config`.
_FOLDER = 'maps'


def map_spec(spec: Mapping[str, Any] | str | Path) -> MapSpec:
    """Return what is run; argument and errors as of `compute_map`."""
    if isinstance(spec, Mapping):
        return parse(dict(spec), Path('map'))
    return read_spec(find_config(spec, folder=_FOLDER) if isinstance(spec, str) else spec)


def compute_map(spec: Mapping[str, Any] | str | Path, out: str | Path, jobs: int = 1,
                scheduler: str | None = None, overwrite: bool = False,
                show: Callable[[str], None] = print,
                progress: Callable[[int, int], None] | None = None, extra: str = 'svg',
                command: str = '') -> pyarrow.Table:
    """
    Run laws over grids and draws of parameters: which fails where.

    What is in the directory of the same map is not computed again.

    Parameters
    ----------
    spec : mapping, str or Path
        What to run, as docs/maps.md has it, or a path or name of a file with it.
    out : str or Path
        Directory for ``map.parquet``, a row a run, which pandas and polars read; ``map.json``,
        ``figures`` and ``index.html``.
    jobs : int
        Processes that compute; a script needs ``if __name__ == '__main__'``.
    scheduler : str, optional
        Address of a dask cluster, ``tcp://host:port``, in place of them.
    overwrite : bool
        Replace what another map has written there.
    show : callable
        Takes lines about what is compiled and done.
    progress : callable, optional
        Called with the number of runs that are there, and of all.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        What was run, for the page.

    Returns
    -------
    pyarrow.Table
        The rows of ``map.parquet``; ``polars.from_arrow`` takes it.

    Raises
    ------
    CtcError
        If an argument, or something in the spec, is not allowed, before anything is run; if
        another map is in the directory, or workers are lost.

    """
    jobs = checked_integer('jobs', jobs, 1)
    check_format(extra)
    runs, out = Runs(map_spec(spec)), Path(out)
    with computed(runs, out, jobs, scheduler, overwrite, show, progress) as made:
        table = made.table
        failed = len(table) - table['failure'].to_pylist().count('')
        show(f'{len(table)} runs, {failed} failed: {out / store.TABLE}; drawing ...')
        from ctc_chattering.runs.map_page import write_report  # Takes time.
        with made.folder.replacing_files() as folder:
            write_report(runs.spec, table, folder, extra, command)
    return table


class Computed(NamedTuple):
    """All rows of a table, and the folder that has it."""

    table: pyarrow.Table
    folder: OutputFolder


@contextmanager
def computed(points: Points, out: Path | None, jobs: int, scheduler: str | None, overwrite: bool,
             show: Callable[[str], None], progress: Callable[[int, int], None] | None
             ) -> Iterator[Computed]:
    """
    Compute the runs that are missing in a directory, of which None keeps nothing.

    Until the end of the context no other process writes there; arguments and errors as of
    `compute_map`.
    """
    required_codes(points.robot)  # What is missing shows here.
    with ExitStack() as stack:
        path = out or Path(stack.enter_context(TemporaryDirectory()))
        directory = stack.enter_context(store.opened(
            path, store.about(points), store.schema(points), overwrite, points.kind))
        rows, compute = store.schema(points).empty_table(), None
        while len(some := points.next_runs(rows)):
            chunks = {directory.file(x): x for x in store.chunks(points, some)}
            found = {file: directory.rows(x, show) for file, x in chunks.items()}
            left = {file: x for file, x in chunks.items() if found[file] is None}
            done = len(some) - sum(map(len, left.values()))
            show(f'{len(some)} runs in {format_count(len(chunks), "chunk")}, '
                 f'{done} of them computed')
            if left and compute is None:
                compute = _compute(stack, points, jobs, scheduler, show)
            try:
                for file, table in zip(left, compute(left.values()) if compute else ()):
                    directory.write(table, file)
                    found[file] = table
                    done += len(table)
                    if progress is not None:
                        progress(done, len(some))
            except (CtcError, KeyboardInterrupt) as error:
                where = (f'in {directory.path}, run the same command to continue' if out
                         else 'done')
                raise (CtcError if isinstance(error, CtcError) else KeyboardInterrupt)(
                    f'{str(error) or "stopped"}; {done} of {len(some)} runs are {where}') from None
            rows = pyarrow.concat_tables([rows, *found.values()])
        yield Computed(directory.merge(rows), directory.folder)


def _compute(stack: ExitStack, points: Points, jobs: int, scheduler: str | None,
             show: Callable[[str], None]
             ) -> Callable[[Collection[Numbers]], Iterator[pyarrow.Table]]:
    """Return what computes the rows of chunks; its processes end with `stack`."""
    if scheduler is not None:
        client = stack.enter_context(cluster.connected(scheduler))
        show(format_count(pool.threads(client, show), 'worker'))
        return partial(cluster.computed, client, points)
    compile_setups(points.examples(), show)
    if jobs == 1:
        return lambda chunks: pool.serially(store.compute, chunks, points, '')
    client = stack.enter_context(pool.workers(jobs))
    show(format_count(pool.threads(client, show), 'worker'))
    return lambda chunks: pool.computed(client, store.compute, chunks, points, '')
