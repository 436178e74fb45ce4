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
Directory of a table that survives a kill.

It has a parquet file per chunk of runs, one of all rows, and their metadata. `map.py` opens
it and lets `compute` make the chunks that are missing. A process that is killed leaves whole files
only. The name of a chunk's file is a key of all inputs of its rows, the text of the package among
them. Parquet's checksums show a damaged file, which is computed again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
import hashlib
import json
import os
from pathlib import Path
from typing import Any, BinaryIO

import ctc_chattering
from ctc_chattering.configuration.compilation import compile_setups
from ctc_chattering.errors import as_ctc_error, CtcError
from ctc_chattering.input_files import read_bytes, read_text
from ctc_chattering.output_files import finite, writing
from ctc_chattering.output_folder import beside, check_owner, held, OutputFolder, read_contents
from ctc_chattering.runs.run_lists import RunList
import numpy as np
import numpy.typing as npt
import pyarrow
from pyarrow import parquet

#: Folder of the chunks in the directory.
SHARDS = 'shards'
#: Folder of the figures in the directory.
FIGURES = 'figures'
#: Files in the directory.
TABLE = 'map.parquet'
JSON = 'map.json'
PAGE = 'index.html'
#: Numbers of runs, ascending.
Numbers = Sequence[int] | npt.NDArray[np.int64]


@cache
def version() -> str:
    """Return the package's version with a hash of its text."""
    package, text = Path(ctc_chattering.__file__).parent, hashlib.sha256()
    for path in sorted(package.rglob('*.py')):
        text.update(path.read_bytes())
    return f'{ctc_chattering.__version__}+{text.hexdigest()[:12]}'


def table_schema(runs: RunList) -> pyarrow.Schema:
    """Return the columns of a table with their units."""
    return pyarrow.schema([
        pyarrow.field(name, pyarrow.type_for_alias(type_name),
                      metadata={'unit': unit} if unit else None)
        for name, (type_name, unit) in runs.types.items()])


def table_metadata(runs: RunList) -> dict[str, Any]:
    """
    Return the metadata of a table.

    Its ``key`` identifies the table uniquely.
    """
    versions = {'ctc_chattering': version(), 'numpy': np.__version__,
                'pyarrow': pyarrow.__version__}
    return {'key': _key([runs.contents, version()]), 'spec': finite(runs.contents),
            'versions': versions}


def _key(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:32]


