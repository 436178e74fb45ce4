"""The directory of a map: whole files, of one map, merged in order."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow
from pyarrow import parquet
import pytest

from ctc_chattering.errors import CtcError
from ctc_chattering.robustness import shards
from ctc_chattering.robustness.shards import Directory, read_about, read_table

SCHEMA = pyarrow.schema([('run', 'int64'), ('error', 'float64')])
ABOUT = {'key': 'one', 'spec': {'a': 1}}


def rows(*runs: int) -> Any:
    return pyarrow.Table.from_pylist([{'run': k, 'error': k or None} for k in runs], SCHEMA)


def test_rows_come_in_the_order_of_the_keys(tmp_path: Path) -> None:
    made = Directory(tmp_path / 'map', ABOUT)
    made.write('b', rows(0, 1))
    made.write('a', rows(2, 3))
    assert made.has('a')
    assert not made.has('c')
    table = made.merge(['b', 'a'], SCHEMA)
    assert table == read_table(tmp_path / 'map' / 'map.parquet')
    assert table.to_pylist() == [{'run': k, 'error': k or None} for k in range(4)]


def test_chunks_share_groups_of_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Check groups of three rows or more, but for the last, with nothing lost."""
    monkeypatch.setattr(shards, '_GROUP', 3)
    made = Directory(tmp_path, ABOUT)
    for k in range(5):
        made.write(str(k), rows(2 * k, 2 * k + 1))
    table = made.merge([str(k) for k in range(5)], SCHEMA)
    assert table['run'].to_pylist() == list(range(10))
    about = parquet.ParquetFile(tmp_path / 'map.parquet').metadata
    assert [about.row_group(k).num_rows for k in range(about.num_row_groups)] == [4, 4, 2]


def test_equal_rows_are_equal_bytes(tmp_path: Path) -> None:
    files = []
    for name in ('a', 'b'):
        made = Directory(tmp_path / name, ABOUT)
        made.write('x', rows(*range(100)))
        made.merge(['x'], SCHEMA)
        files.append([made.shard('x').read_bytes(), (made.path / 'map.parquet').read_bytes()])
    assert files[0] == files[1]


def test_what_was_begun_and_killed_is_no_shard(tmp_path: Path) -> None:
    """Check that the remains of a killed process are neither read nor kept."""
    made = Directory(tmp_path, ABOUT)
    remains = made.path / 'shards' / '.a.parquet.123'
    remains.write_bytes(b'half of a f')
    assert not made.has('a')
    made.write('a', rows(0))
    made.merge(['a'], SCHEMA)
    assert [x.name for x in (made.path / 'shards').iterdir()] == ['a.parquet']


def test_a_map_goes_on_and_another_is_refused(tmp_path: Path) -> None:
    Directory(tmp_path, ABOUT).write('a', rows(0))
    assert Directory(tmp_path, ABOUT).has('a')
    for about, other in (({'key': 'two', 'spec': {'a': 2}}, 'of another spec'),
                         ({'key': 'two', 'spec': {'a': 1}}, 'of another version')):
        with pytest.raises(CtcError, match=f'a map {other}.* another --out, or --overwrite'):
            Directory(tmp_path, about)
        assert (tmp_path / 'shards' / 'a.parquet').exists()
    (tmp_path / 'mine.txt').touch()
    made = Directory(tmp_path, {'key': 'two', 'spec': {}}, overwrite=True)
    assert not made.has('a')
    assert read_about(tmp_path)['key'] == 'two'
    assert (tmp_path / 'mine.txt').exists()


def test_what_is_there_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / 'map.parquet').touch()
    with pytest.raises(CtcError, match=r'map\.parquet: exists already'):
        Directory(tmp_path, ABOUT)
    assert not (tmp_path / 'map.json').exists()


@pytest.mark.parametrize('content', [b'', b'PAR1 and no more', b'[1]'])
def test_damaged_files_are_named(tmp_path: Path, content: bytes) -> None:
    made = Directory(tmp_path, ABOUT)
    made.shard('a').write_bytes(content)
    with pytest.raises(CtcError, match=r'a\.parquet: cannot be read, delete it and start again'):
        made.merge(['a'], SCHEMA)
    assert not (tmp_path / 'map.parquet').exists()
    (tmp_path / 'map.json').write_bytes(content)
    with pytest.raises(CtcError, match=r'map\.json: cannot be read|a map of another spec'):
        Directory(tmp_path, ABOUT)
