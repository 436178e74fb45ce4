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
Single files that commands write.

They are replaced in one step, and named safely.

A file is made under another name, which must be new, and then renamed. No link is followed, and
no pipe is opened. A process that is killed leaves the old file or the new one. `output_folder.py`
does the same for folders.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
import json
import os
from pathlib import Path
import re
import stat
from typing import Any, BinaryIO

from ctc_chattering.errors import as_file_error, CtcError, ParameterError
from ctc_chattering.input_files import kind_of

#: Formats of figures.
FORMATS = ('svg', 'pdf', 'png')
#: Flags to open a file that others may have put there.
NO_LINK = os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
#: The name of a file or folder that is not complete.
_INCOMPLETE = re.compile(r'\..*\.part', re.DOTALL)


def writing(path: Path) -> AbstractContextManager[None]:
    """Turn an error of the file system into a `CtcError`."""
    return as_file_error(f'cannot write {path}')


def incomplete_path(path: Path) -> Path:
    """Return the path of something that is not complete."""
    return path.with_name(f'.{path.name}.part')


def is_incomplete(name: str) -> bool:
    """Return whether a path, or a folder above, is incomplete."""
    return any(map(_INCOMPLETE.fullmatch, Path(name).parts))


def check_file(path: Path, overwrite: bool = False) -> None:
    """
    Raise unless a command may write this file.

    Raises
    ------
    CtcError
        If it exists and `overwrite` is not set, or is a folder, a link, a pipe or a device.

    """
    with writing(path):
        if not os.path.lexists(path):
            return
        mode = path.lstat().st_mode
    if not stat.S_ISREG(mode):
        raise CtcError(f'{path}: is {kind_of(mode)}, which is not replaced; choose another name')
    if not overwrite:
        raise CtcError(f'{path}: exists already; choose another name, or --overwrite')


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """
    Yield a stream that replaces a complete file.

    The content gets the name of the file in one step. If it replaces a file, it is on the disk
    before that.

    Parameters
    ----------
    path : Path
        A regular file, or none yet.

    Raises
    ------
    CtcError
        If there is something else, or the file cannot be written.

    """
    check_file(path, overwrite=True)
    incomplete = incomplete_path(path)
    with writing(path):
        incomplete.unlink(missing_ok=True)
        descriptor = os.open(incomplete, os.O_WRONLY | os.O_CREAT | os.O_EXCL | NO_LINK, 0o666)
        try:
            with os.fdopen(descriptor, 'wb') as stream:
                yield stream
                stream.flush()
                if path.exists():
                    os.fsync(descriptor)
            incomplete.replace(path)
        except BaseException:
            incomplete.unlink(missing_ok=True)
            raise


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file as `replacing` does, and make its folder."""
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as stream:
        stream.write(content)


def write_text(path: Path, text: str) -> None:
    """Write a file as `write_bytes` does."""
    write_bytes(path, text.encode('utf-8', 'backslashreplace'))


def write_json(value: Any, path: Path) -> None:
    """Write a file of strict JSON, with null for infinity."""
    write_text(path, json.dumps(finite(value), indent=2, ensure_ascii=False) + '\n')


def finite(value: Any) -> Any:
    """Return a value of JSON, with None for numbers not finite."""
    return json.loads(json.dumps(value, default=lambda x: x.item()), parse_constant=lambda _: None)


def check_format(extra: str) -> None:
    """Raise `ParameterError` unless figures can have this format."""
    if extra not in FORMATS:
        raise ParameterError('extra', extra, ' | '.join(FORMATS))


def file_stem(text: str, used: set[str] | None = None) -> str:
    """
    Return the name of a file, without its ending.

    Parameters
    ----------
    text : str
        Text to name it after, with any characters.
    used : set of str, optional
        Names that are taken. This one is added.

    """
    used = set() if used is None else used
    stem = re.sub(r'[^\w.-]+', '_', text).strip('_.')[:120] or 'run'
    if stem in used:
        stem = f'{stem}_{len(used) + 1}'
    used.add(stem)
    return stem
