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

"""The page of a map, read back, and what is beside it."""

from __future__ import annotations

from pathlib import Path
import re

from ctc_chattering.analysis.tables import Table
from ctc_chattering.runs.map_data import MapData
from ctc_chattering.runs.map_page import against_base, failures, headline, lead, write_report
from ctc_chattering.runs.spec import read_spec, rows_of
from map_tables import made_up, table_of
import numpy as np
import pytest
from scipy.stats import binomtest  # type: ignore[import-untyped]

AXES = {'friction': [2.0, 8.0, 20.0], 'ka': [1.0, 5.0, 15.0, 40.0]}


def cells(table: Table) -> list[list[str]]:
    """Return the rows as plain text, the lines of a cell apart."""
    return [[re.sub('<.*?>', '', cell.replace('<br>', '\n')).replace('\N{NO-BREAK SPACE}', ' ')
             for cell in row] for row in table.rows]


def test_the_table_has_the_shares_of_the_rows() -> None:
    table = made_up(AXES, 5)
    rows, found = table.to_pylist(), failures(MapData(table, dict.fromkeys(AXES, 'N*m')))
    kinds = [x for x in ('diverged', 'error', 'saturated') if x in found.heads]
    assert set(kinds) == {row['failure'] for row in rows} - {''}
    assert [line[0] for line in found.rows] == list(dict.fromkeys(x['variant'] for x in rows))
    for line in cells(found):
        mine = [row for row in rows if row['variant'] == line[0]]
        counts = [sum(row['failure'] != '' for row in mine), *(
            sum(row['failure'] == kind for row in mine) for kind in kinds)]
        assert line[1] == f'{len(mine)}' == '60'
        for k, cell in zip(counts, line[2:-1]):
            share, _, interval = cell.partition('\n')
            assert share == f'{k / 0.6:.1f} %'
            low, high = map(float, interval.split(' to '))
            # At least as wide as if all 60 runs were independent, for five draws are shared.
            alone = binomtest(k, 60).proportion_ci(method='wilson')
            assert low <= 100 * alone.low + 0.06 and high >= 100 * alone.high - 0.06
        errors = sorted(np.inf if row['error'] is None else row['error'] for row in mine)
        for text, value in zip(line[-1].split('\n'), (errors[29], errors[56])):
            if np.isinf(value):
                assert text == 'diverged'
            else:
                assert float(text.replace('−', '-')) == pytest.approx(value, rel=5e-3)


def test_the_worst_law_comes_first() -> None:
    failure = np.full((2, 3, 4), '', object)
    failure[0, 1] = 'error'
    failure[:, 2] = 'diverged'
    failure[1, 0, 0] = 'error'
    data = MapData(table_of(('compensation', 'chattering sign', 'observer_feedback'),
                            {'ka': [1.0, 2.0]}, {
        'error': np.where(failure == 'diverged', np.nan, 1.0), 'failure': failure}), {'ka': 'N*m'})
    (found,) = against_base(data)
    assert found.heads == ['law', 'runs', 'only the law fails', 'only compensation fails']
    assert cells(found) == [
        ['observer_feedback', '8', '7', '0'], ['chattering sign', '8', '4', '1']]
    assert headline(data) == (
        'compensation fails in 12.5 %, observer_feedback in 100.0 % of the runs')
    assert lead(data) == '3 laws over ka, 2 points: 24 runs.'


def test_one_law_that_never_fails() -> None:
    data = MapData(table_of(('compensation',), {'ka': [3.0]}, {
        'error': [[[1e-5, 1e-4]]], 'failure': [[['', '']]]}), {'ka': 'N*m'})
    assert headline(data) == 'compensation fails in 0.0 % of the runs'
    assert lead(data) == '1 law: 2 runs.'
    assert not list(against_base(data))
    assert cells(failures(data)) == [
        ['compensation', '2', '0.0 %\n0.0 to 65.8', '1.00e-05\n1.00e-04']]


SPEC = """
params_file: friction
duration: 3.0
window: [1.0, 2.5]
laws: [compensation, chattering sign]
axes:
  ka: {parameter: controller.ka, values: [5, 20]}
  load: {parameter: plant.coulomb_friction, values: [1], factor: true}
uncertain:
  model: {parameters: [controller.inertia_scale, controller.gravity_scale], uniform: [0.8, 1.2]}
  noise: {parameter: plant.position_noise, log_uniform: [1.0e-5, 2.0e-4]}
sampling: latin_hypercube
repeats: 3
seed: 4
failure: {error_above: 0.005, saturated_above: 0.25, not_reached: true}
"""


def test_page_and_figures_of_a_spec(tmp_path: Path) -> None:
    path = tmp_path / 'small.yaml'
    path.write_text(SPEC, encoding='utf-8')
    spec = read_spec(path)
    found = dict(rows_of(spec.tree))
    assert found['laws'] == '[compensation, chattering sign]'
    assert found['uncertain noise'] == (
        '{parameter: plant.position_noise, log_uniform: [1.0e-05, 0.0002]}')
    table = made_up({axis.name: axis.values for axis in spec.axes}, 3,
                    variants=[x.name for x in spec.variants])
    text = write_report(spec, table, tmp_path / 'out').read_text(encoding='utf-8')
    assert (tmp_path / 'out' / 'figures' / 'lines.svg').is_file()
    for part in ('src="figures/lines.svg"', 'href="map.parquet"', 'href="map.json"',
                 '[1.0, 2.5]', 'ka [N·m]', 'Values of ka [N·m] at which less than half'):
        assert part in text
