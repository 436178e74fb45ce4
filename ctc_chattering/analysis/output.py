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

"""What commands write: nothing is overwritten without a request, and errors are one line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import json
from pathlib import Path
import re
import shutil
from typing import Any

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


def write_json(value: Any, path: Path) -> None:
    """Write a file of strict JSON; numbers that are not finite become null."""
    write_text(path, json.dumps(finite(value), indent=2, ensure_ascii=False) + '\n')


def finite(value: Any) -> Any:
    """Return `value`, as JSON has it, with None in place of every number that is not finite."""
    return json.loads(json.dumps(value, default=lambda x: x.item()), parse_constant=lambda _: None)
