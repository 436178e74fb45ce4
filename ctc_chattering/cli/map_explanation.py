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

"""`ctc map --explain`: one run of a map, its parameter file, its samples, figures and page."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.output import prepare, writing
from ctc_chattering.analysis.result import Result, simulate, write_npz
from ctc_chattering.analysis.run_page import NAMES
from ctc_chattering.cli.presentation import present
from ctc_chattering.cli.progress import Progress
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.errors import CtcError
from ctc_chattering.runs.points import find_run, Runs
from ctc_chattering.runs.store import about, read_about, TABLE
from pyarrow import parquet

#: Names in the directory of a run, which is below that of all of them.
_FOLDER, _PARAMETERS, _SAMPLES = 'explain', 'run.yaml', 'trajectory.npz'
#: Parameters of a robot that are paths; package:// is none.
_PATHS = ('description', 'trajectory_file')


def explain(runs: Runs, options: argparse.Namespace) -> int:
    """Write and print one run of a map, as `ctc simulate` computes it."""
    run = find_run(runs, options.explain)
    which = {name: x for name, x in runs.columns(run).items() if name not in ('law', 'switching')}
    print(', '.join(f'{name} {x:g}' if isinstance(x, float) else f'{name} {x}'
                    for name, x in which.items()))
    row = _row(runs, run, options.out)
    if row is not None:
        print('in the map: ' + (f'{row["failure"]}: {row["reason"]}' if row['failure'] else
                                f'no failure, error {row["error"]:.3g} rad'))
    out = prepare(options.out / _FOLDER / str(run), (
        _PARAMETERS, _SAMPLES, *NAMES), options.overwrite)
    setup = _written(runs.setup(run), f'run_{run}', out / _PARAMETERS)
    print(f'its parameters: {out / _PARAMETERS}')
    result, failure = _simulated(setup)
    if failure:
        print(f'this run ends: {failure}')
    if result is None:
        return 0
    result = dataclasses.replace(result, window=runs.spec.window)
    write_npz(result, out / _SAMPLES)
    return present([result], [], out, options.format, options.said)


def _row(runs: Runs, run: int, directory: Path) -> dict[str, Any] | None:
    """Return the row of a run, if the map of a directory has it."""
    if not (directory / TABLE).exists() or (
            read_about(directory).get('key') != about(runs)['key']):
        return None
    found = parquet.read_table(directory / TABLE, filters=[('run', '=', run)]).to_pylist()
    return found[0] if found else None


def _written(setup: Setup, title: str, path: Path) -> Setup:
    """Write the parameter file of a setup, and return what is read from it."""
    values = {node: {name: _absolute(x) if name in _PATHS else x for name, x in mine.items()}
              for node, mine in setup.values.items()}
    values['plant']['experiment'] = title
    with writing(path):
        parameter_file.dump(values, path)
    return parameter_file.load(path)


def _absolute(location: str) -> str:
    return str(Path(location).resolve()) if location and '://' not in location else location


def _simulated(setup: Setup) -> tuple[Result | None, str]:
    """Return a run, or what comes before its failure, and the failure."""
    reached = 0.0

    def progress(t: float) -> None:
        nonlocal reached
        reached = t
        bar(t)

    with Progress(f'experiment {setup.plant.experiment}:', setup.plant.duration) as bar:
        try:
            result = simulate(setup, progress)
            bar(setup.plant.duration)
            return result, ''
        except CtcError as error:
            failure = str(error)
    if not reached:
        return None, failure
    return simulate(setup.changed({'plant': {'duration': reached}})), failure
