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

"""The runs of a map that are missing, and what is made of all."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.compilation import codes, compile_setups
from ctc_chattering.analysis.output import check_format
from ctc_chattering.analysis.tables import counted
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.errors import CtcError
from ctc_chattering.parameters import whole
from ctc_chattering.runs import pool, store
from ctc_chattering.runs.points import next_runs, Runs
from ctc_chattering.runs.spec import MapSpec, parse, read_spec
import pyarrow

#: Folder of the package's own specs, below `config`.
_FOLDER = 'maps'


def map_spec(spec: MapSpec | Mapping[str, Any] | str | Path) -> MapSpec:
    """Return what is run; argument and errors as of `compute_map`."""
    if isinstance(spec, MapSpec):
        return spec
    if isinstance(spec, Mapping):
        return parse(dict(spec), Path('map'))
    return read_spec(find_config(spec, folder=_FOLDER) if isinstance(spec, str) else spec)


def compute_map(spec: MapSpec | Mapping[str, Any] | str | Path, out: str | Path, jobs: int = 1,
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
    jobs = whole('jobs', jobs, 1)
    check_format(extra)
    runs, out = Runs(map_spec(spec)), Path(out)
    for i in range(len(runs.spec.variants)):  # What is missing shows here.
        codes(runs.example(i))
    with store.locked(out):
        directory = store.Directory(out, store.about(runs), store.schema(runs.spec), overwrite)
        table = _table(runs, directory, jobs, scheduler, show, progress or (lambda *_: None))
        failed = len(table) - table['failure'].to_pylist().count('')
        show(f'{len(table)} runs, {failed} failed: {out / store.TABLE}; drawing ...')
        from ctc_chattering.runs.map_page import write_report  # Takes time.
        write_report(runs.spec, table, out, extra, command)
    return table


def _table(runs: Runs, directory: store.Directory, jobs: int, scheduler: str | None,
           show: Callable[[str], None], progress: Callable[[int, int], None]) -> pyarrow.Table:
    """Compute the runs that are missing; return the rows of all."""
    rows, client = store.schema(runs.spec).empty_table(), None
    with ExitStack() as stack:
        while len(some := next_runs(runs, rows)):
            chunks = {directory.name(x): x for x in store.chunks(runs, some)}
            found = {name: directory.rows(x, show) for name, x in chunks.items()}
            left = [(name, x) for name, x in chunks.items() if found[name] is None]
            done = len(some) - sum(len(x) for _, x in left)
            show(f'{len(some)} runs in {counted(len(chunks), "chunk")}, {done} of them computed')
            if left and client is None:
                if scheduler is None:
                    compile_setups(map(runs.example, range(len(runs.spec.variants))), show)
                client = stack.enter_context(pool.workers(jobs, scheduler))
                show(counted(pool.threads(client, show), 'worker'))
            try:
                for (name, chunk), table in zip(left, pool.computed(
                        client, store.compute, [x for _, x in left], runs, store.version())
                        if client else ()):
                    directory.write(chunk, table)
                    found[name] = table
                    done += len(table)
                    progress(done, len(some))
            except (CtcError, KeyboardInterrupt) as error:
                raise (CtcError if isinstance(error, CtcError) else KeyboardInterrupt)(
                    f'{str(error) or "stopped"}; {done} of {len(some)} runs are in '
                    f'{directory.path}, run the same command to continue') from None
            rows = pyarrow.concat_tables([rows, *found.values()])
    return directory.merge(rows)
