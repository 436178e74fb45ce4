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

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack
from functools import partial
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.analysis.output import check_format
from ctc_chattering.arguments import checked, whole
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.control.controller import Controller
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.robustness import chunks
from ctc_chattering.robustness.lock import locked
from ctc_chattering.robustness.refinement import Refinement
from ctc_chattering.robustness.runs import Runs
from ctc_chattering.robustness.shards import Directory, file_digest, Part, TABLE
from ctc_chattering.robustness.spec import MapSpec, parse, read_spec
from ctc_chattering.simulation.registry import make_plant
from ctc_chattering.studies import pool
import pyarrow

if TYPE_CHECKING:
    from distributed import Client

#: Folder of the package's own specs, below `config`.
_FOLDER = 'maps'


def map_spec(spec: MapSpec | Mapping[str, Any] | str | Path) -> MapSpec:
    """Return what is run; argument and errors as of `compute_map`."""
    if isinstance(spec, MapSpec):
        return spec
    if isinstance(spec, Mapping):
        return parse(dict(spec), Path('map'))
    return read_spec(find_config(spec, folder=_FOLDER) if isinstance(spec, str) else spec)


@checked(spec=(MapSpec, Mapping, str, Path), out=(str, Path), scheduler=(str, type(None)),
         overwrite=bool, show=Callable, progress=(Callable, type(None)), extra=str,
         command=str)
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
    return Computation(Runs(map_spec(spec)), Path(out), jobs, scheduler, overwrite, show,
                       progress or (lambda *_: None)).table(extra, command)


class Computation:
    """
    The computation of a map; parameters as of `compute_map`.

    Parameters
    ----------
    runs : Runs
        Of the map.
    out : Path
        Directory.
    jobs, scheduler, overwrite, show, progress
        As of `compute_map`.

    """

    def __init__(self, runs: Runs, out: Path, jobs: int, scheduler: str | None, overwrite: bool,
                 show: Callable[[str], None], progress: Callable[[int, int], None]) -> None:
        self._runs, self._out, self._jobs, self._scheduler = runs, out, jobs, scheduler
        self._overwrite, self._show, self._progress = overwrite, show, progress

    def table(self, extra: str, command: str) -> pyarrow.Table:
        """Return the rows of all runs, after all files are written."""
        self._try()
        with locked(self._out):
            table = self._map()
            from ctc_chattering.robustness.report.report import write_report  # Takes time.
            write_report(self._runs.spec, table, self._out, extra, command)
            return table

    def _map(self) -> pyarrow.Table:
        """Compute what is missing of a map, and write its rows."""
        runs, out, start = self._runs, self._out, time.monotonic()
        about = chunks.about(runs)
        about['runs'] = len(runs)
        directory, schema = Directory(out, about, self._overwrite), chunks.schema(runs.spec)
        parts, computed = self._parts(directory)
        table = directory.merge(parts, schema)
        counts = {name: _counts(table[name]) for name in ('engine', 'failure')}
        directory.describe({**about, 'runs': len(table), 'chunks': len(parts),
                            'engines': counts['engine'], 'failures': counts['failure'],
                            **({'runs_of_grid': len(runs)} if runs.spec.refined else {}),
                            'computed_now': computed,
                            'seconds': round(time.monotonic() - start, 1),
                            'sha256': {TABLE: file_digest(out / TABLE)}})
        failed = sum(n for kind, n in counts['failure'].items() if kind)
        self._show(f'{len(table)} runs, {failed} failed, {time.monotonic() - start:.0f} s: '
                   f'{out / TABLE}; drawing ...')
        return table

    def _parts(self, directory: Directory) -> tuple[list[Part], int]:
        """Compute what is missing; return all chunks, and the number of runs computed now."""
        runs, parts, computed, client = self._runs, list[Part](), 0, None
        schema, key, refinement = chunks.schema(runs.spec), chunks.map_key(runs), Refinement(runs)
        with ExitStack() as stack:
            while (some := refinement.numbers()):
                mine = [(chunks.chunk_key(key, x), x) for x in chunks.chunks(runs, some)]
                todo = directory.missing(mine, schema, self._show)
                self._announce(mine, todo)
                if todo:
                    jobs = self._jobs if runs.spec.refined else min(self._jobs, len(todo))
                    client = client or stack.enter_context(self._workers(jobs))
                    self._compute(client, mine, todo, directory)
                parts += mine
                computed += _count(todo)
                refinement.take(partial(directory.rows, mine, schema))
        return parts, computed

    def _try(self) -> None:
        """Make the robot and the controller of each law, so that what is missing shows here."""
        for i in range(len(self._runs.spec.variants)):
            setup = self._runs.example(i)
            make_plant(setup.plant, setup.descriptions.get('plant', ''))
            Controller(setup.controller, model_of(
                setup.controller, setup.descriptions.get('controller', '')))

    def _announce(self, parts: Sequence[Part], todo: Sequence[Part]) -> None:
        """Say what will run, and what is there already."""
        count, left = len(parts), _count(todo)
        self._show(f'{_count(parts)} runs in {count} chunk{"s" * (count > 1)}')
        if left < _count(parts):
            self._show(f'{_count(parts) - left} runs are already computed')

    @contextmanager
    def _workers(self, jobs: int) -> Iterator[Client]:
        """Compile what runs need, if they run here, and yield a client of the workers."""
        runs = self._runs
        if self._scheduler is None:
            compile_setups(map(runs.example, range(len(runs.spec.variants))), self._show)
        with pool.workers(jobs, self._scheduler) as client:
            count = pool.threads(client, self._show)
            self._show(f'{count} worker{"s" if count > 1 else ""}')
            yield client

    def _compute(self, client: Client, parts: Sequence[Part], todo: Sequence[Part],
                 directory: Directory) -> None:
        """Compute what is missing of chunks, and write each as it comes."""
        total = _count(parts)
        done = total - _count(todo)

        def ended(error: BaseException) -> str:
            return (f'{str(error) or "stopped"}; {done} of {total} runs are in '
                    f'{directory.path}, run the same command to continue')
        try:
            self._progress(done, total)
            for key, table in pool.computed(
                    client, chunks.compute, (self._runs, chunks.version()), todo):
                directory.write(key, table)
                done += len(table)
                self._progress(done, total)
        except CtcError as error:
            raise CtcError(ended(error)) from None
        except KeyboardInterrupt as error:
            raise KeyboardInterrupt(ended(error)) from None


def _count(parts: Sequence[Part]) -> int:
    """Return the number of runs of chunks."""
    return sum(len(part) for _, part in parts)


def _counts(column: pyarrow.ChunkedArray) -> dict[str, int]:
    """Return how often each text is in a column."""
    return dict(sorted((x['values'], x['counts']) for x in column.value_counts().to_pylist()))
