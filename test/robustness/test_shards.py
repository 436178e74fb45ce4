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

"""The directory of a map: whole files, of one map, merged in order."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from ctc_chattering.errors import CtcError, MachineError
from ctc_chattering.robustness import chunks, shards
from ctc_chattering.robustness.shards import (
    checked,
    Damaged,
    Directory,
    file_digest,
    read_about,
)
from map_specs import runs
import numpy as np
import pyarrow
from pyarrow import parquet
import pytest

SCHEMA = pyarrow.schema([('run', 'int64'), ('error', 'float64')])
ABOUT = {'key': 'one', 'spec': {'a': 1}}


def rows(*runs: int) -> Any:
    return pyarrow.Table.from_pylist([{'run': k, 'error': k or None} for k in runs], SCHEMA)


def merged(made: Directory, *parts: tuple[str, range]) -> Any:
    return made.merge(parts, SCHEMA)


def only(made: Directory) -> Path:
    (path,) = (made.path / 'shards').glob('*.parquet')
    return path


def test_rows_come_in_the_order_of_the_chunks(tmp_path: Path) -> None:
    made = Directory(tmp_path / 'map', ABOUT)
    made.write('b', rows(0, 1))
    made.write('a', rows(2, 3))
    table = merged(made, ('b', range(2)), ('a', range(2, 4)))
    assert table == parquet.read_table(tmp_path / 'map' / 'map.parquet')
    assert table.to_pylist() == [{'run': k, 'error': k or None} for k in range(4)]


@pytest.mark.parametrize('group', [3, 4, 100])
def test_any_chunks_give_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                        group: int) -> None:
    """Check groups of one number of rows, but for the last, with nothing lost."""
    monkeypatch.setattr(shards, '_GROUP', group)
    files = set()
    for size in (1, 2, 5, 10):
        made = Directory(tmp_path / f'{size}', ABOUT)
        parts = [(f'{k}', range(k, min(k + size, 10))) for k in range(0, 10, size)]
        for key, part in parts:
            made.write(key, rows(*part))
        assert merged(made, *parts)['run'].to_pylist() == list(range(10))
        files.add((made.path / 'map.parquet').read_bytes())
    assert len(files) == 1
    about = parquet.ParquetFile(made.path / 'map.parquet').metadata
    assert [about.row_group(k).num_rows for k in range(about.num_row_groups)] == [
        len(range(k, min(k + group, 10))) for k in range(0, 10, group)]


def test_equal_rows_are_equal_bytes_under_equal_names(tmp_path: Path) -> None:
    files = []
    for name in ('a', 'b'):
        made = Directory(tmp_path / name, ABOUT)
        made.write('x', rows(*range(100)))
        merged(made, ('x', range(100)))
        files.append([(x.name, x.read_bytes()) for x in (only(made), made.path / 'map.parquet')])
    assert files[0] == files[1]
    assert only(made).name == f'x.{hashlib.sha256(files[0][0][1]).hexdigest()[:32]}.parquet'
    assert file_digest(made.path / 'map.parquet') == hashlib.sha256(files[0][1][1]).hexdigest()


def test_every_bit_counts(tmp_path: Path) -> None:
    """Flip each 97th bit, those of pages, footer and schema alike; nothing is read changed."""
    made = Directory(tmp_path, ABOUT)
    made.write('x', rows(*range(500)))
    path = only(made)
    content = path.read_bytes()
    for bit in range(0, 8 * len(content), 97):
        changed = bytearray(content)
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        with pytest.raises(Damaged, match=f'^{path}: damaged, its bytes have changed$'):
            checked(path, range(500), SCHEMA)
    path.write_bytes(content)
    assert len(checked(path, range(500), SCHEMA)) == 500


def test_pages_have_checksums_for_other_readers(tmp_path: Path) -> None:
    """Flip a bit within the numbers of the last column, which without a checksum are read."""
    made = Directory(tmp_path, ABOUT)
    values = np.random.default_rng(0).random(500)
    made.write('x', pyarrow.table({'run': np.arange(500), 'error': values}, SCHEMA))
    merged(made, ('x', range(500)))
    path = tmp_path / 'map.parquet'
    content = bytearray(path.read_bytes())
    column = parquet.ParquetFile(path).metadata.row_group(0).column(1)
    start = column.dictionary_page_offset or column.data_page_offset
    content[start + column.total_compressed_size // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(OSError, match='CRC checksum'):
        parquet.read_table(path, page_checksum_verification=True)


def test_a_damaged_chunk_is_named_removed_and_missing(tmp_path: Path) -> None:
    Directory(tmp_path, ABOUT).write('a', rows(0, 1))
    made = Directory(tmp_path, ABOUT)
    made.write('b', rows(2, 3))
    parts, lines = [('a', range(2)), ('b', range(2, 4)), ('c', range(4, 5))], list[str]()
    path = next((tmp_path / 'shards').glob('a.*'))
    path.write_bytes(path.read_bytes()[:-9])
    assert made.missing(parts, SCHEMA, lines.append) == [parts[0], parts[2]]
    assert lines == [f'{path}: damaged, its bytes have changed; it is removed, to be computed '
                     'again']
    assert not path.exists()
    with pytest.raises(CtcError, match='runs 0 to 1 are missing'):
        merged(made, *parts)
    assert not (tmp_path / 'map.parquet').exists()


@pytest.mark.parametrize(('there', 'expected', 'word'), [
    ((0, 1), range(3), 'its 2 rows are not runs 0 to 2'),
    ((0, 1, 2), range(2), 'its 3 rows are not runs 0 to 1'),
    ((0, 2), range(2), 'its 2 rows are not runs 0 to 1')])
def test_rows_are_counted(tmp_path: Path, there: tuple[int, ...], expected: range, word: str
                          ) -> None:
    """Check whole files with other runs than they must have."""
    made = Directory(tmp_path, ABOUT)
    made.write('a', rows(*there))
    path = only(made)
    with pytest.raises(Damaged, match=word):
        merged(made, ('a', expected))
    assert not path.exists()
    made.write('a', rows(*there).append_column('more', pyarrow.array(there)))
    with pytest.raises(Damaged, match='other columns'):
        merged(made, ('a', expected))


def test_what_cannot_be_read_is_not_removed(tmp_path: Path) -> None:
    """Check with a directory in place of the file."""
    made = Directory(tmp_path, ABOUT)
    made.write('a', rows(0))
    path = only(made)
    path.unlink()
    path.mkdir()
    with pytest.raises(MachineError, match='cannot be read: IsADirectoryError'):
        merged(made, ('a', range(1)))
    assert path.exists()


def test_what_was_begun_and_killed_is_no_shard(tmp_path: Path) -> None:
    """Check that the remains of a killed process are neither read nor kept."""
    remains = Directory(tmp_path, ABOUT).path / 'shards' / '.a.0.parquet.123'
    remains.write_bytes(b'half of a f')
    made = Directory(tmp_path, ABOUT)
    parts = [('a', range(1))]
    assert made.missing(parts, SCHEMA, print) == parts
    made.write('a', rows(0))
    merged(made, *parts)
    assert list((tmp_path / 'shards').iterdir()) == [only(made)]


def test_a_map_goes_on_and_another_is_refused(tmp_path: Path) -> None:
    Directory(tmp_path, ABOUT).write('a', rows(0))
    parts = [('a', range(1))]
    assert Directory(tmp_path, ABOUT).missing(parts, SCHEMA, print) == []
    for more, other in (({}, 'of another spec'),
                        ({'versions': {'ctc_chattering': '0'}}, 'of another version')):
        with pytest.raises(CtcError, match=f'a map {other}.* another --out, or --overwrite'):
            Directory(tmp_path, {**ABOUT, **more, 'key': 'two'})
        assert list((tmp_path / 'shards').iterdir())
    (tmp_path / 'mine.txt').touch()
    made = Directory(tmp_path, {'key': 'two', 'spec': {}}, overwrite=True)
    assert made.missing(parts, SCHEMA, print) == parts
    assert read_about(tmp_path)['key'] == 'two'
    assert (tmp_path / 'mine.txt').exists()


def test_what_is_there_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / 'map.parquet').touch()
    with pytest.raises(CtcError, match=r'map\.parquet: exists already'):
        Directory(tmp_path, ABOUT)
    assert not (tmp_path / 'map.json').exists()


@pytest.mark.parametrize('content', [b'', b'PAR1 and no more', b'[1]'])
def test_a_damaged_list_of_contents_is_named(tmp_path: Path, content: bytes) -> None:
    (tmp_path / 'map.json').write_bytes(content)
    with pytest.raises(CtcError, match=r'map\.json: cannot be read|a map of another'):
        Directory(tmp_path, {**ABOUT, 'versions': {'ctc_chattering': '1'}})


def test_metadata_say_what_it_is(tmp_path: Path) -> None:
    """Read spec, versions and units back by pyarrow; the draws are rows, not metadata."""
    made = runs()
    about, schema = chunks.about(made), chunks.schema(made.spec)
    directory = Directory(tmp_path, about)
    directory.write('a', chunks.compute(made, chunks.version(), range(2)))
    directory.merge([('a', range(2))], schema)
    found = parquet.read_schema(tmp_path / 'map.parquet')
    said = {name.decode(): json.loads(x) for name, x in found.metadata.items()}
    assert said['versions'] == about['versions']
    assert {'ctc_chattering', 'python', 'numpy', 'numba', 'pyarrow'} <= set(said['versions'])
    (model,) = said['spec'].pop('uncertain')
    assert model == {x: y for x, y in about['spec']['uncertain'][0].items() if x != 'draws'}
    assert said['spec'] == {x: y for x, y in about['spec'].items() if x != 'uncertain'}
    units = {field.name: field.metadata[b'unit'].decode() for field in found if field.metadata}
    assert units == {
        'friction': 'N*m', 'rate': 's', 'error': 'rad', 'variation': 'N*m/s', 'slips': '1/s',
        'max_error_norm1_rad': 'rad', 'reaching_time_s': 's', **{
            f'{name}_{i}': unit for i in (1, 2) for name, unit in (
                ('rms_error_rad', 'rad'), ('rms_torque_nm', 'N*m'),
                ('torque_variation_nm_per_s', 'N*m/s'), ('max_torque_step_nm', 'N*m'),
                ('max_torque_rate_nm_per_s', 'N*m/s'))}}
