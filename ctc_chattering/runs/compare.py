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
Comparison of all laws on any robot, under conditions.

`ctc compare` calls `compare`. A `ComparisonSpec` lists the runs, `run_lists` and `store` make
their rows, and `compare_page` writes tables and page.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import dataclasses
from itertools import groupby
import json
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.result import Result
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.control.laws.registry import LAWS, switchings_of
from ctc_chattering.errors import CtcError, ParameterError, prefixed, suggest
from ctc_chattering.output_files import check_format, finite
from ctc_chattering.parameters import check_not_empty, checked_integer
from ctc_chattering.runs.conditions import (
    Case,
    held_out_cases,
    learning_setup,
    merge_overrides,
    named_cases,
    read_cases,
    SEED,
)
from ctc_chattering.runs.map import complete_table
from ctc_chattering.runs.recommended import (
    BASELINE,
    BEST,
    FILE,
    GAIN_SOURCES,
    gains_by_rule,
    LawSettings,
)
from ctc_chattering.runs.run_lists import ListedRun, RunList
from ctc_chattering.runs.score import pass_columns, Runner, simulate_truth
import pandas  # type: ignore[import-untyped]


@dataclasses.dataclass(frozen=True)
class ComparisonSpec:
    """
    Robots, laws and conditions of a comparison.

    Attributes
    ----------
    files : sequence of str or Path
        Parameter files, or names of those of the package.
    laws : sequence of str
        Laws to run, each under every switching that it has.
    conditions : sequence of str
        Names of conditions in place of those of the files. ``all`` stands for each that the robot
        can have, '' for the robot of the file.
    gains : {'file', 'recommended'}
        Gains of the file, or of each law by its rule in what the controller knows.
    held_out : int
        Number of drawn conditions in which all laws are judged.
    seed : int
        Of these.
    cases : str or Path
        File of further conditions, or the name of one in the package, ``imperfections``.
    passes : int
        Number of passes of the motion from which each law learns a correction, 0 for none.

    Raises
    ------
    CtcError
        If a value is not allowed.

    """

    files: Sequence[str | Path]
    laws: Sequence[str] = LAWS
    conditions: Sequence[str] = ()
    gains: str = FILE
    held_out: int = 0
    seed: int = SEED
    cases: str | Path = ''
    passes: int = 0

    def __post_init__(self) -> None:
        """Check all values that need no file."""
        for name in self.laws:
            if name not in LAWS:
                raise ParameterError('laws', name, ' | '.join(LAWS) + suggest(name, LAWS))
        if self.gains not in GAIN_SOURCES:
            raise ParameterError('gains', self.gains, ' | '.join(GAIN_SOURCES))
        check_not_empty('files', self.files)
        checked_integer('held_out', self.held_out, 0)
        checked_integer('seed', self.seed, 0)
        checked_integer('passes', self.passes, 0)

    @property
    def law_settings(self) -> list[LawSettings]:
        """Laws of a table: `BASELINE`, the chosen ones, `BEST`."""
        chosen = [LawSettings(law, switching, self.gains) for law in LAWS if law in self.laws
                  for switching in switchings_of(law) or ('',)]
        best = [BEST] if BEST.law in self.laws else []
        return list(dict.fromkeys([BASELINE, *chosen, *best]))

    def runs(self) -> Iterator[ListedRun]:
        """Yield the runs of all laws, robots and cases."""
        for file in self.files:
            path = find_config(file) if isinstance(file, str) else file
            cases = self.robot_cases(parameter_file.load(path))
            for _, group in groupby(cases, key=lambda case: case.title):
                condition = list(group)
                for law in self.law_settings:
                    yield from _condition_runs(path, condition, law, self.passes)

    def robot_cases(self, setup: Setup) -> list[Case]:
        """Return all cases of a parameter file's robot."""
        listed = read_cases(find_config(str(self.cases), folder='cases')) if str(
            self.cases) else ()
        names = self.conditions or ([] if listed else [''])
        return [*named_cases(names, setup), *listed,
                *held_out_cases(setup, self.held_out, self.seed)]


