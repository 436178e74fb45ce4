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

"""What `ctc study` writes: tables, CSV, figures and page, of the switchings or of the laws."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from pathlib import Path
from types import ModuleType

from ctc_chattering.analysis.drawing import FigureFile
from ctc_chattering.analysis.output import check_format, prepare, write_text
from ctc_chattering.analysis.page import Folded, Section, write_page
from ctc_chattering.analysis.tables import markdown, markdown_table
from ctc_chattering.arguments import check_each, checked
from ctc_chattering.control.controller_config import LAWS as ALL_LAWS
from ctc_chattering.control.controller_config import RIVALS
from ctc_chattering.control.switching import SWITCHINGS as EVERY_SWITCHING
from ctc_chattering.studies import law_study, study
from ctc_chattering.studies.study import CaseOutcome, to_csv
from ctc_chattering.studies.study_figures import save_study_figures


@dataclasses.dataclass(frozen=True)
class StudyKind:
    """
    A study.

    Attributes
    ----------
    what, variants : str, tuple of str
        What is compared, and all of them.
    name, figures : str
        Of its files, without their endings, and of the directory of its figures.
    module : module
        `study` or `law_study`, with ``about`` and ``tables``.

    """

    what: str
    variants: Sequence[str]
    name: str
    figures: str
    module: ModuleType

    @property
    def names(self) -> tuple[str, ...]:
        """Return what is written."""
        return (f'{self.name}.md', f'{self.name}.csv', f'{self.name}.html', self.figures)


#: Laws of the study: with the gains of the file, or those that are recommended.
EVERY_LAW = tuple(law for law in ALL_LAWS if law not in RIVALS)
SWITCHINGS = StudyKind('switching', EVERY_SWITCHING, 'study', 'figures', study)
LAWS = StudyKind('law', EVERY_LAW, 'laws', 'laws_figures', law_study)


def kind_of(outcomes: Sequence[CaseOutcome]) -> StudyKind:
    """Return the study that outcomes are of."""
    return LAWS if outcomes[0].variant in ALL_LAWS else SWITCHINGS


@checked(outcomes=Sequence, out=(str, Path), command=str)
def write_study(outcomes: Sequence[CaseOutcome], out: str | Path, extra: str = 'png',
                command: str = '') -> None:
    """
    Write tables, figures and page.

    Parameters
    ----------
    outcomes : sequence of CaseOutcome
        What `study` has returned.
    out : str or Path
        Directory for ``study.md``, ``study.csv``, ``figures``, ``study.html``; of laws
        ``laws.md``, ``laws.csv``, ``laws_figures``, ``laws.html``.
    extra : {'svg', 'pdf', 'png'}
        A format for each figure besides PNG.
    command : str
        What was run, for the page.

    Raises
    ------
    CtcError
        If there is no outcome, a file exists already, or cannot be written.

    """
    check_each('outcomes', outcomes, CaseOutcome, 1)
    check_format(extra)
    kind = kind_of(outcomes)
    out = prepare(Path(out), kind.names)
    text, table, page = (out / name for name in kind.names[:3])
    write_text(table, to_csv(outcomes, kind.what))
    figures = save_study_figures(outcomes, out / kind.figures, extra)
    write_text(text, to_markdown(kind, outcomes, figures, out))
    numbers = [Folded(x.title or 'All cases', [x._replace(title='')], x.title == study.RANKING)
               for x in kind.module.tables(outcomes)]
    write_page(page, _title(kind), kind.module.about(outcomes), [
        Section('Figures', figures), Section('Numbers', numbers)],
        [(x, x) for x in kind.names[:2]], command)


def to_markdown(kind: StudyKind, outcomes: Sequence[CaseOutcome],
                figures: Sequence[FigureFile] = (), out: Path = Path()) -> str:
    """Return all tables, and the figures below `out`."""
    lines = [f'# {_title(kind)}', '', markdown(kind.module.about(outcomes))]
    for table in kind.module.tables(outcomes):
        lines += ['', *([f'## {table.title}', ''] if table.title else []),
                  *([table.note, ''] if table.note else []),
                  *markdown_table(table.heads, table.rows)]
    if figures:
        lines += ['', '## Figures']
    for figure in figures:
        lines += ['', f'![{figure.title}.]({figure.path.relative_to(out).as_posix()})']
    return '\n'.join([*lines, ''])


def _title(kind: StudyKind) -> str:
    return f'Study of the {kind.what}s'