def chunks(runs: RunList, numbers: Numbers) -> list[npt.NDArray[np.int64]]:
    """
    Return runs, ascending numbers, in chunks of about equal work.

    Their size depends on nothing but the setup and the number of runs. It is a second of work,
    half a minute in plain Python: so many control steps, times the square of the number of joints.
    Of few runs there are 64 chunks, so that as many workers have work.
    """
    plant = runs.robot.plant
    steps = plant.duration / min(plant.control_period, plant.integration_step)
    second_of_work = 4e6 / (runs.joint_count ** 2 * steps)
    size = max(1, int(min(second_of_work, -(-len(numbers) // 64))))
    return np.split(np.asarray(numbers), range(size, len(numbers), size))


def compute(runs: RunList, caller_version: str, chunk: Numbers) -> pyarrow.Table:
    """
    Return the rows of a chunk.

    Their code is compiled first, if it is not on this machine.

    Parameters
    ----------
    runs : RunList
        A map, a comparison, or candidates for gains on their draws.
    caller_version : str
        `version` of the process that asks, which may be on another machine. It is empty for one
        that has compiled all code.
    chunk : sequence of int
        Numbers of the runs.

    Raises
    ------
    CtcError
        If this process has another version of the package.

    """
    if caller_version and caller_version != version():
        raise CtcError(f'a worker has version {version()} of ctc_chattering, not '
                       f'{caller_version}; install the same one everywhere')
    if caller_version:
        _compile(runs)
    return pyarrow.Table.from_pylist([runs.row(int(run)) for run in chunk], table_schema(runs))


@lru_cache(1)
def _compile(runs: Any) -> None:
    """Compile the code of runs once in a process."""
    compile_setups(runs.examples(), lambda _: None)


class Directory:
    """
    The directory of a table.

    Parameters
    ----------
    folder : OutputFolder
        Folder that only this process writes.
    metadata : mapping
        As `table_metadata` returns it.
    columns : pyarrow.Schema
        Columns of all rows.
    command : str
        Subcommand that writes the table: ``map`` or ``compare``.

    """

    def __init__(self, folder: OutputFolder, metadata: Mapping[str, Any],
                 columns: pyarrow.Schema, command: str) -> None:
        self.folder = folder
        self.path = folder.path
        self.key = metadata['key']
        self._columns = columns
        self._command = command
        if not _existing_key(folder.path, command):
            text = json.dumps(metadata, indent=2, ensure_ascii=False) + '\n'
            with folder.replacing(f'{command}.json') as stream:
                stream.write(text.encode())

    def file(self, chunk: Numbers) -> str:
        """Return the file of a chunk."""
        return f'{SHARDS}/{_key([self.key, *map(int, chunk)])}.parquet'

    def rows(self, chunk: Numbers, show: Callable[[str], None]) -> pyarrow.Table | None:
        """
        Return the rows of a chunk, or None.

        `show` takes a line about a damaged file, which is removed.
        """
        path = self.path / self.file(chunk)
        if not os.path.lexists(path):
            return None
        try:
            content = pyarrow.BufferReader(read_bytes(path))
            table = parquet.ParquetFile(content, page_checksum_verification=True).read()
            if table.schema.equals(self._columns) and np.array_equal(table['run'], chunk):
                return table
            reason = 'it has other rows or columns'
        except (CtcError, ValueError, pyarrow.ArrowException, OSError) as error:
            reason = ' '.join(str(error).split())
        show(f'{path}: the file is damaged ({reason}); it is computed again')
        with writing(path):
            path.unlink()
        return None

    def write(self, table: pyarrow.Table, name: str) -> None:
        """Write a table as a file of this directory."""
        with self.folder.replacing(name) as stream:
            write_table(table, stream)

    def merge(self, table: pyarrow.Table) -> pyarrow.Table:
        """Write and return all rows in order."""
        table = table.sort_by('run').combine_chunks()
        self.write(table, f'{self._command}.parquet')
        return table


def write_table(table: pyarrow.Table, stream: BinaryIO) -> None:
    """Write a table whose pages have checksums."""
    parquet.write_table(table, stream, compression='zstd', write_page_checksum=True)


def _existing_key(path: Path, command: str) -> str:
    """Return the key of the table there, or an empty text."""
    file = path / f'{command}.json'
    if not os.path.lexists(file):
        return ''
    with as_ctc_error(f'{file}: cannot be read'):
        return str(json.loads(read_text(file))['key'])


@contextmanager
def open_directory(path: Path, metadata: Mapping[str, Any], columns: pyarrow.Schema,
                   overwrite: bool = False, command: str = 'map') -> Iterator[Directory]:
    """
    Hold the directory of a table for this process.

    The same table is continued where it is. A table that replaces another one is made beside it.
    It takes its place when the context ends without an error, and can be continued after one.

    Parameters
    ----------
    path : Path
        Created if it does not exist.
    metadata, columns, command
        As `Directory` takes them.
    overwrite : bool
        Replace a table that is there, the same or another one.

    Raises
    ------
    CtcError
        If another table is there, or anything that ``ctc`` has not written. If another process
        holds the directory, or it cannot be written.

    """
    owner = f'ctc {command}'
    check_owner(path, owner)
    target = path.resolve()
    with held(target, owner) as folder:
        contents = read_contents(target)
        for name in contents.changed:
            if not name.startswith(f'{SHARDS}/'):  # These are computed again.
                raise CtcError(f'{path / name}: was changed since {owner} wrote it; move it '
                               'away, or choose another --out')
        if not overwrite and _existing_key(target, command) not in ('', metadata['key']):
            raise CtcError(f'{path}: there is output of {owner} for another spec or version; '
                           'choose another --out, or replace it with --overwrite')
        if not overwrite or not contents.output:
            yield Directory(folder, metadata, columns, command)
            return
        with beside(target, owner) as new:
            if _existing_key(new.path, command) != metadata['key']:
                new.begin()
            yield Directory(new, metadata, columns, command)
            new.take_place(target)
