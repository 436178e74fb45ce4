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
The directory of a table: a parquet file per chunk of runs, one of all rows, and what they are of.

A process that is killed leaves whole files only. The name of a chunk's file is a key of all that
its rows depend on, the text of the package among it; a file that is damaged is noticed by
parquet's checksums and computed again.
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
from ctc_chattering.runs.points import Points
import numpy as np
import numpy.typing as npt
import pyarrow
from pyarrow import parquet

#: Names in the directory.
SHARDS, TABLE, JSON, FIGURES, PAGE = (
    'shards', 'map.parquet', 'map.json', 'figures', 'index.html')
#: Control steps of a chunk, with the step of the file, times the square of the number of joints:
#: a second of work, half a minute where it is plain Python.
_STEPS = 4e6
#: Number of chunks, where there are as many runs, so that as many workers have work.
_FEWEST = 64
#: Numbers of runs, ascending.
Numbers = Sequence[int] | npt.NDArray[np.int64]


@cache
def version() -> str:
    """Return the version of the package and a word that changes with its text."""
    package, text = Path(ctc_chattering.__file__).parent, hashlib.sha256()
    for path in sorted(package.rglob('*.py')):
        text.update(path.read_bytes())
    return f'{ctc_chattering.__version__}+{text.hexdigest()[:12]}'


def schema(points: Points) -> pyarrow.Schema:
    """Return the columns of the results, with the unit of each that has one."""
    return pyarrow.schema([
        pyarrow.field(name, pyarrow.type_for_alias(kind),
                      metadata={'unit': unit} if unit else None)
        for name, (kind, unit) in points.types.items()])


def about(points: Points) -> dict[str, Any]:
    """Return what a table is of, as JSON has it; its ``key`` tells it from all others."""
    versions = {'ctc_chattering': version(), 'numpy': np.__version__,
                'pyarrow': pyarrow.__version__}
    return {'key': _key([points.contents, version()]), 'spec': finite(points.contents),
            'versions': versions}


def _key(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:32]


def chunks(points: Points, numbers: Numbers) -> list[npt.NDArray[np.int64]]:
    """
    Return runs, ascending numbers, in chunks of so many steps each, fewer of few runs.

    Their size depends on nothing but what is run and the number of runs.
    """
    n, plant = len(points.robot.controller.joint_names), points.robot.plant
    steps = plant.duration / min(plant.control_period, plant.integration_step)
    size = max(1, int(min(_STEPS / (n ** 2 * steps), -(-len(numbers) // _FEWEST))))
    return np.split(np.asarray(numbers), range(size, len(numbers), size))


def compute(points: Points, made_by: str, chunk: Numbers) -> pyarrow.Table:
    """
    Return the rows of a chunk; what they need is compiled first, if it is not on this machine.

    Parameters
    ----------
    points : Points
        A map, a comparison, or candidates for gains on their draws.
    made_by : str
        `version` of the process that asks, and may be on another machine; empty for one that has
        compiled what is needed.
    chunk : sequence of int
        Numbers of the runs.

    Raises
    ------
    CtcError
        If this process has another version of the package.

    """
    if made_by and made_by != version():
        raise CtcError(f'a worker has version {version()} of ctc_chattering, not {made_by}; '
                       'install the same one everywhere')
    if made_by:
        _compile(points)
    return pyarrow.Table.from_pylist([points.row(int(run)) for run in chunk], schema(points))


@lru_cache(1)
def _compile(points: Any) -> None:
    """Compile what runs need; a process that has many chunks of them asks once."""
    compile_setups(points.examples(), lambda _: None)


class Directory:
    """
    The directory of a table.

    Parameters
    ----------
    folder : OutputFolder
        Which only this process writes.
    about : mapping
        As `about` returns it.
    columns : pyarrow.Schema
        Of all rows.
    kind : str
        What `Points` are: ``map`` or ``compare``.

    """

    def __init__(self, folder: OutputFolder, about: Mapping[str, Any], columns: pyarrow.Schema,
                 kind: str) -> None:
        self.folder, self.path, self.key = folder, folder.path, about['key']
        self._columns, self._kind = columns, kind
        if not _key_there(folder.path, kind):
            text = json.dumps(about, indent=2, ensure_ascii=False) + '\n'
            with folder.replacing(f'{kind}.json') as stream:
                stream.write(text.encode())

    def file(self, chunk: Numbers) -> str:
        """Return the file of a chunk, whose name changes with all that the rows depend on."""
        return f'{SHARDS}/{_key([self.key, *map(int, chunk)])}.parquet'

    def rows(self, chunk: Numbers, show: Callable[[str], None]) -> pyarrow.Table | None:
        """Return the rows of a chunk; None if there are none. `show` takes a line on damage."""
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
        show(f'{path}: damaged, {reason}; it is computed again')
        with writing(path):
            path.unlink()
        return None

    def write(self, table: pyarrow.Table, name: str) -> None:
        """Write a table as a file of this directory."""
        with self.folder.replacing(name) as stream:
            write_table(table, stream)

    def merge(self, table: pyarrow.Table) -> pyarrow.Table:
        """Write and return all rows in the order of the runs."""
        table = table.sort_by('run').combine_chunks()
        self.write(table, f'{self._kind}.parquet')
        return table


def write_table(table: pyarrow.Table, stream: BinaryIO) -> None:
    """Write a table whose pages have checksums."""
    parquet.write_table(table, stream, compression='zstd', write_page_checksum=True)


def _key_there(path: Path, kind: str) -> str:
    """Return the key of the table in a directory; empty without one."""
    file = path / f'{kind}.json'
    if not os.path.lexists(file):
        return ''
    with as_ctc_error(f'{file}: cannot be read'):
        return str(json.loads(read_text(file))['key'])


@contextmanager
def opened(path: Path, about: Mapping[str, Any], columns: pyarrow.Schema, overwrite: bool = False,
           kind: str = 'map') -> Iterator[Directory]:
    """
    Hold the directory of a table for this process alone, however that ends.

    The same table is continued where it is. Instead of another one, it is made beside it, and
    takes its place when the context ends without an error; after an error it can be continued.

    Parameters
    ----------
    path : Path
        Made if it does not exist.
    about, columns, kind
        As `Directory` takes them.
    overwrite : bool
        Replace a table that is there, the same or another one.

    Raises
    ------
    CtcError
        If another table is there, or anything that ``ctc`` has not written; if another process
        holds the directory, or it cannot be written.

    """
    command = f'ctc {kind}'
    check_owner(path, command)
    place = path.resolve()
    with held(place, command) as folder:
        contents = read_contents(place)
        for name in contents.changed:
            if not name.startswith(f'{SHARDS}/'):  # These are computed again.
                raise CtcError(f'{path / name}: was changed since {command} wrote it; move it '
                               'away, or choose another --out')
        if not overwrite and _key_there(place, kind) not in ('', about['key']):
            raise CtcError(f'{path}: the output of {command} of another spec or version is '
                           'there; choose another --out, or --overwrite')
        if not overwrite or not contents.output:
            yield Directory(folder, about, columns, kind)
            return
        with beside(place, command) as new:
            if _key_there(new.path, kind) != about['key']:
                new.begin()
            yield Directory(new, about, columns, kind)
            new.take_place(place)
