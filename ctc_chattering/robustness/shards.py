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
The directory of a map: a parquet file per chunk, then one of all rows, and what they are of.

Every file is written under another name and renamed, so that a process that is killed leaves whole
files only. The name of a chunk's file is its key and the digest of its bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
import hashlib
import json
import os
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.output import prepare, write_text, writing
from ctc_chattering.errors import CtcError, refused_as
import numpy as np
import pyarrow
from pyarrow import parquet

#: Names in the directory.
SHARDS, TABLE, JSON, FIGURES, PAGE = 'shards', 'map.parquet', 'map.json', 'figures', 'index.html'
_NAMES = (SHARDS, TABLE, JSON, FIGURES, PAGE)
#: Rows of a row group of the table of all runs, but for its last.
_GROUP = 100_000
#: Of all files.
_FORMAT: dict[str, Any] = {'compression': 'zstd', 'write_page_checksum': True}
#: Key and runs of a chunk.
Part = tuple[str, Sequence[int]]


class Damaged(CtcError):
    """A file that is not as it was written."""


class Directory:
    """
    The directory of a map.

    Parameters
    ----------
    path : Path
        Created if it does not exist.
    about : mapping
        What the map is of, for `JSON`; ``key`` tells one map from another, ``spec`` says of what.
    overwrite : bool
        Remove what is there, of this map or of another, first.

    Raises
    ------
    CtcError
        If another map is there, or the directory cannot be written.

    """

    def __init__(self, path: Path, about: Mapping[str, Any], overwrite: bool = False) -> None:
        self.path, self.about = path, about
        if overwrite or not (path / JSON).exists():
            prepare(path, _NAMES, overwrite)
            self.describe(about)
        elif (there := read_about(path)).get('key') != about['key']:
            same = _made_by(there) == _made_by(about)
            other = ('of another spec' if same else
                     'of another version of ctc_chattering')
            raise CtcError(f'{path}: a map {other} is there; choose another --out, or --overwrite')
        with writing(path):
            (path / SHARDS).mkdir(exist_ok=True)
            self._files = {x.name.split('.')[0]: x
                           for x in sorted((path / SHARDS).glob('[!.]*.*.parquet'))}

    def write(self, key: str, table: pyarrow.Table) -> None:
        """Write the rows of a chunk; the name of the file has the digest of its bytes."""
        sink = pyarrow.BufferOutputStream()
        parquet.write_table(table, sink, **_FORMAT)
        content = sink.getvalue()
        path = self.path / SHARDS / f'{key}.{_digest(content)}.parquet'
        with _replacing(path) as temporary:
            temporary.write_bytes(content)
        self._files[key] = path

    def read(self, key: str, runs: Sequence[int], schema: pyarrow.Schema) -> pyarrow.Table | None:
        """
        Return the rows of a chunk, checked; None if it is not there.

        Parameters
        ----------
        key : str
            Of the chunk.
        runs : sequence of int
            Numbers of its runs.
        schema : pyarrow.Schema
            Of its rows.

        Raises
        ------
        Damaged
            If the file is not as it was written; it is removed.

        """
        path = self._files.get(key)
        if path is None:
            return None
        try:
            return checked(path, runs, schema)
        except Damaged as error:
            with writing(path):
                path.unlink(missing_ok=True)
            del self._files[key]
            raise Damaged(f'{error}; it is removed, to be computed again') from None

    def missing(self, parts: Sequence[Part], schema: pyarrow.Schema,
                show: Callable[[str], None]) -> list[Part]:
        """Return which chunks are to be computed; `show` takes a line for each damaged one."""
        found = []
        for key, runs in parts:
            try:
                there = self.read(key, runs, schema) is not None
            except Damaged as error:
                show(str(error))
                there = False
            if not there:
                found.append((key, runs))
        return found

    def merge(self, parts: Sequence[Part], schema: pyarrow.Schema) -> pyarrow.Table:
        """
        Write and return all rows in the order of the runs, the same bytes for any chunks.

        Raises
        ------
        CtcError
            If a chunk is missing or damaged; nothing is written then.

        """
        rows = self.rows(parts, schema)
        if not all(isinstance(runs, range) for _, runs in parts):
            rows = rows.sort_by('run')
        with _replacing(self.path / TABLE) as temporary:
            parquet.write_table(rows.replace_schema_metadata(self._metadata()), temporary,
                                row_group_size=_GROUP, **_FORMAT)
        for left in (self.path / SHARDS).glob('.*'):
            left.unlink(missing_ok=True)
        return rows

    def rows(self, parts: Sequence[Part], schema: pyarrow.Schema) -> pyarrow.Table:
        """Return the rows of chunks, in their order; raise `CtcError` as `merge` does."""
        return pyarrow.concat_tables(self._tables(parts, schema)).combine_chunks()

    def _tables(self, parts: Sequence[Part], schema: pyarrow.Schema) -> Iterator[pyarrow.Table]:
        """Yield the rows of each chunk."""
        for key, runs in parts:
            table = self.read(key, runs, schema)
            if table is None:
                raise CtcError(f'{self.path}: runs {runs[0]} to {runs[-1]} are missing')
            yield table

    def _metadata(self) -> dict[str, str]:
        """Return what `about` says of the rows, as JSON; draws are in their columns."""
        spec = dict(self.about['spec'])
        spec['uncertain'] = [{name: x for name, x in tree.items() if name != 'draws'}
                             for tree in spec.get('uncertain', ())]
        return {name: json.dumps(x, ensure_ascii=False, sort_keys=True) for name, x in (
            ('spec', spec), ('versions', self.about.get('versions')))}

    def describe(self, about: Mapping[str, Any]) -> None:
        """Write what the map is of, and what came of it."""
        with _replacing(self.path / JSON) as temporary:
            write_text(temporary, json.dumps(about, indent=2, ensure_ascii=False) + '\n')


