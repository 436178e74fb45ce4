"""What a comparison writes: table, CSV, figures, page, and a parameter file for every run."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
import re

from ctc_chattering.analysis.output import write_text, writing
from ctc_chattering.analysis.report import write_sections
from ctc_chattering.experiment import parameter_file
from ctc_chattering.studies.comparison import Outcome
from ctc_chattering.studies.comparison_figures import save_comparison_figures
from ctc_chattering.studies.comparison_tables import Table, tables, to_csv, to_markdown

#: Names in the directory.
TABLE, CSV, PAGE, FIGURES, PARAMETERS = (
    'compare.md', 'compare.csv', 'index.html', 'figures', 'parameters')
NAMES = (TABLE, CSV, PAGE, FIGURES, PARAMETERS)


def write_comparison(outcomes: Sequence[Outcome], out: Path) -> None:
    """Write everything into `out`; raise `CtcError` if that cannot be done."""
    write_text(out / TABLE, to_markdown(outcomes))
    write_text(out / CSV, to_csv(outcomes))
    write_parameters(outcomes, out / PARAMETERS)
    figures = save_comparison_figures(outcomes, out / FIGURES)
    links = [f'<a href="{name}">{name}</a>' for name in (CSV, TABLE, PARAMETERS)]
    write_sections(out / PAGE, 'The laws compared',
                   '\n'.join(map(to_html, tables(outcomes))), figures, links)


def write_parameters(outcomes: Sequence[Outcome], directory: Path) -> list[Path]:
    """Write a file for every run, as `ctc simulate` takes it; return their paths."""
    paths = []
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
                paths.append(directory / f'{stem}.yaml')
                parameter_file.dump(setup.values, paths[-1])
    return paths


def to_html(table: Table) -> str:
    """Return a table in HTML, with what is bold in Markdown."""
    def row(cells: Sequence[str], tag: str) -> str:
        return '<tr>' + ''.join(
            f'<{tag}{" class=n" if i > 2 else ""}>{_bold(cell)}</{tag}>'
            for i, cell in enumerate(cells)) + '</tr>'

    return (f'<p>{_bold(table.title)}</p><div class="scroll"><table><thead>'
            f'{row(table.heads, "th")}</thead><tbody>'
            + '\n'.join(row(cells, 'td') for cells in table.rows) + '</tbody></table></div>')


def _bold(text: str) -> str:
    """Return Markdown as HTML, of which only ** is used."""
    return re.sub(r'\*\*(.+?)\*\*', r'<b>\1</b>', escape(text))
