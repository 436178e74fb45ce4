"""Directories that commands write into: nothing is overwritten unasked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
import shutil

from ctc_chattering.errors import CtcError


def prepare(directory: Path, names: Sequence[str], overwrite: bool = False) -> Path:
    """
    Make `directory` ready for files and directories called `names`.

    Parameters
    ----------
    directory : Path
        Made if it is not there.
    names : sequence of str
        What will be written into it.
    overwrite : bool
        Remove these first if they are there; nothing else is touched.

    Returns
    -------
    Path
        `directory`.

    Raises
    ------
    CtcError
        If any of them is there and `overwrite` is not set, or the directory cannot be made.

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
