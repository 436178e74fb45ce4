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

"""What a comparison writes: table, CSV, figures, page, and a parameter file for every run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ctc_chattering.analysis import page
from ctc_chattering.analysis.drawing import FigureFile
from ctc_chattering.analysis.output import check_format, file_stem, prepare, write_text, writing
from ctc_chattering.arguments import check_each, checked
from ctc_chattering.configuration import parameter_file
from ctc_chattering.studies.comparison import Outcome
from ctc_chattering.studies.comparison_figures import save_comparison_figures
from ctc_chattering.studies.comparison_tables import held_out_csv, tables, to_csv, to_markdown

#: Names in the directory.
TABLE, CSV, HELD_OUT, PAGE, FIGURES, PARAMETERS = (
    'compare.md', 'compare.csv', 'held_out.csv', 'index.html', 'figures', 'parameters')
NAMES = (TABLE, CSV, HELD_OUT, PAGE, FIGURES, PARAMETERS)

_LEAD = ('Every law with the same motion on the same robot: position error and torque of each '
         'joint, by the settings and under the conditions that the tables name.')


@checked(outcomes=Sequence, out=(str, Path), command=str)
def write_comparison(outcomes: Sequence[Outcome], out: str | Path, extra: str = 'svg',
                     command: str = '') -> None:
    """
    Write tables, figures, page, and a parameter file of every run.

    Parameters
    ----------
    outcomes : sequence of Outcome
        What `compare` has returned.
    out : str or Path
        Directory for ``compare.md``, ``compare.csv``, ``figures``, ``index.html``,
        ``parameters``.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        What was run, for the page.

    Raises
    ------
    CtcError
        If there is no outcome, a file exists already, or cannot be written.

    """
    check_each('outcomes', outcomes, Outcome, 1)
    check_format(extra)
    out = prepare(Path(out), NAMES)
    write_text(out / TABLE, to_markdown(outcomes))
    write_text(out / CSV, to_csv(outcomes))
    if any(x.judged for x in outcomes):
        write_text(out / HELD_OUT, held_out_csv(outcomes))
    write_parameters(outcomes, out / PARAMETERS)
    write_page(outcomes, save_comparison_figures(outcomes, out / FIGURES, extra), out / PAGE,
               command)


def write_page(outcomes: Sequence[Outcome], figures: Sequence[FigureFile], path: Path,
               command: str = '') -> None:
    """Write the page; raise `CtcError` if that cannot be done."""
    page.write_page(path, 'The laws compared', _LEAD, [
        page.Section('Figures', figures), page.Section('Numbers', list(tables(outcomes)))],
        [(name, name) for name in (CSV, TABLE, PARAMETERS)], command)


def write_parameters(outcomes: Sequence[Outcome], directory: Path) -> list[Path]:
    """Write a file for every run, as `ctc simulate` takes it; return their paths."""
    paths: list[Path] = []
    used: set[str] = set()
    with writing(directory):
        directory.mkdir(parents=True, exist_ok=True)
        for x in outcomes:
            condition, variant = x.task.condition, x.task.variant
            for k, run in enumerate(x.runs):
                name = condition.name if condition else ''
                factor = f'model_{condition.factors[k]:g}' if condition and len(
                    x.runs) > 1 else ''
                stem = '_'.join(filter(None, (
                    x.experiment, x.backend, name, variant.switching or variant.law,
                    variant.settings, factor)))
                setup = parameter_file.load(x.task.path, run)
                paths.append(directory / f'{file_stem(stem, used)}.yaml')
                parameter_file.dump(setup.values, paths[-1])
    return paths