def _condition_runs(path: Path, condition: Sequence[Case], law: LawSettings, passes: int
                    ) -> Iterator[ListedRun]:
    """
    Yield the runs of a law under one condition.

    Gains by rule are those of the first case. `part` tells the cases, and the parameters of the
    controller are a column of JSON.
    """
    values = law.parameters
    if law.is_recommended:
        values |= gains_by_rule(parameter_file.load(
            path, merge_overrides(condition[0].overrides, {'controller': values})))
    for case in condition:
        overrides = merge_overrides(case.overrides, {'controller': values})
        setup = parameter_file.load(path, overrides)
        if setup.plant.duration == 0.0:
            raise ParameterError(
                f'{path}: duration', 0.0, 'a number > 0, since every run must end')
        if passes:
            with prefixed(': '.join([str(path), *filter(None, [case.title]), ''])):
                setup = learning_setup(setup, passes)
        yield ListedRun({
            'file': str(path), 'experiment': setup.plant.experiment, 'condition': case.title,
            'held_out': int(case.is_held_out), **law.columns, 'part': case.run_name,
            'passes': passes, 'passes_of_run': '[]', 'learning': '',
            'joints': json.dumps(setup.plant.joint_names),
            'controller': json.dumps(finite(overrides['controller']), sort_keys=True)}, setup)


class ComparisonRuns(RunList):
    """Runs of a comparison."""

    def row(self, run: int, runner: Runner = simulate_truth) -> dict[str, Any]:
        """
        Return the row of a run.

        Raise `CtcError` if `BASELINE` has no numbers.
        """
        passes = self.listed[run].columns['passes']
        learned: dict[str, str] = {}

        def run_passes(setup: Setup) -> Result:
            result = runner(setup)
            without = runner(setup.changed({'reference': {'learning': False}}))
            learned.update(pass_columns(result, without.run, passes))
            return result

        row = super().row(run, run_passes if passes else runner) | learned
        is_baseline = (row['law'], row['settings']) == (BASELINE.law, FILE)
        if row['failure'] and is_baseline and not row['held_out']:
            raise CtcError(f'{row["file"]}: {row["reason"]}')
        return row


def compare(files: ComparisonSpec | Sequence[str | Path], *, out: str | Path | None = None,
            jobs: int = 1, overwrite: bool = False, show: Callable[[str], None] = print,
            progress: Callable[[int, int], None] | None = None, extra: str = 'svg',
            command: str = '', **choices: Any) -> pandas.DataFrame:
    """
    Run parameter files with every law and, under law chattering, every switching.

    Parameters
    ----------
    files : sequence of str or Path, or ComparisonSpec
        Parameter files, or names of those of the package. A spec stands for all that is run.
    out : str or Path, optional
        Directory for ``compare.parquet``, a row a run, ``compare.json``, ``compare.md``,
        ``compare.csv``, ``figures``, ``index.html``, and ``parameters``, a file of every run. Runs
        of the same comparison that are there are not computed again.
    jobs : int
        Processes. With more than 1 a script needs ``if __name__ == '__main__'``.
    overwrite : bool
        Replace the output of another comparison there.
    show : callable
        Takes lines about compilation and progress.
    progress : callable, optional
        Called with the number of finished runs, and of all.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        Command line, for the page.
    choices
        Other attributes of `ComparisonSpec`: ``laws``, ``conditions``, ``gains``, ``held_out``,
        ``seed``, ``cases`` and ``passes``.

    Returns
    -------
    pandas.DataFrame
        The rows of ``compare.parquet``: law, condition, and which of its runs (`part`), then the
        columns of a map.

    Raises
    ------
    CtcError
        If an argument is not allowed, before anything is run. If the law to which all others
        are compared has no numbers, or another comparison is in the directory.

    """
    spec = files if isinstance(files, ComparisonSpec) else ComparisonSpec(files, **choices)
    check_format(extra)
    jobs = checked_integer('jobs', jobs, 1)
    runs = ComparisonRuns(spec.runs())
    path = Path(out) if out else None
    with complete_table(runs, path, jobs, None, overwrite, show, progress) as result:
        rows = result.table.to_pandas()
        if path:
            from ctc_chattering.runs.compare_page import write_comparison  # Takes time.
            with result.folder.replacing_files() as folder:
                write_comparison(runs, rows, folder, extra, command)
    return rows
