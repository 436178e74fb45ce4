"""What commands write: nothing is overwritten without a request, and errors are one line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
import shutil

from ctc_chattering.errors import CtcError


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
        path.write_text(text, encoding='utf-8')


def markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    return [f'| {" | ".join(cells)} |' for cells in (heads, ['---'] * len(heads), *rows)]


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of as many cells each as lines of text, in columns."""
    widths = [max(map(len, column)) for column in zip(*rows)]
    return ['  '.join(text.ljust(width) for text, width in zip(row, widths)).rstrip()
            for row in rows]
