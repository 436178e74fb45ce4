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

"""What `ctc tune` writes: parameter files, all numbers, figures and page."""

from __future__ import annotations

from collections.abc import Sequence
import json
from pathlib import Path
from typing import Any

from ctc_chattering.analysis import page
from ctc_chattering.analysis.drawing import FigureFile
from ctc_chattering.analysis.output import check_format, finite, prepare, write_text, writing
from ctc_chattering.analysis.tables import csv_text, Table
from ctc_chattering.arguments import checked
from ctc_chattering.configuration import parameter_file
from ctc_chattering.robustness.tuning import report
from ctc_chattering.robustness.tuning.figures import save_tune_figures
from ctc_chattering.robustness.tuning.runs import Candidate, Tuning
from ctc_chattering.robustness.tuning.search import OverDraws
from ctc_chattering.robustness.tuning.spec import Draws, TuneSpec

#: Names in the directory.
TUNED, NUMBERS, FRONT, POINTS, FIGURES, PAGE = NAMES = (
    'tuned.yaml', 'tune.json', 'front.csv', 'front', 'figures', 'index.html')
_LEAD = ('Gains with little error and little torque variation for a robot that is known in part: '
         'the best compromises of a search, and what they do on draws that it has not seen.')


@checked(tuning=Tuning, out=(str, Path), command=str)
def write_tuning(tuning: Tuning, out: str | Path, extra: str = 'svg', command: str = '') -> None:
    """
    Write parameter files, numbers, figures and page of a search for gains.

    Parameters
    ----------
    tuning : Tuning
        What `tune` has found.
    out : str or Path
        Directory for ``tuned.yaml``, which `simulate` and all nodes take, ``front``, with those
        of all points, ``front.csv``, ``tune.json``, ``figures``, ``index.html``.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        What was run, for the page.

    Raises
    ------
    CtcError
        If a file exists already, or cannot be written.

    """
    check_format(extra)
    out = prepare(Path(out), NAMES)
    for point in tuning.points:
        write_parameters(tuning.spec, point, out / POINTS / f'{point.name}.yaml')
    if tuning.best:
        write_parameters(tuning.spec, tuning.best, out / TUNED)
    write_text(out / NUMBERS, json.dumps(
        finite(as_mapping(tuning)), indent=1, ensure_ascii=False) + '\n')
    write_text(out / FRONT, to_csv(tuning))
    write_page(tuning, save_tune_figures(tuning, out / FIGURES, extra), out / PAGE, command)


def write_page(tuning: Tuning, figures: Sequence[FigureFile], path: Path, command: str = ''
               ) -> None:
    """Write the page; raise `CtcError` if that cannot be done."""
    files = {TUNED: 'parameter file of what is recommended', POINTS: 'of all points of the '
             'front', FRONT: 'their numbers', NUMBERS: 'all trials'}
    links = [(name, f'{name} ({what})') for name, what in files.items()
             if tuning.best or name == NUMBERS]
    notes = [page.Note(text) for text in (*report.notes(tuning), *tuning.spec.notes)]
    numbers, run = _tables(tuning)
    page.write_page(path, report.headline(tuning), _LEAD, [
        page.Section('Result', [*figures[:1], *notes, numbers]),
        page.Section('Further figures', figures[1:]), page.Section('What was run', [run])],
        links, command)


def write_parameters(spec: TuneSpec, point: Candidate, path: Path) -> None:
    """
    Write the file's parameters with the law and the gains of a point, and check them.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    controller = spec.setup.controller.changed(point.values).as_mapping()
    values = {**spec.values, 'controller': {**spec.values['controller'], **controller}}
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        parameter_file.dump(values, path)
    parameter_file.load(path)


def as_mapping(tuning: Tuning) -> dict[str, Any]:
    """Return everything as JSON has it."""
    spec, config = tuning.spec, tuning.spec.setup.controller
    return {
        'name': spec.name, 'law': config.law, 'switching': config.switching_in_force or None,
        'percentile': tuning.percentile, 'seed': tuning.seed,
        'joint_names': list(config.joint_names), 'duration_s': spec.setup.plant.duration,
        'window_s': list(spec.window), 'sampling': spec.repeats.sampling,
        'limits': {'torque_nm': list(spec.limits.torque),
                   'torque_rate_nm_per_s': list(spec.limits.rate)},
        'uncertain': [{
            'name': x.name, 'parameters': [f'{node}.{target.name}' for node, target in x.targets],
            'factor': x.factor, 'distribution': x.distribution, 'numbers': list(x.numbers)}
            for x in spec.uncertain],
        'draws': {'search': _draws(spec.draws()), 'fresh': _draws(tuning.fresh)},
        'search': {name: [x.low, x.high] for name, x in spec.ranges.items()},
        'recommended': tuning.best and tuning.best.name,
        'front': [{'trial': k, **_candidate(x)} for k, x in zip(tuning.front, tuning.points)],
        'references': [_candidate(x) for x in tuning.others],
        'trials': [{'trial': k, 'numbers': x.numbers, **_score(x.score)}
                   for k, x in enumerate(tuning.trials)],
        'notes': [*report.notes(tuning), *spec.notes]}


def _draws(draws: Draws) -> dict[str, Any]:
    return {'seed': draws.seed, 'values': draws.values}


def _candidate(x: Candidate) -> dict[str, Any]:
    return {'name': x.name, 'parameters': dict(x.values), 'drawn': _score(x.drawn),
            'fresh': _score(x.fresh)}


def _score(x: OverDraws) -> dict[str, Any]:
    return {'error_rad': x.error, 'torque_variation_nm_per_s': x.variation,
            'max_torque_nm': list(x.torque), 'max_torque_rate_nm_per_s': list(x.rate),
            'runs': len(x.runs), 'violating_runs': {name: n for name, n in x.violating.items()
                                                    if n}}


def to_csv(tuning: Tuning) -> str:
    """Return a line per point of the front, with a header; numbers in full."""
    rows = []
    for k, x in enumerate(tuning.points):
        numbers = tuning.trials[tuning.front[k]].numbers
        row: dict[str, object] = {'point': x.name, 'recommended': int(x is tuning.best), **{
            f'search_{name}': value for name, value in numbers.items()}}
        for name, value in x.values.items():
            row.update({f'{name}_{i}': y for i, y in enumerate(value, 1)} if isinstance(
                value, list) else {name: value})
        for title, score in (('', x.drawn), ('fresh_', x.fresh)):
            row.update({f'{title}error_rad': score.error,
                        f'{title}torque_variation_nm_per_s': score.variation,
                        **{f'{title}runs_violating_{name.replace(" ", "_")}': n
                           for name, n in score.violating.items()}})
        rows.append(row)
    return csv_text(rows, ['point'])


def _tables(tuning: Tuning) -> tuple[Table, Table]:
    """Return the tables of the page: numbers, and what was run."""
    head, *rows = report.table(tuning)
    return Table('', head, rows, note=(
        '* recommended: of all under the tuned law that keep the limits on fresh draws, the one '
        'with the smallest product of error and torque variation there. These are '
        f'{report.part_of_runs(tuning.percentile)}; torque and rate are the largest of all fresh '
        'draws. A column fresh is on draws that the search has not seen.')
    ), Table('', (), list(report.facts(tuning)))
