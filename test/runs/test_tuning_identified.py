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

"""What `ctc identify` leaves uncertain, from its own files and from others of their form."""

from __future__ import annotations

import json
from math import inf
from pathlib import Path
from typing import Any

from ctc_chattering.cli.ctc import main
from ctc_chattering.configuration import parameter_file
from ctc_chattering.errors import CtcError
from ctc_chattering.runs.points import Runs
from ctc_chattering.runs.tune_spec import identified_spec, TuneSpec
from identified_bags import recorded_bag, short
import pytest
from urdfs import two_links

NONE = {'value': None, 'reason': 'none shows'}


def number(value: float, half: float) -> dict[str, Any]:
    return {'value': value, 'interval_95': [value - half, value + half]}


def possible(delay: int, *lags: tuple[float, float]) -> dict[str, Any]:
    """Return a delay with the intervals of its lags."""
    return {'delay_samples': delay, 'actuator_lag_interval_95_s': lags}


def contents(**more: Any) -> dict[str, Any]:
    """Return the contents of identify.json that are read."""
    return {
        'joint_names': ['a', 'b'], 'delay_samples': 1,
        'delays_possible': [possible(1, (1e-3, 3e-3), (2e-3, 6e-3))],
        'friction': [{'coulomb': number(10.0, 1.0), 'viscous': number(2.0, 0.1)},
                     {'coulomb': number(4.0, 1.0), 'viscous': NONE}],
        'model_errors': [], **more}


def written(folder: Path, found: Any) -> Path:
    """Write a directory of `ctc identify` for a robot of a URDF."""
    urdf = folder / 'robot.urdf'
    urdf.write_text(two_links())
    both = {'joint_names': ['a', 'b'], 'model': 'urdf', 'description': str(urdf)}
    parameter_file.dump({
        '/**': both, 'plant': {'duration': 1.0, 'coulomb_friction': [10.0, 4.0],
                               'viscous_friction': [2.0, 0.0], 'actuator_lag': [2e-3, 4e-3],
                               'input_delay': 1},
        'reference': {'center': [0.0, 0.0], 'amplitude': [0.1, 0.1], 'frequency': [0.5, 0.5]}},
        folder / 'identified.yaml')
    (folder / 'identify.json').write_text(found if isinstance(found, str) else json.dumps(found))
    return folder


def ranges(spec: TuneSpec) -> dict[str, Any]:
    return {x.name: pytest.approx(x.numbers) for x in spec.uncertain}


def test_friction_is_drawn_within_its_widest_interval(tmp_path: Path) -> None:
    found = identified_spec(written(tmp_path, contents()), {'repeats': 64})
    assert ranges(found) == {'coulomb': (0.75, 1.25), 'viscous': (0.95, 1.05),
                             'lag': (1e-3, 6e-3), 'model': (0.95, 1.05)}
    setups = Runs(found).setups
    for k, (low, high) in enumerate(((7.5, 12.5), (3.0, 5.0))):
        drawn = [x.plant.coulomb_friction[k] for x in setups]
        assert low <= min(drawn) < low + 0.05 * low
        assert high - 0.05 * high < max(drawn) <= high
    assert {x.controller.input_delay for x in setups} == {0}


def test_every_delay_that_is_possible_is_drawn_and_all_lags_with_any_of_them(
        tmp_path: Path) -> None:
    pairs = {0: ((3e-3, 4e-3), (5e-3, 7e-3)), 1: ((2e-3, 3e-3), (4e-3, 5e-3)),
             2: ((-1e-4, 1e-3), (1e-3, 1e-3))}
    spec = identified_spec(written(tmp_path, contents(delay_samples=None, delays_possible=[
        possible(delay, *lags) for delay, lags in pairs.items()])), {'repeats': 64})
    assert ranges(spec)['delay'] == (0.0, 1.0, 2.0)
    assert ranges(spec)['lag'] == (0.0, 7e-3)
    plants = [x.plant for x in Runs(spec).setups]
    for delay in pairs:
        assert sum(x.input_delay == delay for x in plants) > 15
    drawn = [x.actuator_lag[0] for x in plants]
    assert min(drawn) < 5e-4 and max(drawn) > 6.5e-3


def test_errors_of_masses_widen_the_model_and_a_payload_is_carried(tmp_path: Path) -> None:
    errors = [{'name': 'upper', 'unit': '', **number(-0.1, 0.02)},
              {'name': 'lower', 'unit': '', **NONE},
              {'name': 'payload', 'unit': 'kg', **number(1.0, 0.1)}]
    spec = identified_spec(written(tmp_path, contents(model_errors=errors)), {})
    assert ranges(spec)['model'] == (0.88, 1.12)
    assert ranges(spec)['payload'] == (0.9, 1.1)
    assert all(0.9 <= x.plant.payload <= 1.1 for x in Runs(spec).setups)
    errors[2].update(number(-1.0, 0.1))
    spec = identified_spec(written(tmp_path, contents(model_errors=errors)), {})
    assert 'payload' not in ranges(spec)


def test_friction_without_an_interval_is_not_drawn(tmp_path: Path) -> None:
    friction = [{'coulomb': NONE, 'viscous': NONE}, {'coulomb': NONE, 'viscous': NONE}]
    spec = identified_spec(written(tmp_path, contents(friction=friction)), {})
    assert {'coulomb', 'viscous'} & set(ranges(spec)) == set()


@pytest.mark.parametrize('text', ['{', '[]', '3', '{}', '{"friction": 1}', '{"friction": [{}]}'])
def test_another_file_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    with pytest.raises(CtcError, match=r'identify\.json: not a file of ctc identify$'):
        identified_spec(written(tmp_path, text), {})


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(CtcError, match=r'identified.yaml: No such file'):
        identified_spec(tmp_path, {})
    (written(tmp_path, contents()) / 'identify.json').unlink()
    with pytest.raises(CtcError, match=r'identify.json: No such file'):
        identified_spec(tmp_path, {})


def test_what_identify_writes_is_read(tmp_path: Path) -> None:
    made = short(duration=3.0)
    bag = recorded_bag(tmp_path / 'bag', made)
    out = tmp_path / 'identified'
    assert main(['identify', str(bag), '--model', 'two_link', '--trials', '0',
                 '--out', str(out)]) == 0
    spec = identified_spec(out, {'repeats': 8})
    assert [x.name for x in spec.uncertain] == ['coulomb', 'viscous', 'lag', 'model']
    assert max(spec.file.controller.torque_rate_limit) < inf
    assert set(spec.limits.rate) == {inf}, 'the rate of the drives is not known'
    given = identified_spec(out, {'tune': {'torque_rate_limit': 700.0}})
    assert set(given.limits.rate) == {700.0}
    found = json.loads((out / 'identify.json').read_text())
    for k, friction in enumerate(found['friction']):
        low, high = friction['coulomb']['interval_95']
        middle = friction['coulomb']['value']
        drawn = [x.plant.coulomb_friction[k] for x in Runs(spec).setups]
        assert min(drawn) > middle - 5.0 * (high - low)
        assert max(drawn) < middle + 5.0 * (high - low)
        assert len(set(drawn)) == 8
