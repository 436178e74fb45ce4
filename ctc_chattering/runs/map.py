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

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, ExitStack
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.analysis.output import check_format
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.control.controller import Controller
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.parameters import whole
from ctc_chattering.runs import pool, store
from ctc_chattering.runs.points import Refinement, Runs
from ctc_chattering.runs.spec import MapSpec, parse, read_spec
from ctc_chattering.simulation.plant import make_plant
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
    runs, out, start = Runs(map_spec(spec)), Path(out), time.monotonic()
    for i in range(len(runs.spec.variants)):  # What is missing shows here.
        setup = runs.example(i)
        make_plant(setup.plant, setup.descriptions.get('plant', ''))
        Controller(setup.controller, model_of(
            setup.controller, setup.descriptions.get('controller', '')))
    with store.locked(out):
        about = store.about(runs)
        directory = store.Directory(out, about, store.schema(runs.spec), overwrite)
        computation = Computation(runs, directory, jobs, scheduler, show,
                                  progress or (lambda *_: None))
        table = computation.table()
        failures = Counter(table['failure'].to_pylist())
        directory.describe({
            **about, 'runs': len(table), 'runs_of_grid': len(runs), 'failures': failures,
            'engines': Counter(table['engine'].to_pylist()), 'computed_now': computation.computed,
            'seconds': round(time.monotonic() - start, 1)})
        show(f'{len(table)} runs, {len(table) - failures[""]} failed, '
             f'{time.monotonic() - start:.0f} s: {out / store.TABLE}; drawing ...')
        from ctc_chattering.runs.map_page import write_report  # Takes time.
        write_report(runs.spec, table, out, extra, command)
    return table


class Computation:
    """
    The runs of a map that are missing; parameters as of `compute_map`.

    Attributes
    ----------
    computed : int
        Number of runs computed now.

    """

    def __init__(self, runs: Runs, directory: store.Directory, jobs: int, scheduler: str | None,
                 show: Callable[[str], None], progress: Callable[[int, int], None]) -> None:
        self._runs, self._directory, self._jobs = runs, directory, jobs
        self._scheduler, self._show, self._progress = scheduler, show, progress
        self.computed = 0

    def table(self) -> pyarrow.Table:
        """Compute what is missing; write and return the rows of all runs."""
        parts, client = list[pyarrow.Table](), None
        refinement = Refinement(self._runs)
        with ExitStack() as stack:
            while len(some := refinement.numbers()):
                chunks = {self._directory.name(x): x for x in store.chunks(self._runs, some)}
                there = {name: table for name, chunk in chunks.items() if (
                    table := self._directory.rows(chunk, self._show)) is not None}
                left = {name: x for name, x in chunks.items() if name not in there}
                done = sum(map(len, there.values()))
                self._show(f'{len(some)} runs in {len(chunks)} chunk{"s" * (len(chunks) > 1)}')
                if done:
                    self._show(f'{done} runs are already computed')
                if left:
                    client = client or stack.enter_context(self._workers())
                    there |= self._computed(client, left, done, len(some))
                mine = pyarrow.concat_tables(there[name] for name in chunks)
                refinement.take(mine)
                parts.append(mine)
        return self._directory.merge(parts)

    @contextmanager
    def _workers(self) -> Iterator[Client]:
        """Compile what runs need, if they run here, and yield a client of the workers."""
        runs = self._runs
        if self._scheduler is None:
            compile_setups(map(runs.example, range(len(runs.spec.variants))), self._show)
        with pool.workers(self._jobs, self._scheduler) as client:
            count = pool.threads(client, self._show)
            self._show(f'{count} worker{"s" if count > 1 else ""}')
            yield client

    def _computed(self, client: Client, left: Mapping[str, store.Numbers], done: int, total: int
                  ) -> dict[str, pyarrow.Table]:
        """Compute the chunks that are left, and write each as it comes."""
        found = dict[str, pyarrow.Table]()

        def ended(error: BaseException) -> str:
            return (f'{str(error) or "stopped"}; {done} of {total} runs are in '
                    f'{self._directory.path}, run the same command to continue')
        try:
            self._progress(done, total)
            for name, table in pool.computed(
                    client, store.compute, (self._runs, store.version()), left.items()):
                found[name] = table
                self._directory.write(left[name], table)
                done += len(table)
                self.computed += len(table)
                self._progress(done, total)
        except CtcError as error:
            raise CtcError(ended(error)) from None
        except KeyboardInterrupt as error:
            raise KeyboardInterrupt(ended(error)) from None
        return found
