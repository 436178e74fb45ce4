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

"""All laws on any robot and plant, under conditions, with gains of the file or by rule."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
import json
from pathlib import Path
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Overrides, Setup
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.control.laws.registry import LAWS, switchings_of
from ctc_chattering.errors import CtcError, ParameterError, suggest
from ctc_chattering.output_files import check_format, finite
from ctc_chattering.parameters import check_not_empty, checked_integer
from ctc_chattering.runs.conditions import chosen, Condition, HeldOut, read_cases, SEED
from ctc_chattering.runs.conditions import held_out as drawn
from ctc_chattering.runs.map import computed
from ctc_chattering.runs.points import Points
from ctc_chattering.runs.recommended import (
    BASE,
    BEST,
    FILE,
    GAINS,
    gains_by_rule,
    RECOMMENDED,
    Variant,
)
from ctc_chattering.runs.score import over_simulation, Runner
import pandas  # type: ignore[import-untyped]


def variants(laws: Sequence[str] = LAWS, gains: str = FILE) -> list[Variant]:
    """Return the rows of a table: `BASE`, all laws and switchings, and what is recommended."""
    found = [Variant(law, switching, gains) for law in LAWS if law in laws for switching in (
        switchings_of(law) or ('',))]
    if BEST.law in laws:
        found.append(BEST)
    return list(dict.fromkeys([BASE, *found]))


def tasks(paths: Iterable[Path], conditions: Sequence[str], laws: Sequence[str] = LAWS,
          gains: str = FILE, more: Sequence[Condition] = ()
          ) -> Iterator[tuple[dict[str, Any], Setup]]:
    """
    Yield what to run: every variant on every robot under every condition.

    Parameters
    ----------
    paths : iterable of Path
        Parameter files.
    conditions : sequence of str
        Names, `ALL` for each that the robot can have, '' for the robot as it is in the file.
    laws, gains
        As `variants` has them.
    more : sequence of Condition
        Further conditions: cases, then those held out.

    Yields
    ------
    columns : dict
        Which run it is; names of joints and parameters of the controller as JSON has them. `part`
        tells the runs of a condition that has several.
    setup : Setup
        What is run.

    """
    for path in paths:
        file = parameter_file.load(path)
        for condition in (*chosen(conditions, file), *more):
            under = condition.overrides(file)
            for variant in variants(laws, gains):
                values = variant.values
                if variant.settings == RECOMMENDED:
                    values |= gains_by_rule(parameter_file.load(
                        path, merged(under[0], {'controller': values})))
                for factor, run in zip(condition.factors, under):
                    run = merged(run, {'controller': values})
                    setup = parameter_file.load(path, run)
                    if setup.plant.duration == 0.0:
                        raise ParameterError(f'{path}: duration', 0.0,
                                             'a number > 0, for every run must end')
                    yield {
                        'file': str(path), 'experiment': setup.plant.experiment,
                        'condition': condition.name,
                        'held_out': int(isinstance(condition, HeldOut)), **variant._asdict(),
                        'part': f'model_{factor:g}' if len(under) > 1 else '',
                        'joints': json.dumps(setup.plant.joint_names), 'controller': json.dumps(
                            finite(run['controller']), sort_keys=True)}, setup


def merged(*parts: Overrides) -> Overrides:
    """Return overrides by node and parameter; later ones win."""
    nodes = dict.fromkeys(node for part in parts for node in part)
    return {node: {name: value for part in parts for name, value in part.get(node, {}).items()}
            for node in nodes}


class Comparison(Points):
    """The runs of `tasks`."""

    def row(self, run: int, runner: Runner = over_simulation) -> dict[str, Any]:
        """Return the row of a run; raise `CtcError` if `BASE` has no numbers."""
        x = super().row(run, runner)
        if x['failure'] and not x['held_out'] and (x['law'], x['settings']) == (BASE.law, FILE):
            raise CtcError(f'{x["file"]}: {x["reason"]}')
        return x


def compare(files: Sequence[str | Path], laws: Sequence[str] = LAWS,
            conditions: Sequence[str] = (), gains: str = FILE, held_out: int = 0,
            seed: int = SEED, jobs: int = 1,
            show: Callable[[str], None] = print,
            progress: Callable[[int, int], None] | None = None, cases: str | Path = '',
            out: str | Path | None = None, overwrite: bool = False, extra: str = 'svg',
            command: str = '') -> pandas.DataFrame:
    """
    Run parameter files with every law and, under law chattering, every switching.

    Parameters
    ----------
    files : sequence of str or Path
        Parameter files, or names of those of the package.
    laws : sequence of str
        Laws to run.
    conditions : sequence of str
        Drives, sensors and model error in place of those of the files; ``all`` for each that the
        robot can have.
    gains : {'file', 'recommended'}
        Gains of the file, or of each law by its rule in what the controller knows.
    held_out : int
        Further conditions, drawn, in which all laws are judged.
    seed : int
        Of these.
    jobs : int
        Processes; with more than 1 a script needs ``if __name__ == '__main__'``.
    show : callable
        Takes lines about what is compiled and done.
    progress : callable, optional
        Called with the number of runs that are there, and of all.
    cases : str or Path
        File of further conditions, or the name of one in the package, ``imperfections``.
    out : str or Path, optional
        Directory for ``compare.parquet``, a row a run, ``compare.json``, ``compare.md``,
        ``compare.csv``, ``figures``, ``index.html``, and ``parameters``, a file of every run. What
        is there of the same comparison is not computed again.
    overwrite : bool
        Replace what another comparison has written there.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        What was run, for the page.

    Returns
    -------
    pandas.DataFrame
        The rows of ``compare.parquet``: law, condition, and which of its runs (`part`), then the
        columns of a map.

    Raises
    ------
    CtcError
        If an argument is not allowed, before anything is run; if the law to which all others
        are compared has no numbers; or if another comparison is in the directory.

    """
    for name in laws:
        if name not in LAWS:
            raise ParameterError('laws', name, ' | '.join(LAWS) + suggest(name, LAWS))
    if gains not in GAINS:
        raise ParameterError('gains', gains, ' | '.join(GAINS))
    check_not_empty('files', files)
    check_format(extra)
    jobs = checked_integer('jobs', jobs, 1)
    paths = [find_config(x) if isinstance(x, str) else x for x in files]
    given = read_cases(find_config(str(cases), folder='cases')) if str(cases) else ()
    draws = drawn(checked_integer('held_out', held_out, 0), checked_integer('seed', seed, 0))
    runs = Comparison(tasks(
        paths, conditions or ([] if given else ['']), laws, gains, (*given, *draws)))
    path = Path(out) if out else None
    with computed(runs, path, jobs, None, overwrite, show, progress) as made:
        rows = made.table.to_pandas()
        if path:
            from ctc_chattering.runs.compare_page import write_comparison  # Takes time.
            with made.folder.replacing_files() as folder:
                write_comparison(runs, rows, folder, extra, command)
    return rows
