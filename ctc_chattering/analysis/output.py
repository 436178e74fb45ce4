"""What commands write: nothing is overwritten without a request, and errors are one line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from html import unescape
from pathlib import Path
import re
import shutil
from typing import NamedTuple

from ctc_chattering.analysis.markup import fragment, Markup
from ctc_chattering.errors import CtcError

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


def prepare(directory: Path, names: Sequence[str], overwrite: bool = False) -> Path:
    """
    Prepare `directory` for files and directories with these `names`.

    Parameters
    ----------
    directory : Path
        Created if it does not exist.
    names : sequence of str
        Names that will be written into it.
    overwrite : bool
        Remove these first if they exist, and nothing else.

    Returns
    -------
    Path
        `directory`.

    Raises
    ------
    CtcError
        If any of them exists and `overwrite` is not set, or the directory cannot be created.

    """
    with writing(directory):
        directory.mkdir(parents=True, exist_ok=True)
        for path in filter(Path.exists, (directory / name for name in names)):
            if not overwrite:
                raise CtcError(f'{path}: exists already; choose another --out, or --overwrite')
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
    return directory


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an error of the file system into a `CtcError` that names `path`."""
    try:
        yield
    except OSError as error:
        raise CtcError(f'cannot write {path}: {error.strerror or error}') from None


def write_text(path: Path, text: str) -> None:
    """Write a file, making its directory; raise `CtcError` if that cannot be done."""
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding='utf-8', errors='backslashreplace')


def file_stem(text: str, used: set[str] | None = None) -> str:
    """
    Return the name of a file, without its ending.

    Parameters
    ----------
    text : str
        What it is named after, whatever that contains.
    used : set of str, optional
        Names that are taken; this one is added.

    """
    used = set() if used is None else used
    stem = re.sub(r'[^\w.-]+', '_', text).strip('_.')[:120] or 'run'
    stem = stem if stem not in used else f'{stem}_{len(used) + 1}'
    used.add(stem)
    return stem


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


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of as many cells each as lines of text, in columns, without control codes."""
    rows = [[_line(text) for text in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows)]
    return ['  '.join(text.ljust(width) for text, width in zip(row, widths)).rstrip()
            for row in rows]
