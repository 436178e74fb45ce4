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
Tables and lines of text, for terminals, Markdown, CSV and pages.

Names come from outside, from bags for example. What is written here has therefore no control
codes, no markup of its own and no formulas of a spreadsheet.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import csv
from html import unescape
import io
import re
from textwrap import wrap
from typing import NamedTuple

from ctc_chattering.analysis.markup import fragment, Markup

#: Columns of a terminal that `fitted` and `paragraph` fill.
WIDTH = 100
#: Columns of a terminal for the names of a table.
_NAME_WIDTH = 40
#: Markdown of HTML elements.
_MARKS = {'b': '**', 'code': '`'}


class Table(NamedTuple):
    """
    A table of a page, of Markdown or of a terminal.

    Texts are escaped, `Markup` is not.

    Attributes
    ----------
    title : str
        Title, or '' for none.
    heads : sequence of str
        Heads of the columns; none for pairs of name and text.
    rows : sequence of sequences of str
        Rows of as many cells each.
    names : int
        Number of columns, from the left, without numbers.
    note : str
        Text below the table, on a page.

    """

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    names: int = 1
    note: str = ''


def bold(text: str) -> Markup:
    """Return bold text for a page or Markdown."""
    return fragment('<b>{{ x }}</b>', x=text)


def two_lines(first: str, second: str) -> Markup:
    """Return a cell whose second line is small."""
    return fragment('{{ a }}<br><small>{{ b }}</small>', a=first, b=second)


def markdown(text: str) -> str:
    """
    Return text in Markdown, on one line.

    The elements <b> and <code> of `Markup` have their form there.
    """
    if not isinstance(text, Markup):
        return _escape_markdown(text)
    pieces = re.split('</?(b|code)>', text)
    pieces[::2] = [_escape_markdown(unescape(x)) for x in pieces[::2]]
    pieces[1::2] = [_MARKS[x] for x in pieces[1::2]]
    return ''.join(pieces)


def _escape_markdown(text: str) -> str:
    """Return text on one line, without a meaning in Markdown or HTML."""
    text = one_line(text).replace('&', '&amp;').replace('<', '&lt;')
    return re.sub(r'[\\|*`~$]|(?<![^\W_])_|_(?![^\W_])|(?<=\])\(', r'\\\g<0>', text)


def one_line(text: str) -> str:
    """
    Return text on one line.

    Spaces replace what begins a line or steers a terminal.
    """
    return ''.join(x if x.isprintable() else ' ' for x in text)


def markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    head, *body = ([markdown(x) for x in cells] for cells in (heads, *rows))
    return [f'| {" | ".join(cells)} |' for cells in (head, ['---'] * len(head), *body)]


def csv_text(rows: Sequence[Mapping[str, object]], heads: Sequence[str] = ()) -> str:
    """
    Return rows of the same keys as CSV.

    The keys are the head, or `heads` without any row. None is empty. Text is on one line, and
    what a spreadsheet would compute stands behind an apostrophe.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0] if rows else heads, lineterminator='\n')
    writer.writeheader()
    writer.writerows({key: _csv_cell(x) for key, x in row.items()} for row in rows)
    return text.getvalue()


def _csv_cell(value: object) -> object:
    """Return a cell; no text is a formula."""
    if not isinstance(value, str):
        return value
    text = one_line(value)
    return f"'{text}" if text.lstrip().startswith(('=', '+', '-', '@')) else text


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows as lines of text in columns."""
    cells = [[one_line(text) for text in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells)]
    return ['  '.join(map(str.ljust, row, widths)).rstrip() for row in cells]


def fitted(rows: Sequence[Sequence[str]], indent: int = 2) -> list[str]:
    """
    Return rows as lines of at most `WIDTH` characters.

    Columns that do not fit stand below, again with the first one, of which long names are cut.
    """
    width = WIDTH - indent
    first, *further = zip(*rows)
    names = [cut(one_line(text), _NAME_WIDTH) for text in first]
    blocks: list[list[list[str]]] = []
    remaining = 0
    for column in further:
        cells = [cut(one_line(text), width - _NAME_WIDTH - 2) for text in column]
        needed = 2 + max(map(len, cells))
        if needed > remaining:
            blocks.append([names])
            remaining = width - max(map(len, names))
        blocks[-1].append(cells)
        remaining -= needed
    lines = (line for block in blocks or [[names]] for line in columns([*zip(*block)]))
    return [f'{"":{indent}}{line}' for line in lines]


def paragraph(text: str, indent: int = 2) -> list[str]:
    """
    Return text as lines of at most `WIDTH` characters.

    The first line is less indented.
    """
    return wrap(
        one_line(text),
        WIDTH,
        initial_indent=' ' * indent,
        subsequent_indent=' ' * (indent + 2),
        break_on_hyphens=False,
    )


def cut(text: str, length: int) -> str:
    """Return text without the middle if it is too long."""
    if len(text) <= length:
        return text
    return f'{text[: length // 2]}…{text[-((length - 1) // 2) :]}'


def print_columns(rows: Sequence[Sequence[str]]) -> None:
    """Print rows in columns."""
    print('\n'.join(columns(rows)))
