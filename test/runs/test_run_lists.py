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

"""Runs of a map: their order, setups and draws, and the refinement of its boundary."""

from __future__ import annotations

from collections.abc import Callable
import itertools
from pathlib import Path
import pickle
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.errors import CtcError
from ctc_chattering.runs import store
from ctc_chattering.runs.map_data import MapData
from ctc_chattering.runs.recommended import recommended_setup
from ctc_chattering.runs.run_lists import (
    draw_quantities,
    draw_unit_cube,
    FAILS,
    MapRuns,
    next_points,
    PASSES,
    UNKNOWN,
)
from ctc_chattering.runs.spec import read_uncertain, Repeats, Uncertain
from ctc_chattering.runs.store import Directory
from map_specs import ON_TRACK, runs
import numpy as np
import pyarrow
import pytest
from scipy import stats  # type: ignore[import-untyped]
from scipy.ndimage import distance_transform_edt  # type: ignore[import-untyped]

FRICTION = Path(__file__).parents[2] / 'config' / 'friction.yaml'


def test_the_order_is_point_law_repeat() -> None:
    found = runs()
    assert len(found) == 24
    expected = list(itertools.product((2, 5, 10), (1e-3, 2e-3), (
        ('compensation', 'compensation', ''), ('chattering implicit', 'chattering', 'implicit')),
        (0, 1)))
    for run, (friction, rate, (variant, law, switching), repeat) in enumerate(expected):
        assert found.columns(run) == {
            'run': run, 'point': run // 4, 'repeat': repeat, 'seed': 7 + repeat,
            'variant': variant, 'law': law, 'switching': switching, 'friction': friction,
            'rate': rate, 'model': found.draws[repeat, 0]}
        assert found.index(run) == ((run // 8, run // 4 % 2), run // 2 % 2, run % 2)


@pytest.mark.parametrize('run', [0, 6, 23])
def test_a_setup_equals_that_of_a_file_with_the_same_values(run: int) -> None:
    """Compare with the file loaded with all values as overrides."""
    found = pickle.loads(pickle.dumps(runs()))
    row = found.columns(run)
    model = row['model']
    law = {'law': 'compensation'} if row['law'] == 'compensation' else {
        'law': 'chattering', 'switching': 'implicit'}
    assert found.setup(run) == parameter_file.load(FRICTION, {
        '/**': {'control_period': row['rate']},
        'plant': {**ON_TRACK, 'velocity_noise': [1e-3, 1e-3], 'duration': 0.1, 'compiled': False,
                  'coulomb_friction': [row['friction']] * 2, 'noise_seed': row['seed']},
        'controller': {**law, 'inertia_scale': model, 'gravity_scale': model}})


def test_axes_override_laws_and_factors_multiply_their_values() -> None:
    soft = {'law': 'chattering', 'ka': [15.0, 20.0], 'name': 'soft'}
    axis = {'parameter': 'controller.ka', 'values': [2]}
    for more, ka in (({}, (2.0, 2.0)), ({'factor': True}, (30.0, 40.0))):
        found = runs(laws=['compensation', soft], axes={'ka': {**axis, **more}})
        assert [found.setup(run).controller.ka for run in (2, 3)] == [ka, ka]


def settings(setup: Setup) -> list[object]:
    c = setup.controller
    return [c.law, c.kp, c.kv, c.ka, c.estimator_bandwidth, c.actuator_lag]


def test_gains_by_rule_know_the_axes_of_the_controller() -> None:
    """Check a lag that only the plant has, a rate that all have, and a gain of an axis."""
    law = {'law': 'observer_feedback', 'recommended': True}
    lag = {'parameter': 'plant.actuator_lag', 'values': [1e-3, 5e-3]}
    period = {'parameter': 'control_period', 'values': [1e-3, 1e-2]}
    found = runs(laws=[law], axes={'lag': lag, 'rate': period}, uncertain=None, repeats=1)
    file = found.spec.setup
    for run, (x, rate) in enumerate(itertools.product(lag['values'], (1e-3, 1e-2))):
        setup = found.setup(run)
        known = file.changed({
            node: {'control_period': rate} for node in ('plant', 'controller', 'reference')})
        assert settings(setup) == settings(recommended_setup(known, 'observer_feedback'))
        assert setup.plant.actuator_lag == (x, x)
        assert setup.values['controller']['kp'] == setup.controller.kp
    assert settings(found.setup(0)) != settings(found.setup(1))
    gain = {'parameter': 'controller.ka', 'values': [3, 4]}
    found = runs(laws=[law], axes={'ka': gain}, uncertain=None, repeats=1)
    made = recommended_setup(found.spec.setup, 'observer_feedback').controller
    assert [found.setup(run).controller.ka for run in (0, 1)] == [(3.0, 3.0), (4.0, 4.0)]
    assert found.setup(1).controller.kp == made.kp


def test_a_draw_that_is_not_allowed_is_refused_when_it_comes() -> None:
    far = {'parameter': 'plant.viscous_friction', 'normal': [0.0, 1.0]}
    found = runs(axes=None, laws=['compensation'], uncertain={'far': far}, repeats=16)
    negative = [run for run in range(16) if found.draws[run, 0] < 0.0]
    assert len(negative) == 8
    with pytest.raises(CtcError, match='viscous_friction'):
        found.setup(negative[0])


def test_an_example_is_a_run_without_its_draw() -> None:
    """Check one at the first point, and one whose values contradict each other there."""
    made = runs(uncertain=None, repeats=1)
    assert list(made.examples()) == [made.setup(0), made.setup(1)]
    friction = {'parameter': 'plant.coulomb_friction', 'values': [1e9]}
    axes = {'level': friction, 'factor': {**friction, 'values': [2.0], 'factor': True}}
    made = runs(axes=axes, uncertain=None)
    with pytest.raises(CtcError, match='coulomb_friction'):
        made.setup(0)
    assert next(made.examples()).controller.law == 'compensation'


def uncertain(**distribution: Any) -> Uncertain:
    return read_uncertain('x', {'parameter': 'plant.coulomb_friction', **distribution})


def drawn(x: Uncertain, method: str = 'sobol', n: int = 1024) -> Any:
    return draw_quantities([x], Repeats(method, n, 3))[:, 0]


@pytest.mark.parametrize('method', ['random', 'latin_hypercube', 'sobol'])
@pytest.mark.parametrize(('x', 'distribution'), [
    (uncertain(uniform=[0.9, 1.1]), stats.uniform(0.9, 0.2)),
    (uncertain(log_uniform=[1e-3, 10.0]), stats.loguniform(1e-3, 10.0)),
    (uncertain(normal=[2.0, 0.5]), stats.norm(2.0, 0.5))], ids=['uniform', 'log', 'normal'])
def test_draws_have_their_distribution(method: str, x: Uncertain, distribution: Any) -> None:
    assert stats.kstest(drawn(x, method), distribution.cdf).pvalue > 0.01


@pytest.mark.parametrize('method', ['latin_hypercube', 'sobol'])
def test_a_choice_is_balanced(method: str) -> None:
    values, counts = np.unique(drawn(uncertain(choice=[0, 1, 5, 7]), method), return_counts=True)
    assert values.tolist() == [0.0, 1.0, 5.0, 7.0]
    assert counts.tolist() == [256] * 4


def test_sampling_methods_have_their_defining_balance() -> None:
    """Check a stratum of each dimension for each draw, and the elementary intervals of Sobol."""
    for method in ('latin_hypercube', 'sobol'):
        u = draw_unit_cube(method, 16, 3, 0)
        assert (np.sort((16 * u).astype(int), axis=0) == np.arange(16)[:, np.newaxis]).all()
    u = draw_unit_cube('sobol', 16, 2, 0)
    assert len({(int(4 * x), int(4 * y)) for x, y in u}) == 16


@pytest.mark.parametrize('method', ['random', 'sobol'])
def test_more_repeats_begin_with_the_same_draws(method: str) -> None:
    many, few = draw_unit_cube(method, 37, 2, 5), draw_unit_cube(method, 5, 2, 5)
    assert many[:5].tobytes() == few.tobytes()
    assert not np.array_equal(draw_unit_cube(method, 5, 2, 6), few)


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


def test_a_boundary_is_followed_between_points_of_the_coarse_grid() -> None:
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
