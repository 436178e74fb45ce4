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

"""Refined maps: the boundary of the whole grid with a tenth of the runs, and the same rows."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ctc_chattering.runs import store
from ctc_chattering.runs.map_data import MapData
from ctc_chattering.runs.run_lists import FAILS, MapRuns, next_points, PASSES, UNKNOWN
from ctc_chattering.runs.store import Directory
from map_specs import runs
import numpy as np
import pyarrow
import pytest
from scipy.ndimage import distance_transform_edt  # type: ignore[import-untyped]

AXIS: dict[str, Any] = {'parameter': 'plant.coulomb_friction', 'range': [1, 33], 'count': 33}
KA: dict[str, Any] = {'parameter': 'controller.ka', 'range': [1, 33], 'count': 33}


def refined(fails: Callable[..., Any], shape: tuple[int, ...], coarse: tuple[int, ...]) -> Any:
    """Return the state of a grid in which a rule says what fails, when nothing is wanted."""
    state = np.full(shape, UNKNOWN, np.int8)
    while (more := next_points(state, coarse)).any():
        state[more] = np.where(fails(*np.nonzero(more)), FAILS, PASSES)
    return state


def filled(state: Any, along: tuple[float, ...] = (1.0, 1.0)) -> Any:
    """Return the state with each unknown point as the nearest known one."""
    return state[tuple(distance_transform_edt(
        state == UNKNOWN, along, return_distances=False, return_indices=True))]


def within(x: Any, y: Any) -> Any:
    """Return whether points are in a circle that the grid cuts, and not in one within it."""
    return ((x - 80) ** 2 + (y - 99) ** 2 < 140 ** 2) & (
        (x - 120) ** 2 + (y - 120) ** 2 > 40 ** 2)


def test_a_boundary_takes_a_tenth_of_the_runs() -> None:
    """Each of 66049 points is on its side of two circles, and fewer than 6605 were run."""
    state = refined(within, (257, 257), (16, 16))
    assert (filled(state) == within(*np.indices((257, 257)))).all()
    assert (state != UNKNOWN).sum() < 257 ** 2 / 10


def test_a_boundary_between_two_points_of_the_coarse_grid_is_followed_from_elsewhere() -> None:
    """A tongue narrower than a cell that begins in a mixed one; an island alone is not found."""
    def tongue(x: Any, y: Any) -> Any:
        return (np.abs(y - 20) < 2) & (x < 27)

    assert (filled(refined(lambda x, y: tongue(x, y) | (x < 3), (33, 33), (8, 8)))
            == tongue(*np.indices((33, 33))) | (np.indices((33, 33))[0] < 3)).all()
    island = refined(tongue, (33, 33), (8, 8))
    assert (island != FAILS).all()
    assert (island != UNKNOWN).sum() == 25


def rows(made: MapRuns, numbers: Any) -> pyarrow.Table:
    """Return rows of runs that fail where friction exceeds ka, for one law twice that."""
    def failure(x: dict[str, Any]) -> str:
        return 'error' * bool(x['friction'] > x['ka'] * (1 + (x['law'] == 'chattering')))
    return pyarrow.Table.from_pylist([
        {**which, 'failure': failure(which), 'error': 1.0} for which in map(
            made.columns, numbers)], store.table_schema(made))


def mapped(made: MapRuns, directory: Directory, computed: list[Any]) -> pyarrow.Table:
    """Refine a map as `ctc map` does, chunks in reverse; return its rows."""
    table = store.table_schema(made).empty_table()
    while len(some := made.next_runs(table)):
        chunks = store.chunks(made, some)
        for part in reversed([x for x in chunks if directory.rows(x, print) is None]):
            directory.write(rows(made, part), directory.file(part))
            computed.append(part)
        table = pyarrow.concat_tables([table, *(directory.rows(x, print) for x in chunks)])
    return directory.merge(table)


@pytest.mark.slow
def test_rows_are_those_of_the_whole_map_and_are_not_computed_again(tmp_path: Path) -> None:
    made = runs(axes={'friction': AXIS, 'ka': KA}, refine=3, laws=['compensation', 'chattering'])
    about, first, again = store.table_metadata(made), list[Any](), list[Any]()
    with store.open_directory(tmp_path, about, store.table_schema(made)) as directory:
        table = mapped(made, directory, first)
    before = (tmp_path / 'map.parquet').read_bytes()
    next(tmp_path.glob('shards/*.parquet')).unlink()
    with store.open_directory(tmp_path, about, store.table_schema(made)) as directory:
        assert mapped(made, directory, again).equals(table)
    assert (tmp_path / 'map.parquet').read_bytes() == before
    assert len(again) == 1 < len(first)
    number = table['run'].to_numpy()
    assert (np.diff(number) > 0).all()
    assert len(number) < len(made) / 3
    assert table.equals(rows(made, number.tolist()))
    data = MapData(table, {'friction': 'N*m', 'ka': 'N*m'}, ['model'],
                   refined=['friction', 'ka'])
    expected = np.greater.outer(np.arange(1, 34), np.arange(1, 34))
    assert (data.probability[0] == expected).all()
    assert (data.runs == 2).all()
