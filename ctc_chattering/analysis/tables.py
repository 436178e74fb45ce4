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

"""Tables: on a terminal, in Markdown, and what the pages make of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import csv
from html import unescape
import io
import re
from textwrap import wrap
from typing import NamedTuple

from ctc_chattering.analysis.markup import fragment, Markup

#: Columns of a terminal that `fitted` and `paragraph` fill, and those of a name in a table.
WIDTH, _NAME = 100, 40
#: Elements of HTML that have a form in Markdown.
_MARKS = {'b': '**', 'code': '`'}


class Table(NamedTuple):
    """
    A table of a page and of a file in Markdown; texts are escaped in both, `Markup` is not.

    Attributes
    ----------
    title : str
        Empty for none.
    heads : sequence of str
        Of the columns; empty for pairs of name and text.
    rows : sequence of sequences of str
        Of as many cells each.
    names : int
        How many columns, from the left, have no numbers.
    note : str
        Below the table, on a page.

    """

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    names: int = 1
    note: str = ''


def bold(text: str) -> Markup:
    """Return text that is bold, on a page and in Markdown."""
    return fragment('<b>{{ x }}</b>', x=text)


def two_lines(first: str, second: str) -> Markup:
    """Return a cell of a page, whose second line is small."""
    return fragment('{{ a }}<br><small>{{ b }}</small>', a=first, b=second)


def markdown(text: str) -> str:
    """Return text in Markdown, on one line; <b> and <code> of `Markup` have their form there."""
    if not isinstance(text, Markup):
        return _plain(text)
    parts = re.split(r'</?(b|code)>', text)
    return ''.join(_MARKS[part] if k % 2 else _plain(unescape(part))
                   for k, part in enumerate(parts))


def _plain(text: str) -> str:
    """Return text that has no meaning in Markdown, or in HTML in it, on one line."""
    text = one_line(text).replace('&', '&amp;').replace('<', '&lt;')
    return re.sub(r'[\\|*`~$]|(?<![^\W_])_|_(?![^\W_])|(?<=\])\(', r'\\\g<0>', text)


def one_line(text: str) -> str:
    """Return text with spaces in the place of what begins a line or steers a terminal."""
    return ''.join(x if x.isprintable() else ' ' for x in text)


def markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table in Markdown; cells as `markdown` takes them."""
    return [f'| {" | ".join(cells)} |' for cells in (
        map(markdown, heads), ['---'] * len(heads), *(map(markdown, row) for row in rows))]


def csv_text(rows: Sequence[Mapping[str, object]], heads: Sequence[str] = ()) -> str:
    """
    Return rows of the same keys as CSV, `heads` without any row; None is empty.

    Text is on one line; what a spreadsheet would compute stands behind an apostrophe.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0] if rows else heads, lineterminator='\n')
    writer.writeheader()
    writer.writerows({key: _in_csv(x) if isinstance(x, str) else x for key, x in row.items()}
                     for row in rows)
    return text.getvalue()


def _in_csv(text: str) -> str:
    """Return text on one line, with an apostrophe before what begins a formula."""
    line = one_line(text)
    return f"'{line}" if line.lstrip().startswith(('=', '+', '-', '@')) else line


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of as many cells each as lines of text, in columns, without control codes."""
    rows = [[one_line(text) for text in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows)]
    return ['  '.join(text.ljust(width) for text, width in zip(row, widths)).rstrip()
            for row in rows]


def fitted(rows: Sequence[Sequence[str]], indent: int = 2) -> list[str]:
    """
    Return rows of as many cells each as lines of at most `WIDTH` characters.

    Columns that do not fit stand below, again with the first one, of which long names are cut.
    """
    names = [cut(one_line(row[0]), _NAME) for row in rows]
    room = WIDTH - indent
    left = room - max(map(len, names))
    parts: list[list[Sequence[str]]] = [[names]]
    for column in zip(*(row[1:] for row in rows)):
        cells = [cut(one_line(text), room - _NAME - 2) for text in column]
        width = 2 + max(map(len, cells))
        if left < width and len(parts[-1]) > 1:
            parts.append([names])
            left = room - max(map(len, names))
        parts[-1].append(cells)
        left -= width
    blocks = (columns(list(zip(*part))) for part in parts)
    return [f'{"":{indent}}{line}' for block in blocks for line in block]


def paragraph(text: str, indent: int = 2) -> list[str]:
    """Return text as lines of at most `WIDTH` characters, the first one less indented."""
    return wrap(one_line(text), WIDTH, initial_indent=' ' * indent,
                subsequent_indent=' ' * (indent + 2), break_on_hyphens=False)


def cut(text: str, most: int) -> str:
    """Return text of at most so many characters, without those in its middle."""
    if len(text) <= most:
        return text
    return f'{text[:most // 2]}…{text[-((most - 1) // 2):]}'


def print_columns(rows: Sequence[Sequence[str]]) -> None:
    """Print rows of as many cells each, in columns."""
    print('\n'.join(columns(rows)))