def read_about(directory: Path) -> dict[str, Any]:
    """Return what the map of a directory is of; raise `CtcError` if that cannot be read."""
    path = directory / JSON
    try:
        about = json.loads(path.read_text(encoding='utf-8'))
    except (OSError, ValueError) as error:
        raise CtcError(f'{path}: cannot be read: {error}') from None
    return about if isinstance(about, dict) else {}


def checked(path: Path, runs: Sequence[int], schema: pyarrow.Schema) -> pyarrow.Table:
    """
    Return the rows of a shard.

    Raises
    ------
    Damaged
        If it is not as it was written, or does not have the rows of the runs.
    CtcError
        If the machine cannot read it.

    """
    with refused_as(f'{path}: cannot be read'):
        content = path.read_bytes()
        if _digest(content) != path.name.split('.')[1]:
            raise Damaged(f'{path}: damaged, its bytes have changed')
        try:
            return _rows(pyarrow.BufferReader(content), runs, schema)
        except ValueError as error:
            raise Damaged(f'{path}: damaged, {error}') from None


def _rows(source: Any, runs: Sequence[int], schema: pyarrow.Schema) -> pyarrow.Table:
    """Return the rows of a file; raise `ValueError` unless they are those of the runs."""
    table = parquet.read_table(source, partitioning=None, page_checksum_verification=True)
    if not table.schema.equals(schema):
        raise ValueError('it has other columns')
    if not np.array_equal(table['run'], runs):
        raise ValueError(f'its {len(table)} rows are not runs {runs[0]} to {runs[-1]}')
    return table


def file_digest(path: Path) -> str:
    """Return SHA-256 of a file, as ``sha256sum`` prints it."""
    found = hashlib.sha256()
    with path.open('rb') as stream:
        while block := stream.read(1 << 20):
            found.update(block)
    return found.hexdigest()


def _made_by(about: Mapping[str, Any]) -> object:
    """Return the version of the package that made a map."""
    versions = about.get('versions')
    return versions.get('ctc_chattering') if isinstance(versions, dict) else None


def _digest(content: bytes | pyarrow.Buffer) -> str:
    return hashlib.sha256(content).hexdigest()[:32]


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """Yield another name for a file, that is given its own once it is on the disk."""
    temporary = path.with_name(f'.{path.name}.{os.getpid()}')
    with writing(path):
        yield temporary
        with temporary.open('rb') as stream:
            os.fsync(stream.fileno())
        temporary.replace(path)
