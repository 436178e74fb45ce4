"""
The directory of a map: a parquet file per chunk, then one of all rows, and what they are of.

Every file is written under another name and renamed, so that a process that is killed leaves whole
files only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
import json
import os
from pathlib import Path
from typing import Any

import pyarrow
from pyarrow import parquet

from ctc_chattering.analysis.output import prepare, write_text, writing
from ctc_chattering.errors import CtcError

#: Names in the directory.
SHARDS, TABLE, JSON, FIGURES, PAGE = 'shards', 'map.parquet', 'map.json', 'figures', 'index.html'
_NAMES = (SHARDS, TABLE, JSON, FIGURES, PAGE)
#: Least rows of a row group of the table of all runs, but for its last.
_GROUP = 100_000


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
        self.path = path
        if overwrite or not (path / JSON).exists():
            prepare(path, _NAMES, overwrite)
            self.describe(about)
        elif (there := read_about(path)).get('key') != about['key']:
            other = ('of another version of ctc_chattering or engine'
                     if there.get('spec') == about['spec'] else 'of another spec')
            raise CtcError(f'{path}: a map {other} is there; choose another --out, or --overwrite')
        with writing(path):
            (path / SHARDS).mkdir(exist_ok=True)

    def shard(self, key: str) -> Path:
        """Return the file of the chunk with this key."""
        return self.path / SHARDS / f'{key}.parquet'

    def has(self, key: str) -> bool:
        """Return whether a chunk is there."""
        return self.shard(key).exists()

    def write(self, key: str, table: pyarrow.Table) -> None:
        """Write the rows of a chunk."""
        with _replacing(self.shard(key)) as temporary:
            parquet.write_table(table, temporary, compression='zstd')

    def merge(self, keys: Sequence[str], schema: pyarrow.Schema) -> pyarrow.Table:
        """Write and return all rows, in the order of the keys of their chunks."""
        with (_replacing(self.path / TABLE) as temporary,
              parquet.ParquetWriter(temporary, schema, compression='zstd') as writer):
            waiting: list[pyarrow.Table] = []
            for key in keys:
                waiting.append(read_table(self.shard(key)))
                if key == keys[-1] or sum(map(len, waiting)) >= _GROUP:
                    writer.write_table(pyarrow.concat_tables(waiting))
                    waiting = []
        for path in (self.path / SHARDS).glob('.*'):
            path.unlink(missing_ok=True)
        return read_table(self.path / TABLE)

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


def read_table(path: Path) -> pyarrow.Table:
    """Return the rows of a file; raise `CtcError` if it is none of ours."""
    try:
        return parquet.read_table(path, partitioning=None)
    except (OSError, pyarrow.ArrowException) as error:
        text = ' '.join(str(error).split())
        raise CtcError(f'{path}: cannot be read, delete it and start again: {text}') from None


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """Yield another name for a file, that is given its own once it is on the disk."""
    temporary = path.with_name(f'.{path.name}.{os.getpid()}')
    with writing(path):
        yield temporary
        with temporary.open('rb') as stream:
            os.fsync(stream.fileno())
        temporary.replace(path)
