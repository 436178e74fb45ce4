"""Tables: on a terminal, in Markdown, and what the pages make of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import csv
from html import unescape
import io
import re
from typing import NamedTuple

from ctc_chattering.analysis.markup import fragment, Markup

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
    text = _line(text).replace('&', '&amp;').replace('<', '&lt;')
    return re.sub(r'[\\|*`~$]|(?<![^\W_])_|_(?![^\W_])|(?<=\])\(', r'\\\g<0>', text)


def _line(text: str) -> str:
    """Return text with spaces in the place of what begins a line or steers a terminal."""
    return ''.join(x if x.isprintable() else ' ' for x in text)


def markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table in Markdown; cells as `markdown` takes them."""
    return [f'| {" | ".join(cells)} |' for cells in (
        map(markdown, heads), ['---'] * len(heads), *(map(markdown, row) for row in rows))]


def csv_text(rows: Sequence[Mapping[str, object]], heads: Sequence[str] = ()) -> str:
    """Return rows of the same keys as CSV, `heads` without any row; None is empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0] if rows else heads, lineterminator='\n')
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of as many cells each as lines of text, in columns, without control codes."""
    rows = [[_line(text) for text in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows)]
    return ['  '.join(text.ljust(width) for text, width in zip(row, widths)).rstrip()
            for row in rows]


def print_columns(rows: Sequence[Sequence[str]]) -> None:
    """Print rows of as many cells each, in columns."""
    print('\n'.join(columns(rows)))
