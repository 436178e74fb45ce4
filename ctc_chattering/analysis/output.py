"""Output directories of commands; nothing is overwritten without a request."""

from __future__ import annotations

from collections.abc import Sequence
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
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for name in names:
            path = directory / name
            if not path.exists():
                continue
            if not overwrite:
                raise CtcError(f'{path}: exists already; choose another --out, or --overwrite')
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
    except OSError as error:
        raise CtcError(f'{directory}: {error.strerror or error}') from None
    return directory
